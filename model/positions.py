"""Where each pixel of a target stands in the picture of a source: the geometry of resampling, a rectangle at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import position_kernels as kernels
from fullsphere.model.camera import Camera, FastProjection, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray, Lens
from fullsphere.model.surface import SeparableSurface
from fullsphere.model.table import RayTable, tabulate

_TOLERANCE_PX = 2e-4  # of the table that positions in float32 are read from
_CELLS, _MOST_CELLS = 2048, 32768
_FINE_SIDE_PX = 8192  # float32 places a pixel in a longer side to less than 1/2000 px: reckoned in float64 there
_MARGIN = 1.01  # of a bound that was sampled
_ON_AXIS = 1e-7  # radians: below it r/sin(theta) is r'(0) to the last bit


class Positions(NamedTuple):
    """Positions u and v (h, w) in the source, moved by the offset asked for; NaN where the source sees nothing."""

    u: NDArray[np.floating[Any]]
    v: NDArray[np.floating[Any]]
    all_seen: bool

    @property
    def inner(self) -> Positions:
        """Without the outermost pixels."""
        u, v = (np.ascontiguousarray(part[1:-1, 1:-1]) for part in (self.u, self.v))
        return Positions(u, v, self.all_seen)


class Geometry:
    """Two projections and the rotation between them, made ready for rectangle after rectangle.

    Parameters
    ----------
    source, target
        Any projections; a Camera is tabulated.
    source_from_target
        Rotation (3, 3) of rays.
    offset
        What is added to every position: the width of a border around the source's picture.

    Raises
    ------
    UsageError
        If the rotation is not one.
    """

    def __init__(self, source: Projection, target: Projection, source_from_target: ArrayLike, offset: int) -> None:
        self.source, self.target = source, target
        self._turn = checked_rotation(source_from_target)
        self._offset = float(offset)
        width, height = source.size
        self.fine = max(width, height) > _FINE_SIDE_PX
        self._real = np.float64 if self.fine else np.float32
        self._bounds = np.array([-0.5, -0.5, width - 0.5, height - 0.5]) + self._offset
        camera = source.camera if isinstance(source, RayTable) else source
        self._pairs = None
        if isinstance(camera, Camera) and isinstance(target, SeparableSurface):
            self._pairs = _pairs(camera, self._real)
        if self._pairs is not None:
            assert isinstance(camera, Camera) and isinstance(target, SeparableSurface)
            self._z_min = math.cos(camera.half_fov)
            self._lens = np.array([camera.centre[0] + offset, camera.centre[1] + offset, camera.aspect])
            directions = target.column_directions(slice(-1, target.size[0] + 1))
            self._across, self._along = np.ascontiguousarray(directions.T, self._real)
            self._profile = target.row_profile(slice(-1, target.size[1] + 1))
        else:
            self._fast_source, self._fast_target = fast(source), fast(target)

    def positions(self, rows: slice, columns: slice) -> Positions | None:
        """Positions of a rectangle of the target, which may reach one pixel past it; None if nothing is seen."""
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        u, v = np.empty(shape, self._real), np.empty(shape, self._real)
        if self._pairs is not None:
            here = slice(columns.start + 1, columns.stop + 1)
            inside = kernels.grid_to_lens(
                self._across[here],
                self._along[here],
                self._profile[rows.start + 1 : rows.stop + 1],
                self._turn,
                self._pairs,
                self._z_min,
                self._lens,
                self._bounds,
                u,
                v,
            )
        else:
            rays = self._fast_target.window_rays(columns, rows)
            pixels = self._fast_source.project(rays, self._turn)
            inside = kernels.split_inside(pixels, self._offset, self._bounds, u, v)
        return Positions(u, v, inside == u.size) if inside else None

    @property
    def largest_step(self) -> float:
        """An upper bound of the source pixels between neighbours of the target, infinite where it is not known."""
        camera = self.source.camera if isinstance(self.source, RayTable) else self.source
        if not (isinstance(camera, Camera) and isinstance(self.target, SeparableSurface)):
            return math.inf
        return _most_pixels_per_radian(camera) * _widest_step(self.target)


def fast(projection: Projection) -> FastProjection:
    """The projection itself if it is fast, a Camera's table, or any other behind the same functions."""
    if isinstance(projection, Camera):
        return tabulate(projection, 1e-6)
    if isinstance(projection, FastProjection):
        return projection
    return _Plain(projection)


