"""A mosaic into a file: bands that are composed, kept for a run that may be killed, filled, and written."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console, messages
from fullsphere.cli.composing import DTYPES, Wanted, files_of, held, whole_sphere
from fullsphere.cli.viewer_metadata import viewer_metadata

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.model.icc import Profile
    from fullsphere.model.images import PanoramaWriter
    from fullsphere.model.projection_text import Placed
    from fullsphere.mosaic.budget import Room
    from fullsphere.mosaic.compose import Band
    from fullsphere.mosaic.planning import Plan
    from fullsphere.mosaic.project import Mosaic
    from fullsphere.mosaic.spool import Spool

_LARGEST_HALF = 65504.0
_SPOOL = "{}.unfinished"


class Written(NamedTuple):
    """What was written.

    Attributes
    ----------
    size, dtype
        Width and height, and the type of the samples.
    exposure_ev
        How much brighter than the frames' mean.
    seen
        The share of pixels that some frame sees.
    filled
        Whether the others were filled.
    layers
        How many layers were written beside it.
    notes
        Sentences on what was done that a person may want otherwise.
    """

    size: tuple[int, int]
    dtype: str
    exposure_ev: float
    seen: float
    filled: bool
    layers: int
    notes: tuple[str, ...] = ()


class _Job(NamedTuple):
    """What every step needs to know."""

    path: Path
    mosaic: Mosaic
    plan: Plan
    target: Placed
    dtype: np.dtype[Any]
    wanted: Wanted
    room: Room
    executor: Executor
    args: argparse.Namespace

    @property
    def computed(self) -> Any:
        """The type of the samples as they are composed: half floats are made of floats."""
        import numpy as np

        return np.float32 if self.dtype.kind == "f" else self.dtype.type


def write_panorama(path: Path, mosaic: Mosaic, wanted: Wanted, executor: Executor, args: argparse.Namespace) -> Written:
    """Compose a mosaic into a file; as `wanted`, and otherwise as its frames are.

    Raises
    ------
    UsageError, ResourceError
        As `check_panorama`; if no frame sees anything of what is wanted, or the memory is not enough.
    InputError
        If a frame cannot be read any more.
    OutputError
        If the file cannot be written.
    """
    if wanted.preview:
        return _write_glimpse(path, mosaic, wanted, executor, args)
    job = _planned(path, mosaic, wanted, executor, args)
    size, files = job.target.projection.size, _layer_files(job)
    attributes, icc_profile = _metadata(job.plan.mosaic, job.dtype)
    attributes |= viewer_metadata(job.target.projection)
    with contextlib.ExitStack() as stack:
        spool = stack.enter_context(_spool(job)) if wanted.resume else None
        with _opened(path, job, 4, job.dtype, attributes, icc_profile) as writer:
            if spool is not None:
                spool.note_temporary(writer.temporary)
            seen = _write_bands(writer, job, spool)
            _refuse_nothing(seen, path)
        if spool is not None:
            spool.remove()
    _write_layers(job, files)
    _write_report(job)
    share, notes = seen / (size[0] * size[1]), job.plan.notes
    return Written(size, job.dtype.name, job.plan.exposure_ev, share, wanted.fill, len(files), notes)


def warn(written: Written) -> None:
    """Say what was done that a person may want otherwise."""
    for note in written.notes:
        messages.warn(f"{note}; --turning keep shows it")


def described(written: Written) -> str:
    """What people want to know of what was written."""
    unseen = ", the others filled" if written.filled and written.seen < 1 else ""
    darker = f", {-written.exposure_ev:.2f} EV darker than the frames' mean" if written.exposure_ev else ""
    layers = f", and {console.counted(written.layers, 'layer')}" if written.layers else ""
    size = f"{written.size[0]} x {written.size[1]} pixels of {written.dtype}"
    return f"{size}, {100 * written.seen:.1f} % of them seen{unseen}{darker}{layers}"


def summary(written: Written) -> dict[str, Any]:
    """What programs want to know of it."""
    return {
        "size_px": list(written.size),
        "samples": written.dtype,
        "reference_ev": written.exposure_ev,
        "seen": written.seen,
        "filled": written.filled,
        "layers": written.layers,
        "notes": list(written.notes),
    }


def _write_glimpse(path: Path, mosaic: Mosaic, wanted: Wanted, executor: Executor, args: argparse.Namespace) -> Written:
    """A quick look at the whole sphere as a file."""
    import numpy as np

    from fullsphere.model.images import encoded_from_linear, open_panorama
    from fullsphere.mosaic.frame_colour import common_profile
    from fullsphere.mosaic.glimpse import glimpse

    dtype = wanted.dtype or held(path, np.dtype(np.uint8))
    found = glimpse(mosaic, wanted.exposure, executor)
    seen, profile = float(found.picture[..., 3].mean(dtype=float)), common_profile(mosaic.registered)
    target = whole_sphere(found.picture.shape[1])
    attributes, icc_profile = _metadata(mosaic, dtype)
    attributes |= viewer_metadata(target.projection)
    size = target.projection.size
    rows = found.picture
    rows = _light(rows, profile, dtype) if dtype.kind == "f" else encoded_from_linear(rows, dtype, profile)
    with open_panorama(path, size, 4, dtype, attributes, args.overwrite, icc_profile, wanted.compression) as writer:
        writer.write_rows(0, rows)
    return Written(size, dtype.name, found.exposure_ev, seen, False, 0)


def _planned(path: Path, mosaic: Mosaic, wanted: Wanted, executor: Executor, args: argparse.Namespace) -> _Job:
    """Settle what is to be computed, and make sure that there is room for it."""
    from fullsphere.model.images import check_panorama
    from fullsphere.model.workers import usable_cores
    from fullsphere.mosaic.budget import shared_out
    from fullsphere.mosaic.planning import own_width, planned, shows_anything, turned_to

    target = wanted.target
    if target is None:
        target = whole_sphere(own_width(mosaic))
        width, height = target.projection.size
        console.say(args, f"{path}: {width} x {height} pixels, as finely as the frames resolve")
    size = target.projection.size
    dtype = wanted.dtype or held(path, _deepest(mosaic))
    check_panorama(path, size, 4, dtype, wanted.compression)
    room = shared_out(wanted.memory, mosaic, size, dtype, args.threads or usable_cores(), str(path))
    console.say(args, f"looking at {console.counted(len(mosaic.registered), 'frame')}")
    turned = turned_to(mosaic, target.world_from_projection)
    plan = planned(turned, wanted.exposure, wanted.blend, executor, wanted.hide_turning)
    _refuse_nothing(shows_anything(plan, target.projection), path)
    return _Job(path, mosaic, plan, target, dtype, wanted, room, executor, args)


def _opened(
    path: Path, job: _Job, channels: int, dtype: Any, attributes: dict[str, Any], icc_profile: bytes | None
) -> contextlib.AbstractContextManager[PanoramaWriter]:
    from fullsphere.model.images import open_panorama

    size, overwrite = job.target.projection.size, job.args.overwrite
    return open_panorama(path, size, channels, dtype, attributes, overwrite, icc_profile, job.wanted.compression)


def _write_bands(writer: PanoramaWriter, job: _Job, spool: Spool | None) -> int:
    """Write all bands, those that are kept first; answer how many pixels some frame sees."""
    import numpy as np

    from fullsphere.mosaic.unseen import Filling

    filling = Filling(job.plan, job.executor) if job.wanted.fill else None
    total, seen = -(-job.target.projection.size[1] // job.room.tile_px), 0
    for band in console.progress(job.args)(_bands(job, spool), title="composing", total=total):
        seen += int(np.count_nonzero(band.rows[..., 3]))
        whole = filling.filled(band, job.target.projection) if filling else band
        writer.write_rows(band.top, _samples(whole.rows, job))
    return seen


def _bands(job: _Job, spool: Spool | None) -> Iterator[Band]:
    """All bands from the top; those that an earlier run has kept as they are."""
    if spool is None:
        yield from _composed(job, 0)
        return
    top = 0
    for band in spool.kept():
        yield band
        top = band.top + len(band.rows)
    if top:
        console.say(job.args, f"{job.path}: {top} of {job.target.projection.size[1]} rows were finished before")
    if top < job.target.projection.size[1]:
        yield from spool.keeping(_composed(job, top))


def _composed(job: _Job, top: int) -> Iterator[Band]:
    """The bands from row `top` on."""
    from fullsphere.mosaic.compose import compose
    from fullsphere.mosaic.lower_part import lower_part

    plan, (frame_bytes, tile_px) = job.plan, job.room
    part = lower_part(job.target.projection, top)
    found = compose(plan.mosaic, part, job.computed, job.executor, plan.shares, plan.exposure_ev, frame_bytes, tile_px)
    for band in found:
        yield band._replace(top=top + band.top)


def _samples(rows: NDArray[Any], job: _Job) -> NDArray[Any]:
    """Rows as the file holds them."""
    from fullsphere.mosaic.frame_colour import common_profile

    if job.dtype.kind != "f":
        return rows
    return _light(rows, common_profile(job.plan.mosaic.registered), job.dtype)


def _light(rows: NDArray[Any], own: Profile, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Linear light (h, w, 4) of a colour space in the primaries of sRGB, which files of floats are in."""
    import numpy as np

    from fullsphere.mosaic.frame_colour import srgb_light

    rows[..., :3] = srgb_light(rows[..., :3], own)
    if dtype == np.float16:
        np.clip(rows, -_LARGEST_HALF, _LARGEST_HALF, out=rows)
    return rows.astype(dtype, copy=False)


