"""A solved project applied to new pictures of the same rig in the same positions."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import noted_ev, open_picture, picture_profile
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.brackets import positions_of
from fullsphere.mosaic.frames import read_files
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.stitch import evened_out
from fullsphere.mosaic.store_frames import checked_light, checked_pixels


def pictures_of(mosaic: Mosaic) -> list[str]:
    """The files of the registered frames in their order, each once: two circles may share one."""
    return list(dict.fromkeys(frame.image for frame in mosaic.registered))


def with_pictures(
    mosaic: Mosaic, pictures: Sequence[Path], executor: Executor | None = None, brackets: int = 1
) -> Mosaic:
    """The registered frames of a mosaic with the pixels of other pictures, and how those recorded the light.

    Orientations, cameras, cuts and masks stay; exposures, white balance and vignetting are measured anew.

    Parameters
    ----------
    mosaic
        The solved project.
    pictures
        One for each of `pictures_of(mosaic)`, in that order; or so many as there are `brackets`.
    executor
        Where pictures are read side by side.
    brackets
        So many at a time are merged.

    Raises
    ------
    UsageError
        If there are not as many.
    InputError
        If one cannot be read, or has another size than the one that it stands for.
    """
    replaced = pictures_of(mosaic)
    if len(pictures) != brackets * len(replaced):
        each = "one for each" if brackets == 1 else f"{brackets} for each"
        raise UsageError(
            f"{len(pictures)} pictures given for the {len(replaced)} that are registered; give {each}, in the "
            f"order {', '.join(Path(name).name for name in replaced[:4])}{' ...' if len(replaced) > 4 else ''}"
        )
    merged = _merged(pictures, brackets, executor) if brackets > 1 else []
    images = [Path(frame.image) for frame in merged] or list(pictures)
    often = Counter(path.name for path in images)
    place = {name: k for k, name in enumerate(replaced)}

    def made(frame: Frame) -> Frame:
        k = place[frame.image]
        name = images[k].name if often[images[k].name] == 1 else f"{k + 1}:{images[k].name}"
        return _of_brackets(frame, merged[k], name) if merged else _of_picture(frame, images[k], name)

    frames = tuple(ordered_map(executor, made, mosaic.registered, ahead=4))
    return evened_out(dataclasses.replace(mosaic, frames=frames, links=(), quality={}, diagnosis=()), executor)


def _merged(pictures: Sequence[Path], brackets: int, executor: Executor | None) -> list[Frame]:
    """A frame for each so many pictures; InputError if one cannot be merged."""
    found = positions_of(read_files(pictures, executor), brackets, executor)
    for frame in found:
        if frame.reason:
            raise InputError(f"{frame.image}: {frame.reason}")
    return found


def _of_brackets(frame: Frame, merged: Frame, name: str) -> Frame:
    """The frame with the light of other brackets."""
    image = Path(merged.image)
    _check_size(frame, image, merged.size)
    return dataclasses.replace(
        frame,
        id=_named(frame, name),
        image=merged.image,
        load=functools.partial(
            checked_light, merged.brackets, image, merged.response_ev, frame.size, frame.crop_px, frame.turned
        ),
        sha256=merged.sha256,
        told_ev=merged.told_ev,
        profile=None,
        brackets=merged.brackets,
        response_ev=merged.response_ev,
    )


def _of_picture(frame: Frame, path: Path, name: str) -> Frame:
    """The frame with the pixels of another picture, after a look at its header."""
    with open_picture(path) as file:
        size, metadata = file.size, file.metadata
    _check_size(frame, path, size)
    sha256 = sha256_of(path)
    return dataclasses.replace(
        frame,
        id=_named(frame, name),
        image=str(path),
        load=functools.partial(checked_pixels, path, sha256, frame.size, frame.crop_px, frame.turned),
        sha256=sha256,
        told_ev=noted_ev(metadata),
        profile=functools.partial(picture_profile, path),
        brackets=(),
        response_ev=(),
    )


def _named(frame: Frame, name: str) -> str:
    """The new name of a frame, with the part of the picture that it is."""
    part = frame.id.rpartition(":")[2] if frame.crop_px and ":" in frame.id else ""
    return f"{name}:{part}" if part else name


def _check_size(frame: Frame, path: Path, size: tuple[int, int]) -> None:
    if frame.crop_px is None:
        wanted = frame.size if frame.turned % 2 == 0 else frame.size[::-1]
        fits, asked = size == wanted, f"{wanted[0]} x {wanted[1]} pixels"
    else:
        left, top, width, height = frame.crop_px
        fits = left + width <= size[0] and top + height <= size[1]
        asked = f"at least {left + width} x {top + height} pixels"
    if not fits:
        raise InputError(
            f"{path}: is {size[0]} x {size[1]} pixels, and what it stands for, {Path(frame.image).name}, has {asked}; "
            "give pictures of the same camera and mode"
        )
