"""Picture files -> frames: what can be opened, and what is left out and why."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.icc import profile_of
from fullsphere.model.images import noted_ev, read_picture
from fullsphere.model.pose_metadata import told_pose
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.brackets import positions_of
from fullsphere.mosaic.common_cut import cut_alike
from fullsphere.mosaic.loading import loader
from fullsphere.mosaic.masks import Masks, masked
from fullsphere.mosaic.orientation_tag import quarter_turns
from fullsphere.mosaic.priors import with_prior
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.rim import common_circle
from fullsphere.mosaic.turned import turned_back


def open_frames(
    paths: Sequence[Path],
    size: tuple[int, int] | None = None,
    executor: Executor | None = None,
    progress: Callable[..., Any] | None = None,
    *,
    centre_px: tuple[float, float] | None = None,
    masks: Masks | None = None,
    brackets: int = 1,
) -> list[Frame]:
    """A frame for each file, or each so many brackets, in the order given.

    Pixels are taken as stored, whatever the EXIF orientation, which only tells how far from upright they are.  A file
    with width and height exchanged was turned by a program and is turned back.  Sizes that differ by up to a hundredth
    are cut to what all have, unless a camera asks for one.  A file that cannot be read, that holds the same bytes as an
    earlier one, or of another size is left out with the reason.

    Parameters
    ----------
    paths
        Picture files.
    size
        Width and height that the camera asks for; without it the size that most files have.
    executor
        Where files are read side by side.
    progress
        Wraps the loop over the files.
    centre_px
        The camera's image centre, where it is known: it tells which way a turned file was turned.
    masks
        Where the frames' masks are.
    brackets
        So many pictures at a time are taken from one position and merged (`positions_of`).

    Raises
    ------
    UsageError
        If there are not so many files times a whole number.
    InputError
        If a file does not exist, a mask cannot be used, or fewer than two frames are left; the message says why of the
        first that are not.
    """
    frames = positions_of(read_files(paths, executor, progress), brackets, executor, progress)
    wanted = size or usual_size(frames)
    frames = _turned_back(frames, wanted, centre_px)
    if size is None:
        frames = cut_alike(frames, wanted)
        wanted = usual_size(frames)
    frames = without_doubles(of_one_size(frames, wanted, "the camera is for" if size else "most frames have"))
    refuse_if_fewer(frames, 2, "a mosaic needs at least two frames")
    return frames if masks is None else masked(frames, masks, executor)


def read_files(
    paths: Sequence[Path], executor: Executor | None = None, progress: Callable[..., Any] | None = None
) -> list[Frame]:
    """A frame for each file, of whatever size; each is decoded once, and left out if it is damaged.

    Raises
    ------
    InputError
        If a file does not exist.
    """
    for path in paths:
        if not path.exists():  # a slip of the pen, to be told before the work; a damaged file is another matter
            raise InputError(f"{path}: there is no such file; check the name")
    ids = _unique_names(paths)
    opened = ordered_map(executor, _read, list(zip(ids, paths, strict=True)), ahead=4)
    return list(progress(opened, title="reading frames", total=len(paths)) if progress else opened)


def usual_size(frames: Sequence[Frame]) -> tuple[int, int]:
    """Width and height that most of the frames have."""
    sizes = Counter(frame.size for frame in frames if not frame.reason)
    return sizes.most_common(1)[0][0] if sizes else (0, 0)


def of_one_size(frames: Sequence[Frame], wanted: tuple[int, int], asked: str) -> list[Frame]:
    """The frames, those of another size left out; `asked` says who wants the size, before it."""
    return [frame if frame.reason or frame.size == wanted else _of_other_size(frame, wanted, asked) for frame in frames]


def without_doubles(frames: Sequence[Frame]) -> list[Frame]:
    """The frames, those left out whose file holds the same bytes as that of an earlier one."""
    first_with: dict[str, Frame] = {}
    kept = []
    for frame in frames:
        first = frame if frame.reason else first_with.setdefault(frame.sha256, frame)
        same = f"is {first.id} given again" if first.image == frame.image else f"is the same file as {first.id}"
        kept.append(frame if first is frame else frame.left_out(same))
    return kept


def refuse_if_fewer(frames: Sequence[Frame], least: int, need: str) -> None:
    """InputError with the first reasons if fewer than `least` frames are left; `need` begins the message."""
    reasons = [f"{frame.id}: {frame.reason}" for frame in frames if frame.reason]
    usable = len(frames) - len(reasons)
    if usable >= least:
        return
    message = f"{need}, and {usable} of the {len(frames)} given can be used"
    if reasons:
        message += f" ({'; '.join(reasons[:3])}{' ...' if len(reasons) > 3 else ''})"
    raise InputError(message)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    """File names, with the folder before them where two files have one name; a file given again is numbered."""
    often = Counter(path.name for path in dict.fromkeys(paths))
    times: Counter[Path] = Counter()
    names = []
    for path in paths:
        times[path] += 1
        name = path.name if often[path.name] == 1 else path.as_posix()
        names.append(name if times[path] == 1 else f"{name}:{times[path]}")
    return names


def _read(named: tuple[str, Path]) -> Frame:
    name, path = named
    try:
        picture = read_picture(path)
        told, sha256 = told_pose(path), sha256_of(path)
    except InputError as error:
        reason = str(error).removeprefix(f"{path}: ")
        return Frame(name, str(path), (0, 0), _nothing, reason=reason)
    height, width = picture.pixels.shape[:2]
    turns = quarter_turns(picture.orientation)
    exposure = noted_ev(picture.metadata)
    frame = Frame(name, str(path), (width, height), loader(path), sha256, told_ev=exposure, quarter_turns=turns)
    if not picture.linear and picture.icc_profile:
        frame = dataclasses.replace(frame, profile=functools.partial(profile_of, picture.icc_profile))
    return with_prior(frame, told, turns)


def _of_other_size(frame: Frame, wanted: tuple[int, int], asked: str) -> Frame:
    this, that = (f"{width} x {height}" for width, height in (frame.size, wanted))
    return frame.left_out(f"is {this} pixels, {asked} {that}")


def _nothing() -> Any:
    raise InputError("a frame that could not be read was asked for its pixels")


def _turned_back(
    frames: Sequence[Frame], wanted: tuple[int, int], centre_px: tuple[float, float] | None
) -> list[Frame]:
    """The frames, those turned back whose width and height are exchanged."""
    is_turned = [not frame.reason and frame.size == wanted[::-1] != wanted for frame in frames]
    if any(is_turned) and centre_px is None:
        circle = common_circle([frame for frame in frames if not frame.reason and frame.size == wanted])
        centre_px = None if circle is None else circle.centre
    return [turned_back(f, centre_px) if turned else f for f, turned in zip(frames, is_turned, strict=True)]
