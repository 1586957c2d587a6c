"""Picture files -> frames: what can be opened, and what is left out and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import read_picture
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.project import Frame


def open_frames(
    paths: Sequence[Path],
    size: tuple[int, int] | None = None,
    executor: Executor | None = None,
    progress: Callable[..., Any] | None = None,
) -> list[Frame]:
    """A frame for each file, in the order given.

    A file that cannot be read, that holds the same bytes as an earlier one, or whose size is not that of the camera
    is left out with the reason.

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

    Raises
    ------
    InputError
        If a file does not exist, or fewer than two frames are left; the message says why of the first that are not.
    """
    for path in paths:
        if not path.exists():  # a slip of the pen, to be told before the work; a damaged file is another matter
            raise InputError(f"{path}: there is no such file; check the name")
    ids = _unique_names(paths)
    opened = ordered_map(executor, _open, list(zip(ids, paths, strict=True)), ahead=4)
    frames = list(progress(opened, title="reading frames", total=len(paths)) if progress else opened)
    wanted = size or _usual_size(frames)
    first_with: dict[str, str] = {}
    for k, frame in enumerate(frames):
        if frame.reason:
            continue
        if frame.size != wanted:
            asked = "the camera is for" if size else "most frames have"
            frames[k] = frame.left_out(
                f"is {frame.size[0]} x {frame.size[1]} pixels, {asked} {wanted[0]} x {wanted[1]}"
            )
        elif frame.sha256 in first_with:
            frames[k] = frame.left_out(f"is the same file as {first_with[frame.sha256]}")
        else:
            first_with[frame.sha256] = frame.id
    if len(first_with) < 2:
        _refuse(frames)
    return frames


def _unique_names(paths: Sequence[Path]) -> list[str]:
    """File names, with the folder before them where two files have one name."""
    often = Counter(path.name for path in paths)
    return [path.name if often[path.name] == 1 else path.as_posix() for path in paths]


def _open(named: tuple[str, Path]) -> Frame:
    name, path = named
    try:
        pixels = read_picture(path).pixels
    except InputError as error:
        reason = str(error).removeprefix(f"{path}: ")
        return Frame(name, str(path), (0, 0), _nothing, reason=reason)
    height, width = pixels.shape[:2]
    return Frame(name, str(path), (width, height), lambda: read_picture(path).pixels, sha256_of(path))


def _nothing() -> Any:
    raise InputError("a frame that could not be read was asked for its pixels")


def _usual_size(frames: Sequence[Frame]) -> tuple[int, int]:
    sizes = Counter(frame.size for frame in frames if not frame.reason)
    return sizes.most_common(1)[0][0] if sizes else (0, 0)


def _refuse(frames: Sequence[Frame]) -> None:
    reasons = [f"{frame.id}: {frame.reason}" for frame in frames if frame.reason]
    usable = len(frames) - len(reasons)
    message = f"a mosaic needs at least two frames, and {usable} of the {len(frames)} given can be used"
    if reasons:
        message += f" ({'; '.join(reasons[:3])}{' ...' if len(reasons) > 3 else ''})"
    raise InputError(message)
