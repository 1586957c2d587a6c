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
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.stitch import evened_out
from fullsphere.mosaic.store_frames import checked_pixels


def pictures_of(mosaic: Mosaic) -> list[str]:
    """The files of the registered frames in their order, each once: two circles may share one."""
    return list(dict.fromkeys(frame.image for frame in mosaic.registered))


def with_pictures(mosaic: Mosaic, pictures: Sequence[Path], executor: Executor | None = None) -> Mosaic:
    """The registered frames of a mosaic with the pixels of other pictures, and how those recorded the light.

    Orientations, cameras, cuts and masks stay; exposures, white balance and vignetting are measured anew.

    Parameters
    ----------
    mosaic
        The solved project.
    pictures
        One for each of `pictures_of(mosaic)`, in that order.
    executor
        Where pictures are read side by side.

    Raises
    ------
    UsageError
        If there are not as many.
    InputError
        If one cannot be read, or has another size than the one that it stands for.
    """
    replaced = pictures_of(mosaic)
    if len(pictures) != len(replaced):
        raise UsageError(
            f"{len(pictures)} pictures given for the {len(replaced)} that are registered; give one for each, in the "
            f"order {', '.join(Path(name).name for name in replaced[:4])}{' ...' if len(replaced) > 4 else ''}"
        )
    often = Counter(path.name for path in pictures)
    place = {name: k for k, name in enumerate(replaced)}

    def made(frame: Frame) -> Frame:
        path = pictures[place[frame.image]]
        name = path.name if often[path.name] == 1 else f"{place[frame.image] + 1}:{path.name}"
        return _of_picture(frame, path, name)

    frames = tuple(ordered_map(executor, made, mosaic.registered, ahead=4))
    return evened_out(dataclasses.replace(mosaic, frames=frames, links=(), quality={}, diagnosis=()), executor)


def _of_picture(frame: Frame, path: Path, name: str) -> Frame:
    """The frame with the pixels of another picture, after a look at its header."""
    with open_picture(path) as file:
        size, metadata = file.size, file.metadata
    _check_size(frame, path, size)
    part = frame.id.rpartition(":")[2] if frame.crop_px and ":" in frame.id else ""
    sha256 = sha256_of(path)
    return dataclasses.replace(
        frame,
        id=f"{name}:{part}" if part else name,
        image=str(path),
        load=functools.partial(checked_pixels, path, sha256, frame.size, frame.crop_px, frame.turned),
        sha256=sha256,
        told_ev=noted_ev(metadata),
        profile=functools.partial(picture_profile, path),
    )


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
