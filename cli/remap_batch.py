"""Picture files of `fullsphere remap`: what becomes which file, and many at a time.

Several pictures are under way at once, each in a thread of its own: while one is read another is remapped and a third
is written.  The tiles of all of them are computed on one pool.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from fullsphere.model.remap import Band, Remapper

UNDER_WAY = 3
"""Pictures in memory at a time: one that is read, one that is remapped, one that is written."""

BAND_ROWS = 64
"""Rows of a target that are computed and written at a time."""

WRITTEN = (".tif", ".tiff", ".exr", ".png", ".jpg", ".jpeg")
_READ = (*WRITTEN, ".webp", ".jp2", ".j2k", ".jxl")  # what is taken from a folder


class Job(NamedTuple):
    """A picture, and the file that it becomes."""

    picture: Path
    output: Path


class Outcome(NamedTuple):
    """What became of a job: the share of the target that was seen, or why there is no file."""

    job: Job
    seen: float = 0.0
    fault: str = ""


@dataclasses.dataclass(frozen=True)
class Work:
    """How each picture is remapped and written.

    Attributes
    ----------
    remapper
        Does the work.
    check_size
        Refuses a picture by name and size, if it is not of the source's.
    attributes
        Metadata of the target that every file gets.
    alpha
        Whether files get a channel that says what was seen, if their format has one.
    compression
        As `open_panorama` takes it.
    overwrite
        Replace files that exist.
    """

    remapper: Remapper
    check_size: Callable[[str, tuple[int, int]], None]
    attributes: dict[str, Any]
    alpha: bool
    compression: str | None
    overwrite: bool


def planned(given: Sequence[Path], output: str, ending: str | None) -> list[Job]:
    """The jobs of pictures and folders of pictures, in the order given; a folder's by name.

    Parameters
    ----------
    given
        Files and folders.
    output
        A file for one picture; a folder, which exists or ends in a slash, for any number.
    ending
        Of the files in that folder, without the dot; None for that of each picture.

    Raises
    ------
    UsageError
        If several pictures are to become one file, or two a file of one name.
    InputError
        If a folder holds no picture, or cannot be read.
    """
    from fullsphere.model.errors import UsageError

    if not is_folder(output):
        if len(given) > 1 or given[0].is_dir():
            raise UsageError(f"{output}: several pictures need a folder; write -o {output}/")
        if ending is not None:
            raise UsageError(f"--format is for a folder; the ending of {output} names the format")
        return [Job(given[0], Path(output))]
    jobs: dict[Path, Job] = {}
    for picture in (picture for name in given for picture in _pictures(name)):
        job = Job(picture, Path(output) / f"{picture.stem}{_ending(picture, ending)}")
        other = jobs.setdefault(job.output, job)
        if other is not job:
            raise UsageError(
                f"{other.picture} and {picture} would both become {job.output}; remap them into two folders"
            )
    return list(jobs.values())


def is_folder(output: str) -> bool:
    """Whether a name is that of a folder, by its end or because it is there."""
    return output.endswith(("/", os.sep)) or Path(output).is_dir()


def _pictures(name: Path) -> list[Path]:
    from fullsphere.model.errors import InputError
    from fullsphere.model.files import input_errors

    if not name.is_dir():
        return [name]
    with input_errors(name):
        found = sorted(p for p in name.iterdir() if p.suffix.lower() in _READ and p.is_file() and p.name[0] != ".")
    if not found:
        raise InputError(f"{name}: holds no pictures ({' '.join(_READ)})")
    return found


def _ending(picture: Path, ending: str | None) -> str:
    if ending is not None:
        return f".{ending}"
    return picture.suffix if picture.suffix.lower() in WRITTEN else ".tif"


@contextlib.contextmanager
def outputs_of(jobs: Sequence[Job], overwrite: bool, make_folder: bool) -> Iterator[None]:
    """Make sure that all files can be written before any is.

    With `make_folder` theirs is made if it is missing, and taken away again if it stays empty.

    Raises
    ------
    OutputError
        As `check_output`, which is too slow for all pairs of a hundred thousand pictures.
    """
    from fullsphere.model.errors import OutputError
    from fullsphere.model.files import check_output, output_errors

    inputs = {identity: job.picture for job in jobs if (identity := _identity(job.picture))}
    folder = jobs[0].output.parent
    made = make_folder and not folder.exists()
    if made:
        if not folder.parent.is_dir():
            raise OutputError(f"{folder}: the folder {folder.parent} does not exist; make it first")
        with output_errors(folder):
            folder.mkdir()
    try:
        for k, job in enumerate(jobs):
            identity = _identity(job.output)
            if identity in inputs:
                raise OutputError(
                    f"{job.output}: is an input of this run ({inputs[identity]}); choose another output name"
                )
            if k == 0 or identity or job.output.is_symlink():
                check_output(job.output, overwrite)
        yield
    finally:
        if made:
            with contextlib.suppress(OSError):  # if there is anything in it
                folder.rmdir()


def _identity(path: Path) -> tuple[int, int] | None:
    with contextlib.suppress(OSError):
        status = path.stat()
        return status.st_dev, status.st_ino
    return None


def remap_one(job: Job, work: Work, watch: Callable[[Iterable[Band]], Iterable[Band]]) -> Outcome:
    """Remap a picture into a file, in bands of rows that `watch` may look at.

    Raises
    ------
    InputError
        If the picture cannot be read, or is of another size than its projection.
    UsageError
        If the file's format does not hold its samples.
    OutputError, ResourceError
        As `open_panorama`.
    """
    from fullsphere.model.coverage import file_channels, with_channels
    from fullsphere.model.images import carried, open_panorama, open_picture

    size = work.remapper.target.size
    with open_picture(job.picture) as file:
        work.check_size(str(job.picture), file.size)
        channels = file_channels(file.channels, work.alpha and job.output.suffix.lower() not in (".jpg", ".jpeg"))
        metadata, icc_profile = carried(file.metadata, file.icc_profile, channels)
        noted = {**metadata, **work.attributes}
        with open_panorama(
            job.output, size, channels, file.dtype, noted, work.overwrite, icc_profile, work.compression
        ) as writer:
            seen = 0.0
            for band in watch(work.remapper.bands(file, BAND_ROWS)):
                writer.write_rows(band.top, with_channels(band.pixels, band.weight, channels))
                seen += float(band.weight.sum(dtype=float))
    return Outcome(job, seen / (size[0] * size[1]))


def remap_many(jobs: Sequence[Job], work: Work, threads: int | None) -> Iterator[Outcome]:
    """The outcomes of many jobs, in order; a picture that cannot be used is one with a fault.

    Raises
    ------
    OutputError, ResourceError
        As `remap_one`: the next picture would meet the same.
    """
    from fullsphere.model.errors import InputError, UsageError
    from fullsphere.model.workers import ordered_map

    left = threading.Event()

    def unless_left(bands: Iterable[Band]) -> Iterator[Band]:
        for band in bands:
            if left.is_set():
                raise _LeftError
            yield band

    def one(job: Job) -> Outcome:
        try:
            return remap_one(job, work, unless_left)
        except (InputError, UsageError) as error:
            return Outcome(job, fault=str(error))

    at_a_time = 1 if threads == 1 else UNDER_WAY
    with ThreadPoolExecutor(at_a_time, thread_name_prefix="fullsphere-picture") as pool:
        try:
            yield from ordered_map(pool, one, jobs, at_a_time)
        finally:
            left.set()


class _LeftError(Exception):
    """The run ends early: nobody waits for this picture any more."""