def _spool(job: _Job) -> Spool:
    """The folder of finished bands beside the output."""
    from fullsphere.model.resources import require_disk
    from fullsphere.mosaic.spool import Spool

    width, height = job.target.projection.size
    folder = job.path.with_name(_SPOOL.format(job.path.name))
    spool = Spool(folder, _key(job), (width, height), job.computed)
    there = sum(entry.stat().st_size for entry in folder.iterdir())
    needed = width * height * spool.bytes_per_pixel - there
    require_disk(needed, folder, f"{folder}: --resume", "make room, or do without it")
    return spool


def _key(job: _Job) -> str:
    """What the bands depend on."""
    from importlib.metadata import version

    from fullsphere.model.camera import Camera
    from fullsphere.model.files import sha256_of
    from fullsphere.model.store import camera_to_dict
    from fullsphere.mosaic.spool import key_of
    from fullsphere.mosaic.store import mosaic_to_dict

    plan, target = job.plan, job.target
    surface = target.projection
    spelled = camera_to_dict(surface) if isinstance(surface, Camera) else job.args.to
    masks = [sha256_of(Path(name)) for name in sorted({f.mask_image for f in plan.mosaic.registered} - {""})]
    return key_of(
        [version(name) for name in ("fullsphere", "numpy", "numba", "opencv-python-headless", "OpenImageIO")],
        mosaic_to_dict(job.mosaic, job.path.parent),
        masks,
        [surface.size, spelled, target.world_from_projection],
        [job.wanted.exposure, job.wanted.blend, job.wanted.hide_turning],
        [plan.exposure_ev, str(job.computed), job.room.tile_px],
    )


