"""How a frame gets its pixels from its file: the part that is its own, turned as its camera holds pictures."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import read_picture
from fullsphere.mosaic.bracket_merge import Exposed, merged_light
from fullsphere.mosaic.project import Bracket, Frame, Picture

Crop = tuple[int, int, int, int]
"""Left, top, width and height of a frame within its file, pixels."""


def loader(path: Path, crop_px: Crop | None = None, turned: int = 0) -> Callable[[], Picture]:
    """What opens a frame's picture whenever it is called, as `Frame.load` asks for; it can be sent to other processes.

    Pictures are decoded anew each time: that takes a fiftieth of the time of finding features in them, and no memory.

    Parameters
    ----------
    path
        The picture file.
    crop_px
        The part of the file that is the frame, as the file holds it; None for all of it.
    turned
        Quarter turns clockwise that the part is given then.
    """
    return functools.partial(load_pixels, path, crop_px, turned)


def loader_of(frame: Frame, crop_px: Crop | None = None, turned: int = 0) -> Callable[[], Picture]:
    """What opens a part of the picture that a frame is, whether that is a file's own or merged of brackets."""
    if not frame.brackets:
        return loader(Path(frame.image), crop_px, turned)
    return functools.partial(load_merged, frame.brackets, frame.image, frame.response_ev, crop_px, turned)


def load_merged(
    brackets: Sequence[Bracket],
    reference: str,
    response_ev: Sequence[float] = (),
    crop_px: Crop | None = None,
    turned: int = 0,
) -> Picture:
    """The light (h, w, c) of a frame that is merged of brackets, each of them read anew; see `merged_light`.

    Parameters
    ----------
    brackets
        Their files.
    reference
        The image among them that shows things where they are.
    response_ev
        The camera's tone curve, as `merged_light` takes it.
    crop_px, turned
        As `loader` takes them.

    Raises
    ------
    InputError
        If a file cannot be read, is no longer the one that it was, is of another size, or holds light instead of codes.
    """
    shape: list[tuple[int, ...]] = []

    def opened(k: int) -> Exposed:
        path = Path(brackets[k].image)
        if brackets[k].sha256 and sha256_of(path) != brackets[k].sha256:
            raise InputError(f"{path}: is not the bracket that it was, its content has changed; register anew")
        picture = read_picture(path)
        if picture.linear:
            raise InputError(f"{path}: holds light (floating point), which needs no brackets; give pictures of codes")
        codes = cut(path, picture.pixels, crop_px, turned)
        shape.append(codes.shape)
        if codes.shape != shape[0]:
            raise InputError(f"{path}: is {_spelled(codes.shape)}, another bracket {_spelled(shape[0])}; register anew")
        return Exposed(codes, picture.profile)

    names = [bracket.image for bracket in brackets]
    return merged_light([bracket.exposure_ev for bracket in brackets], names.index(reference), opened, response_ev)


def _spelled(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} pixels of {shape[2]} channels"


def load_pixels(path: Path, crop_px: Crop | None = None, turned: int = 0) -> Picture:
    """The pixels (h, w, c) of a frame; see `loader`.

    Raises
    ------
    InputError
        If the file cannot be read, or the part reaches out of it.
    """
    return cut(path, read_picture(path).pixels, crop_px, turned)


def cut(path: Path, pixels: NDArray[Any], crop_px: Crop | None, turned: int) -> NDArray[Any]:
    """The part of a picture or a mask (h, w, ...) that is a frame's, C order; `path` is named in errors."""
    if crop_px is not None:
        left, top, width, height = crop_px
        part = pixels[max(top, 0) : top + height, max(left, 0) : left + width]
        if part.shape[:2] != (height, width):
            whole = f"{pixels.shape[1]} x {pixels.shape[0]}"
            raise InputError(
                f"{path}: is {whole} pixels, and its part of {width} x {height} from ({left}, {top}) on is not in it"
            )
        pixels = part
    return np.ascontiguousarray(np.rot90(pixels, -turned))
