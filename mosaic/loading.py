"""How a frame gets its pixels from its file: the part that is its own, turned as its camera holds pictures."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError
from fullsphere.model.images import read_picture
from fullsphere.mosaic.project import Picture

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