def checked_rotation(rotation: ArrayLike) -> FloatArray:
    """A rotation (3, 3) in C order; UsageError if it is none."""
    turn = np.ascontiguousarray(rotation, float)
    if turn.shape != (3, 3) or not np.isfinite(turn).all():
        raise UsageError("the rotation between two projections is a 3 x 3 matrix of finite numbers")
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0:
        raise UsageError("the rotation between two projections is not a rotation: R R^T is not 1, or it mirrors")
    return turn


class _Plain:
    """A projection that only knows points, asked as the fast ones are."""

    def __init__(self, projection: Projection) -> None:
        self._projection, self.size = projection, projection.size

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        given = np.asarray(rays, float)
        turned = given if rotation is None else given @ np.asarray(rotation, float).T
        return self._projection.project(turned).astype(dtype, copy=False)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        return self._projection.unproject(pixels)

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        u, v = np.arange(columns.start, columns.stop, dtype=float), np.arange(rows.start, rows.stop, dtype=float)
        return self._projection.unproject(np.stack(np.meshgrid(u, v), -1)).astype(dtype, copy=False)


def _pairs(camera: Camera, real: type) -> NDArray[Any] | None:
    """g(z) = r(theta)/sin(theta), read linearly over z: value and growth of each cell; None if the lens is too steep.

    The error is measured at the middle of the cells, where a parabola is furthest from its chord.
    """
    z_min = math.cos(camera.half_fov)
    cells = _CELLS
    while cells <= _MOST_CELLS:
        half_steps = _radius_over_sine(camera.lens, np.linspace(z_min, 1.0, 2 * cells + 1), camera.half_fov)
        nodes, middles = half_steps[::2], half_steps[1::2]
        middle_z = np.linspace(z_min, 1.0, 2 * cells + 1)[1::2]
        sine = np.sqrt(np.maximum(0.0, 1 - middle_z**2))
        error = np.abs((nodes[1:] + nodes[:-1]) / 2 - middles) * sine * max(1.0, camera.aspect)
        if error.max() <= _TOLERANCE_PX:
            return np.stack([nodes[:-1], np.diff(nodes)], -1).astype(real).ravel()
        cells *= 2
    return None


def _most_pixels_per_radian(camera: Camera) -> float:
    """The larger of r' and r/sin(theta), wherever it is largest."""
    theta = np.linspace(0.0, camera.half_fov, 1001)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangential = np.where(theta > _ON_AXIS, camera.lens.radius(theta) / np.sin(theta), 0.0)
    slope = camera.lens.slope(theta)
    most = float(np.max(np.where(np.isfinite(tangential), np.maximum(tangential, slope), np.inf)))
    return _MARGIN * most * max(1.0, camera.aspect)


def _widest_step(surface: SeparableSurface) -> float:
    """The largest angle between neighbours across or down, radians."""
    left, right = surface.longitudes
    horizontal, vertical = surface.row_profile(slice(0, surface.size[1])).T
    down = np.hypot(np.diff(horizontal), np.diff(vertical)).max(initial=0.0)
    return max(float(np.abs(horizontal).max()) * (right - left) / surface.size[0], float(down))


def _radius_over_sine(lens: Lens, z: FloatArray, limit: float) -> FloatArray:
    theta = np.minimum(np.arccos(np.clip(z, -1.0, 1.0)), limit)
    safe = np.maximum(theta, _ON_AXIS)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(theta > _ON_AXIS, lens.radius(safe) / np.sin(safe), lens.slope(0.0))
