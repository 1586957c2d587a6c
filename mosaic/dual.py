"""Dual-fisheye pictures: one file with the image circles of two lenses side by side, taken at once back to back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from fullsphere.model.circle import brightest, find_circle
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.brackets import positions_of
from fullsphere.mosaic.frames import of_one_size, read_files, refuse_if_fewer, usual_size, without_doubles
from fullsphere.mosaic.loading import Crop, cut, load_pixels, loader_of
from fullsphere.mosaic.masks import Masks, masked
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.rim import eight_bit


def open_dual_frames(
    paths: Sequence[Path],
    size: tuple[int, int] | None = None,
    executor: Executor | None = None,
    progress: Callable[..., Any] | None = None,
    *,
    masks: Masks | None = None,
    brackets: int = 1,
) -> list[Frame]:
    """Two frames for each dual-fisheye picture: camera 0 on the left or at the top, camera 1 beside or below it.

    A picture is cut in the middle of its longer side.  Its two frames are one shot, and their pixels lie as the file
    holds them: how the lenses are mounted to each other is for the registration to find.  A picture is left out, with
    the reason, if it cannot be read, doubles another one, differs in size, or does not show two image circles, as one
    does that was stitched already.

    Parameters
    ----------
    paths
        Picture files; one is enough.
    size
        Width and height of one half that the cameras ask for; without it that of most pictures' halves.
    executor
        Where files are read side by side.
    progress
        Wraps the loop over the files.
    masks
        Where the pictures' masks are, of whole pictures.
    brackets
        So many pictures at a time are taken from one position and merged (`positions_of`).

    Raises
    ------
    UsageError
        If there are not so many files times a whole number.
    InputError
        If a file does not exist, a mask cannot be used, or no picture is left; the message says why.
    """
    pictures = positions_of(read_files(paths, executor, progress), brackets, executor, progress)
    wanted = _whole(size) if size else usual_size(pictures)
    pictures = of_one_size(pictures, wanted, "the cameras are for two halves in" if size else "most pictures have")
    pictures = without_doubles(pictures)
    pictures = list(ordered_map(executor, _if_dual, pictures, ahead=4))
    refuse_if_fewer(pictures, 1, "no picture with two image circles side by side is left")
    frames = [half for picture in pictures for half in _halves(picture)]
    return frames if masks is None else masked(frames, masks, executor)


def _whole(half: tuple[int, int]) -> tuple[int, int]:
    """The size of the picture whose half is given: circles stand side by side unless a half is wider than high."""
    width, height = half
    return (2 * width, height) if width <= height else (width, 2 * height)


def _if_dual(picture: Frame) -> Frame:
    """The picture, left out if it does not show two circles.

    Night or a hand may hide one of them, so one that is seen is enough; a stitched panorama is lit into its corners.
    """
    if picture.reason:
        return picture
    crops = _crops(picture.size)
    if crops is None:
        width, height = picture.size
        return picture.left_out(f"is {width} x {height} pixels, which cannot be cut into two equal halves")
    path = Path(picture.image)
    pixels = eight_bit(load_pixels(path))
    if any(find_circle(brightest([cut(path, pixels, crop, 0)])) for crop in crops):
        return picture
    return picture.left_out("does not show two image circles side by side; is it a panorama already?")


def _crops(size: tuple[int, int]) -> tuple[Crop, Crop] | None:
    """The two halves of a picture; None if its longer side is odd or the sides are equal."""
    width, height = size
    if max(width, height) % 2 or width == height:
        return None
    if width > height:
        return (0, 0, width // 2, height), (width // 2, 0, width // 2, height)
    return (0, 0, width, height // 2), (0, height // 2, width, height // 2)


def _halves(picture: Frame) -> list[Frame]:
    """The two frames of a picture; of one that is left out both are, or they are the whole where it has no halves."""
    crops = _crops(picture.size)
    names = ("left", "right") if picture.size[0] > picture.size[1] else ("top", "bottom")
    if crops is None:
        return [picture]
    return [
        dataclasses.replace(
            picture,
            id=f"{picture.id}:{name}",
            size=crop[2:],
            load=loader_of(picture, crop),
            camera=camera,
            shot=picture.id,
            crop_px=crop,
            prior=None,
            gravity=None,
        )
        for camera, (name, crop) in enumerate(zip(names, crops, strict=True))
    ]
