"""Surfaces whose rays are separable: longitude across, a function of latitude down.

A ray is (horizontal x, vertical, horizontal z), where (x, z) = (sin lon, cos lon) belongs to the column and
(horizontal, vertical) to the row.  `project` answers positions outside the picture too, half a turn to either side of
its middle column; a picture that goes round the whole circle answers u in [-0.5, W - 0.5).  `unproject` and
`window_rays` follow the sphere past the border, so that a tile with a halo needs no special case.
"""

from __future__ import annotations

import abc
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import surface_kernels as kernels
from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray

Range = tuple[float, float]
"""From and to, in radians: longitudes left and right, latitudes bottom and top."""

ROUNDING = 1e-12
"""Radians that an angle is off which went through degrees."""


class SeparableSurface(abc.ABC):
    """What the surfaces of `surface.py` have in common; a FastProjection.

    A row counts the `height` of a direction over the horizon: a function of latitude that each surface names.
    """

    size: tuple[int, int]
    _counts: ClassVar[int] = kernels.LATITUDE

    @property
    @abc.abstractmethod
    def longitudes(self) -> Range:
        """Longitudes of the picture's left and right border, radians."""

    @property
    @abc.abstractmethod
    def heights(self) -> Range:
        """Heights of the picture's lower and upper border, in the surface's own measure."""

    @abc.abstractmethod
    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The horizontal and the vertical (down) part of unit rays at heights."""

    @property
    def wraps(self) -> bool:
        """Whether the right border is the left one: the picture goes round the whole circle."""
        left, right = self.longitudes
        return right - left >= 2 * math.pi - ROUNDING

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Rays (..., 3) of any length -> pixels (..., 2) of `dtype`; NaN for no direction, and where rows never end.

        `rotation` (3, 3) takes the rays into the surface's frame first, in the same pass.  Errors are at most 1e-10
        px in a picture 32768 px wide; in float32 7e-4 px in one of 8192 px, for rays 1e-15 to 1e15 long.
        """
        given = contiguous_rays(rays)
        pixels: NDArray[Any] = np.empty((*given.shape[:-1], 2), dtype)
        (left, right), (bottom, top), (width, height) = self.longitudes, self.heights, self.size
        border = width - 0.5
        columns = [
            width / 2 - 0.5,
            width / (right - left),
            *((-0.5, border) if self.wraps else (-np.inf, np.inf)),
            width,
        ]
        per_unit = height / (top - bottom)
        kernels.project_rows(
            given.reshape(-1, 3),
            _turn_to_front((left + right) / 2) @ checked_rotation(rotation),
            self._counts,
            np.array(columns, dtype),
            np.array([height / 2 - 0.5 + (bottom + top) / 2 * per_unit, per_unit], dtype),
            pixels.reshape(-1, 2),
        )
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3); NaN for what is no pixel."""
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        with np.errstate(invalid="ignore"):
            lon = self._longitude(u)
            x, z = np.sin(lon), np.cos(lon)
            horizontal, vertical = self._profile(self._height(v))
        return np.stack([horizontal * x, np.where(np.isnan(x), np.nan, vertical), horizontal * z], -1)

    def column_directions(self, columns: slice) -> FloatArray:
        """(x, z) = (sin lon, cos lon) of whole columns, (w, 2)."""
        lon = self._longitude(np.arange(columns.start, columns.stop, dtype=float))
        return np.stack([np.sin(lon), np.cos(lon)], -1)

    def row_profile(self, rows: slice) -> FloatArray:
        """(horizontal, vertical) of whole rows, (h, 2); vertical is down."""
        return np.stack(self._profile(self._height(np.arange(rows.start, rows.stop, dtype=float))), -1)

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (rows, columns, 3) of `dtype` of a rectangle of whole pixels."""
        directions, profile = self.column_directions(columns), self.row_profile(rows)
        rays: NDArray[Any] = np.empty((len(profile), len(directions), 3), dtype)
        kernels.window_of_rows(directions, profile, rays)
        return rays

    def _longitude(self, u: FloatArray) -> FloatArray:
        left, right = self.longitudes
        return (left + right) / 2 + ((u + 0.5) / self.size[0] - 0.5) * (right - left)

    def _height(self, v: FloatArray) -> FloatArray:
        bottom, top = self.heights
        return (bottom + top) / 2 + (0.5 - (v + 0.5) / self.size[1]) * (top - bottom)


def contiguous_rays(rays: ArrayLike) -> NDArray[Any]:
    """Rays as kernels want them: in C order, float32 kept, everything else float64."""
    given = np.asarray(rays)
    return np.ascontiguousarray(given, np.float32 if given.dtype == np.float32 else np.float64)


def checked_rotation(rotation: ArrayLike | None) -> FloatArray:
    """A rotation (3, 3), by default none; UsageError if it is not finite."""
    if rotation is None:
        return np.eye(3)
    turn = np.ascontiguousarray(rotation, np.float64)
    if turn.shape != (3, 3) or not np.isfinite(turn).all():
        raise UsageError("a rotation is 3 x 3 finite numbers")
    return turn


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height as whole numbers; UsageError if they are none of a picture."""
    if not all(1 <= side <= MAX_SIDE_PX and side == int(side) for side in size):
        raise UsageError(f"a picture of {size[0]} x {size[1]}: a side is a whole number of pixels, 1 to {MAX_SIDE_PX}")
    return int(size[0]), int(size[1])


def _turn_to_front(longitude: float) -> FloatArray:
    """The rotation (3, 3) that takes the horizontal direction of a longitude to z."""
    sine, cosine = math.sin(longitude), math.cos(longitude)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
