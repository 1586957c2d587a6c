"""How a budget of memory is shared out: tiles and bands take what the width asks for, frames what is left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from fullsphere.model.errors import ResourceError
from fullsphere.mosaic.overview import working_sphere
from fullsphere.mosaic.project import Mosaic

USUAL_BYTES = 2 * 10**9
"""What a panorama may take if nothing else is said."""

_PROGRAM_BYTES = 380 * 10**6  # Python, the libraries and the compiled kernels, without any picture
_PER_PLACE = 80  # bytes for a pixel of the working sphere, of each frame, while it is decided who owns what
_BANDS = 4  # of the panorama: one that is written, those that are computed ahead, and what an encoder makes of them
_PER_TILE_PX = 150  # bytes for a pixel of a tile that is computed
_WHILE_OPENED = 4  # copies of a frame: decoded, in its colour space, with its border
_OF_LIGHT = 3  # times as large is a frame that is merged of brackets
_TILES = (256, 128)  # larger ones are no quicker, and the last band is written when nothing else is left to do
_MOST_IN_BANDS = 1 << 27  # wider panoramas are made in lower bands


class Room(NamedTuple):
    """What `compose` is told: memory for frames that are kept, and the side of the tiles."""

    frame_bytes: int
    tile_px: int


def shared_out(
    memory: int, mosaic: Mosaic, size: tuple[int, int], dtype: DTypeLike, threads: int, name: str = "the panorama"
) -> Room:
    """Share `memory` bytes out for a panorama of (width, height) pixels of four samples.

    Raises
    ------
    ResourceError
        If they are not enough; says the least that is needed, of `name`.
    """
    frames = mosaic.registered
    pixels = [frame.size[0] * frame.size[1] * (_OF_LIGHT if frame.brackets else 1) for frame in frames]
    sphere = working_sphere(mosaic).size
    planning = len(frames) * sphere[0] * sphere[1] * _PER_PLACE
    opened = max(pixels) * 4 * _WHILE_OPENED * min(threads, len(frames))
    row = size[0] * 4 * np.dtype(dtype).itemsize

    def needed(tile: int) -> int:
        return _PROGRAM_BYTES + max(planning, _BANDS * tile * row + threads * tile * tile * _PER_TILE_PX) + opened

    least = needed(_TILES[-1])
    if memory < least:
        raise ResourceError(
            f"{name}: --memory {_in_mb(memory)} is too little for {len(frames)} frames and {size[0]} x {size[1]} "
            f"pixels; give it at least {_in_mb(least)}, or choose a smaller size or fewer threads"
        )
    fitting = [tile for tile in _TILES if needed(tile) <= memory // 2 and _BANDS * tile * row <= _MOST_IN_BANDS]
    tile = fitting[0] if fitting else _TILES[-1]
    return Room(max(memory - needed(tile), 0), tile)


def _in_mb(count: int) -> str:
    return f"{-(-count // 10**6)}MB"
