"""The rows of a surface from one of them on, as a surface of its own: a panorama is continued with it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import FastProjection, Projection
from fullsphere.model.lens import FloatArray
from fullsphere.model.positions import fast
from fullsphere.model.surface import Range, SeparableSurface


def lower_part(surface: Projection, top: int) -> Projection:
    """The rows from `top` on of a surface: every pixel is computed from the same numbers as that of the whole."""
    if top == 0:
        return surface
    whole = fast(surface)
    return _SeparablePart(whole, top) if isinstance(whole, SeparableSurface) else _Part(whole, top)


class _Part:
    def __init__(self, whole: FastProjection, top: int) -> None:
        self._whole, self._top = whole, top
        self.size = (whole.size[0], whole.size[1] - top)

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        pixels = self._whole.project(rays, rotation, dtype)
        pixels[..., 1] -= self._top
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        return self._whole.unproject(np.asarray(pixels, float) + np.array([0.0, self._top]))

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        return self._whole.window_rays(columns, slice(rows.start + self._top, rows.stop + self._top), dtype)


class _SeparablePart(SeparableSurface):
    def __init__(self, whole: SeparableSurface, top: int) -> None:
        self._whole, self._top = whole, top
        self.size = (whole.size[0], whole.size[1] - top)

    @property
    def longitudes(self) -> Range:
        return self._whole.longitudes

    @property
    def heights(self) -> Range:
        bottom, top = self._whole.heights
        return bottom, top - (top - bottom) * self._top / self._whole.size[1]

    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._whole._profile(height)

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        pixels = self._whole.project(rays, rotation, dtype)
        pixels[..., 1] -= self._top
        return pixels

    def row_profile(self, rows: slice) -> FloatArray:
        return self._whole.row_profile(slice(rows.start + self._top, rows.stop + self._top))
