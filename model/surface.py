"""Projections that are no lens."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True)
class Equirectangular:
    """The whole sphere, longitude across and latitude down.

    lon = ((u + 0.5)/W - 0.5) 2 pi to the right, lat = (0.5 - (v + 0.5)/H) pi up,
    ray = (cos lat sin lon, -sin lat, cos lat cos lon): the picture's centre looks along +z.

    `unproject` follows the sphere past the picture's border (longitude goes on, latitude comes down on the other side
    of the pole), so that a tile with a halo needs no special case.
    """

    size: tuple[int, int]

    def __post_init__(self) -> None:
        width, height = self.size
        if width != 2 * height or not 2 <= width <= MAX_SIDE_PX:
            raise UsageError(
                f"a full equirectangular picture is twice as wide as high and 2 to {MAX_SIDE_PX} px wide, "
                f"not {width} x {height}"
            )

    def project(self, rays: ArrayLike) -> FloatArray:
        """Rays (..., 3) -> pixels (..., 2), u in [-0.5, W - 0.5); NaN for no direction."""
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        width, height = self.size
        u = (np.arctan2(x, z) / (2 * math.pi) + 0.5) * width - 0.5
        v = (0.5 + np.arctan2(y, np.hypot(x, z)) / math.pi) * height - 0.5
        u = np.where(u >= width - 0.5, u - width, u)  # longitude +180 and -180 are one column
        direction = np.abs(x) + np.abs(y) + np.abs(z) > 0  # False for NaN too
        return np.where(direction[..., None], np.stack([u, v], -1), np.nan)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3)."""
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        return self._rays(u, v)

    def window_rays(self, columns: slice, rows: slice) -> FloatArray:
        """Unit rays (rows, columns, 3) of a rectangle of whole pixels."""
        return self._rays(
            np.arange(columns.start, columns.stop, dtype=float)[None, :],
            np.arange(rows.start, rows.stop, dtype=float)[:, None],
        )

    def _rays(self, u: FloatArray, v: FloatArray) -> FloatArray:
        width, height = self.size
        lon = ((u + 0.5) / width - 0.5) * (2 * math.pi)
        lat = (0.5 - (v + 0.5) / height) * math.pi
        x, y, z = np.broadcast_arrays(np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon))
        return np.stack([x, y, z], -1)