def _layer_files(job: _Job) -> list[tuple[Path, Path]]:
    """What the layers of the registered frames are to be called: pictures and masks; checked, and the folder made."""
    from fullsphere.model.files import check_output, output_errors
    from fullsphere.mosaic.layers import layer_names

    folder = job.wanted.layers
    if folder is None:
        return []
    with output_errors(folder):
        folder.mkdir(exist_ok=True)
    names = layer_names(job.plan.mosaic.registered)
    files = [(folder / f"{name}.tif", folder / f"{name}_mask.tif") for name in names]
    for path in itertools.chain.from_iterable(files):
        check_output(path, job.args.overwrite, [*files_of(job.mosaic), job.path])
    return files


def _write_layers(job: _Job, files: list[tuple[Path, Path]]) -> None:
    """Each frame on the panorama's surface, and where it is the owner, as TIFF files."""
    import numpy as np

    from fullsphere.mosaic.layers import layer, ownership

    if not files:
        return
    frames = job.plan.mosaic.registered
    surface = job.target.projection
    samples = np.dtype(np.float32) if job.dtype.kind == "f" else job.dtype
    plainly = job.wanted._replace(compression=None)
    for k, (picture, mask) in console.progress(job.args)(list(enumerate(files)), title="writing layers"):
        single = dataclasses.replace(job.plan.mosaic, frames=(frames[k],))
        own = job._replace(plan=job.plan._replace(mosaic=single), dtype=samples, wanted=plainly)
        attributes, icc_profile = _metadata(single, samples)
        with _opened(picture, own, 4, samples, attributes | viewer_metadata(surface), icc_profile) as writer:
            for band in layer(job.plan, k, surface, own.computed, job.executor):
                writer.write_rows(band.top, _samples(band.rows, own))
        with _opened(mask, own, 1, np.uint8, viewer_metadata(surface), None) as writer:
            for band in ownership(job.plan.shares, k, surface, job.executor):
                writer.write_rows(band.top, band.rows)


def _write_report(job: _Job) -> None:
    """The page about the panorama, if it was asked for."""
    if job.wanted.report is None:
        return
    from fullsphere.cli.page import write_page
    from fullsphere.cli.panorama_page import page_of_panorama

    write_page(job.wanted.report, page_of_panorama(job.path.name, job.plan, job.executor), job.args.overwrite)


def _refuse_nothing(seen: float, path: Path) -> None:
    from fullsphere.model.errors import UsageError

    if not seen:
        raise UsageError(f"{path}: no frame sees anything of it; choose another window or direction with --to")


def _metadata(mosaic: Mosaic, dtype: np.dtype[Any]) -> tuple[dict[str, Any], bytes | None]:
    """What the first frame's camera noted, and the colour profile that all are composed in."""
    from fullsphere.model.images import carried, open_picture
    from fullsphere.mosaic.frame_colour import common_profile

    first, noted = mosaic.registered[0], {}
    if first.sha256:
        with open_picture(Path(first.image)) as file:
            noted = dict(file.metadata)
    attributes, _ = carried(noted, None, 4)
    icc_profile = None if dtype.kind == "f" else common_profile(mosaic.registered).icc or None
    return attributes, icc_profile


def _deepest(mosaic: Mosaic) -> np.dtype[Any]:
    """The type of the frames' samples; of those with most bits where they differ, which is said."""
    import numpy as np

    from fullsphere.model.images import open_picture

    found = set()
    for frame in mosaic.registered:
        if frame.brackets:
            found.add(np.dtype(np.float32))
            continue
        if not frame.sha256:
            found.add(frame.load().dtype)
            continue
        with open_picture(Path(frame.image)) as file:
            found.add(file.dtype)
    names = [kind for kind in DTYPES.values() if np.dtype(kind) in found]
    if len(names) > 1:
        messages.warn(f"the frames have several depths ({', '.join(names)}); the panorama gets {names[-1]}")
    return np.dtype(names[-1])
