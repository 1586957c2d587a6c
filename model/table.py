"""A camera tabulated: the forward table and the inverse lookup tables, with their measured error.

Of a radially symmetric lens only three functions of one variable are needed, each smooth through theta = 0 and 90
degrees, so that a pixel costs neither arctangent nor square root:

    forward   ray (x, y, z):           g(z) = r(theta)/sin(theta), z = cos(theta);   u = u0 + g x, v = v0 + aspect g y
    inverse   q = x'^2 + y'^2 = r^2:   s(q) = sin(theta)/r, c(q) = cos(theta);       ray = (s x', s y', c)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from fullsphere.model import kernels
from fullsphere.model.camera import Camera
from fullsphere.model.errors import ResourceError
from fullsphere.model.lens import FloatArray, angle_of_radius

_MIN_CELLS, _MAX_CELLS = 256, 65536
_ON_AXIS = 1e-7  # radians: below it r/sin(theta) is r'(0) to the last bit


@dataclasses.dataclass(frozen=True)
class RayTable:
    """The fast twin of a Camera; made by `tabulate`.

    `error_px` is the largest difference from the exact camera that was measured, in pixels, of `project` and of
    `unproject` followed by the exact `project`.  Rays out of `unproject` are unit to the same accuracy.
    """

    camera: Camera
    error_px: float
    forward: FloatArray = dataclasses.field(repr=False)
    inverse_s: FloatArray = dataclasses.field(repr=False)
    inverse_c: FloatArray = dataclasses.field(repr=False)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        return self.camera.size

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (..., 3) -> pixels (..., 2) of `dtype`, NaN outside the field of view.

        `rotation` (3, 3) takes the rays into the camera frame first, in the same pass.
        """
        given = np.ascontiguousarray(rays, np.float64)
        pixels = np.empty((*given.shape[:-1], 2), dtype)
        turn = np.eye(3) if rotation is None else np.ascontiguousarray(rotation, np.float64)
        kernels.project_rays(
            given.reshape(-1, 3),
            turn,
            self.forward,
            math.cos(self.camera.half_fov),
            *self.camera.centre,
            self.camera.aspect,
            pixels.reshape(-1, 2),
        )
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3), NaN outside the field of view."""
        given = np.ascontiguousarray(pixels, np.float64)
        rays = np.empty((*given.shape[:-1], 3))
        q_max = self.camera.image_radius**2
        kernels.unproject_pixels(
            given.reshape(-1, 2),
            self.inverse_s,
            self.inverse_c,
            q_max,
            *self.camera.centre,
            self.camera.aspect,
            rays.reshape(-1, 3),
        )
        return rays


def tabulate(camera: Camera, tolerance_px: float = 1e-6) -> RayTable:
    """Tabulate a camera, refining until the measured error is within `tolerance_px`.

    Raises
    ------
    ResourceError
        If 65536 cells do not reach the tolerance (an orthographic lens seen to 90 degrees, say); the message says
        what was reached.
    """
    forward, forward_error = _refine(
        lambda cells: _forward_pieces(camera, cells), lambda table: _forward_error(camera, table), tolerance_px
    )
    inverse, inverse_error = _refine(
        lambda cells: _inverse_pieces(camera, cells), lambda table: _inverse_error(camera, table), tolerance_px
    )
    return RayTable(camera, max(forward_error, inverse_error), forward, inverse[:, :4].copy(), inverse[:, 4:].copy())


def _refine(
    build: Callable[[int], FloatArray], measure: Callable[[FloatArray], float], tolerance_px: float
) -> tuple[FloatArray, float]:
    """The coarsest table, doubling its cells, whose measured error is within the tolerance."""
    cells, reached = _MIN_CELLS, math.inf
    while cells <= _MAX_CELLS:
        table = build(cells)
        reached = measure(table)
        if reached <= tolerance_px:
            return table, reached
        cells *= 2
    raise ResourceError(
        f"the lens cannot be tabulated to {tolerance_px:g} px: {_MAX_CELLS} cells reach {reached:.3g} px; "
        "state a smaller field of view or a larger tolerance"
    )


def _pieces(x: FloatArray, y: FloatArray) -> FloatArray:
    """The cubic spline through (x, y), uniform x, as Horner rows over t in [0, 1] of each cell: (cells, 4)."""
    step = (x[-1] - x[0]) / (x.size - 1)
    return np.ascontiguousarray(CubicSpline(x, y).c[::-1].T * step ** np.arange(4))


def _radius_over_sine(camera: Camera, theta: FloatArray) -> FloatArray:
    safe = np.maximum(theta, _ON_AXIS)
    return np.where(theta > _ON_AXIS, camera.lens.radius(safe) / np.sin(safe), camera.lens.slope(0.0))


def _forward_pieces(camera: Camera, cells: int) -> FloatArray:
    z = np.linspace(math.cos(camera.half_fov), 1.0, cells + 1)
    theta = np.arccos(np.clip(z, -1.0, 1.0))
    theta[0] = camera.half_fov
    return _pieces(z, _radius_over_sine(camera, theta))


def _inverse_pieces(camera: Camera, cells: int) -> FloatArray:
    q = np.linspace(0.0, camera.image_radius**2, cells + 1)
    theta = angle_of_radius(camera.lens, np.sqrt(q), camera.half_fov)
    return np.hstack([_pieces(q, 1 / _radius_over_sine(camera, theta)), _pieces(q, np.cos(theta))])


def _probes(cells: int) -> FloatArray:
    """Positions in [0, 1] where a spline over `cells` cells is furthest from its nodes, and some that are not."""
    inner = (np.arange(cells)[:, None] + [0.21, 0.5, 0.79]).ravel() / cells
    return np.concatenate([inner, [0.0, 1.0]])


def _evaluate(pieces: FloatArray, at: FloatArray) -> FloatArray:
    cells = pieces.shape[0]
    cell = np.minimum((at * cells).astype(int), cells - 1)
    p0, p1, p2, p3 = pieces[cell].T
    t = at * cells - cell
    value: FloatArray = ((p3 * t + p2) * t + p1) * t + p0
    return value


def _forward_error(camera: Camera, pieces: FloatArray) -> float:
    z_min = math.cos(camera.half_fov)
    at = _probes(pieces.shape[0])
    theta = np.arccos(np.clip(z_min + at * (1 - z_min), -1.0, 1.0))
    exact = _radius_over_sine(camera, theta)
    return float(np.max(np.abs(_evaluate(pieces, at) - exact) * np.sin(theta)) * max(1.0, camera.aspect))


def _inverse_error(camera: Camera, pieces: FloatArray) -> float:
    at = _probes(pieces.shape[0])
    r = camera.image_radius * np.sqrt(at)
    exact = angle_of_radius(camera.lens, r, camera.half_fov)
    theta = np.arctan2(_evaluate(pieces[:, :4], at) * r, _evaluate(pieces[:, 4:], at))
    by_angle = np.abs(theta - exact) * camera.lens.slope(exact)
    return float(np.max(by_angle) * max(1.0, camera.aspect))
