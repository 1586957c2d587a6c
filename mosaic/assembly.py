"""Frames of a turning arm -> the 360 x 360 mosaic: every pixel from the frames between whose angles it lies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.icc import SRGB, Profile
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import ArmTurn
from fullsphere.mosaic.turn_reader import TurnReader

COLUMNS = 64
"""As many are computed at once."""

_FURTHEST = 4  # frames on to either side that are asked where those nearer see nothing
_DENSE = math.radians(2.5)  # from frame to frame: then twice as many are averaged, and noise is less


class Columns(NamedTuple):
    """Finished columns of a mosaic from `left` on: codes (H, w, 3) and where any frame shows something (H, w)."""

    left: int
    codes: NDArray[Any]
    seen: NDArray[np.bool_]


def assemble(
    reader: TurnReader,
    gains: NDArray[np.float32],
    dtype: type[np.generic] = np.uint8,
    profile: Profile = SRGB,
    executor: Executor | None = None,
) -> Iterator[Columns]:
    """Render the mosaic of a turn, some columns at a time, from the left.

    Parameters
    ----------
    reader
        Of the frames, for the mosaic's surface.
    gains
        (n, 3) what the light of each frame is multiplied by.
    dtype, profile
        uint8 and uint16 are codes of the profile, float32 is linear light in its primaries.
    """
    assembler = _Assembler(reader, gains)
    width = reader.surface.size[0]

    def made(columns: slice) -> Columns:
        light, seen = assembler.light(columns)
        return Columns(columns.start, encoded_from_linear(light, dtype, profile), seen)

    yield from ordered_map(executor, made, (slice(x, min(x + COLUMNS, width)) for x in range(0, width, COLUMNS)))


def reach_of(turn: ArmTurn) -> int:
    """How many frames to either side of its column a pixel is made of."""
    return 2 if turn.gaps.max() < _DENSE else 1


class _Canvas(NamedTuple):
    """Columns under way: their turn angles (w,); light (H, w, 3) and weight (H, w) grow with each frame."""

    columns: slice
    angles: FloatArray
    light: NDArray[np.float32]
    weight: NDArray[np.float32]


class _Assembler:
    """A turn made ready for columns after columns; asked from several threads."""

    def __init__(self, reader: TurnReader, gains: NDArray[np.float32]) -> None:
        self._reader, self._gains = reader, gains
        self._angles, self._after = reader.turn.angles, reader.turn.gaps
        self._before = np.roll(self._after, 1)
        self._usual = reach_of(reader.turn)

    def light(self, columns: slice) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """The light (H, w, 3) of columns, and where any frame shows something (H, w)."""
        shape = self._reader.surface.size[1], columns.stop - columns.start
        light, weight = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
        canvas = _Canvas(columns, self._reader.angles(columns), light, weight)
        for reach in range(self._usual, _FURTHEST + 1):
            for k, near in self._near(canvas.angles, reach):
                self._add(k, near, canvas, only_gaps=reach > self._usual)
            if weight.all():
                break
        seen = weight > 0
        np.divide(light, weight[..., None], out=light, where=seen[..., None])
        return light, seen

    def _near(self, angles: FloatArray, reach: int) -> Iterator[tuple[int, FloatArray]]:
        """Frames and how near they are (w,) to each of the angles: 1 at their own, 0 at that of `reach` frames on."""
        before = np.sum([np.roll(self._before, k) for k in range(reach)], axis=0)
        after = np.sum([np.roll(self._after, -k) for k in range(reach)], axis=0)
        for k, own in enumerate(self._angles):
            on = (angles - own + math.pi) % (2 * math.pi) - math.pi
            near = 1 - np.where(on < 0, -on / before[k], on / after[k])
            if (near > 0).any():
                yield k, near

    def _add(self, k: int, near: FloatArray, canvas: _Canvas, only_gaps: bool) -> None:
        """Bring a frame into the columns that it is near to; or only where nothing is yet."""
        some = np.flatnonzero(near > 0)
        here = slice(int(some[0]), int(some[-1]) + 1)
        light, weight = canvas.light[:, here], canvas.weight[:, here]
        if only_gaps and weight.all():
            return
        found = self._reader.read(k, slice(canvas.columns.start + here.start, canvas.columns.start + here.stop))
        much = found.worth * np.maximum(near[here], 0).astype(np.float32)
        if only_gaps:
            much[weight > 0] = 0
        light += found.light * (much[..., None] * self._gains[k])
        weight += much
