"""How a camera becomes tables: cubic splines over ever more cells, until their measured error is small enough."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fullsphere.model import kernels
from fullsphere.model.camera import Camera
from fullsphere.model.errors import ResourceError
from fullsphere.model.lens import FloatArray, angle_of_radius

_MIN_CELLS, _MAX_CELLS = 256, 65536
_CACHED_CELLS = 4096  # so many are 128 KB a table: they stay in a core's own cache
_PLAIN_HALF_FOV = math.radians(120)  # beyond, 1/sin(theta) wants ever more cells, and float32 is not enough
_ON_AXIS = 1e-7  # radians: below it r/sin(theta) is r'(0) to the last bit


class Table(NamedTuple):
    """Cubic pieces (cells, 4) or (cells, 8), their measured error, and the variable over which cells lie evenly."""

    pieces: FloatArray
    error_px: float
    variable: int


def forward_table(camera: Camera, tolerance_px: float) -> Table:
    """r(theta)/sin(theta) over z = cos(theta), or r(theta)/(2 sin(theta/2)) over cos(theta/2), from the rim to 1.

    The second is for lenses that see further than 120 degrees from the axis.  Raises ResourceError.
    """
    return _refined(
        lambda cells, variable: _forward_pieces(camera, cells, variable),
        lambda pieces, variable: _forward_error(camera, pieces, variable),
        (kernels.PLAIN if camera.half_fov <= _PLAIN_HALF_FOV else kernels.HALF_ANGLE,),
        tolerance_px,
    )


def inverse_table(camera: Camera, tolerance_px: float) -> Table:
    """s = sin(theta)/r and c = cos(theta), side by side, over q in [0, image_radius^2]; raises ResourceError."""
    return _refined(
        lambda cells, variable: _inverse_pieces(camera, cells, variable),
        lambda pieces, variable: _inverse_error(camera, pieces, variable),
        (kernels.PLAIN, kernels.FROM_RIM, kernels.FROM_AXIS),
        tolerance_px,
    )


def _refined(
    build: Callable[[int, int], FloatArray],
    measure: Callable[[FloatArray, int], float],
    variables: tuple[int, ...],
    tolerance_px: float,
) -> Table:
    """The coarsest table, doubling its cells, whose measured error is within the tolerance.

    The first variable that gets there with a table that stays in cache, else the first that gets there at all.
    """
    best = math.inf
    for fewest, most in ((_MIN_CELLS, _CACHED_CELLS), (2 * _CACHED_CELLS, _MAX_CELLS)):
        for variable in variables:
            cells = fewest
            while cells <= most:
                table = build(cells, variable)
                reached = measure(table, variable)
                if reached <= tolerance_px:
                    return Table(table, reached, variable)
                best = min(best, reached)
                cells *= 2
    raise ResourceError(
        f"the lens cannot be tabulated to {tolerance_px:g} px: {_MAX_CELLS} cells reach {best:.3g} px; "
        "state a smaller field of view or a larger tolerance"
    )


def _pieces(y: FloatArray) -> FloatArray:
    """The cubic spline through values (n + 1,) at even steps, as Horner rows over t in [0, 1] of each cell (n, 4).

    Its slopes at the nodes come from a tridiagonal system; the third derivative does not jump at the second node and
    the last but one ("not a knot", de Boor 1978).
    """
    rise = np.diff(y)
    right = np.empty(y.size)
    right[0], right[-1] = (5 * rise[0] + rise[1]) / 2, (5 * rise[-1] + rise[-2]) / 2
    right[1:-1] = 3 * (rise[:-1] + rise[1:])
    slope = _slopes(right)
    first, second = slope[:-1], slope[1:]
    return np.stack([y[:-1], first, 3 * rise - 2 * first - second, first + second - 2 * rise], -1)


def _slopes(right: FloatArray) -> FloatArray:
    """Solve the spline's system: rows (1, 2), then (1, 4, 1), at last (2, 1), whose diagonals outweigh what is beside.

    Gauss' elimination without exchanges.  An import of scipy.linalg would take as long as all the rest of a start.
    """
    diagonal, above = np.full(right.size, 4.0), 2.0
    diagonal[0] = diagonal[-1] = 1.0
    slope = right.tolist()
    for k in range(1, right.size):
        factor = (2.0 if k == right.size - 1 else 1.0) / diagonal[k - 1]
        diagonal[k] -= factor * above
        slope[k] -= factor * slope[k - 1]
        above = 1.0
    slope[-1] /= diagonal[-1]
    for k in range(right.size - 2, -1, -1):
        slope[k] = (slope[k] - (2.0 if k == 0 else 1.0) * slope[k + 1]) / diagonal[k]
    return np.array(slope)


def _radius_over_sine(camera: Camera, theta: FloatArray) -> FloatArray:
    safe = np.maximum(theta, _ON_AXIS)
    return np.where(theta > _ON_AXIS, camera.lens.radius(safe) / np.sin(safe), camera.lens.slope(0.0))


def _forward_at(camera: Camera, at: FloatArray, variable: int) -> tuple[FloatArray, FloatArray]:
    """theta at positions in [0, 1] of a forward table, and what the table holds there."""
    if variable == kernels.PLAIN:
        z_min = math.cos(camera.half_fov)
        theta = np.arccos(np.clip(z_min + at * (1 - z_min), -1.0, 1.0))
    else:
        w_min = math.cos(camera.half_fov / 2)
        theta = 2 * np.arccos(np.clip(w_min + at * (1 - w_min), -1.0, 1.0))
    theta = np.where(at == 0, camera.half_fov, theta)
    if variable == kernels.PLAIN:
        return theta, _radius_over_sine(camera, theta)
    safe = np.maximum(theta, _ON_AXIS)
    over_half = camera.lens.radius(safe) / (2 * np.sin(safe / 2))
    return theta, np.where(theta > _ON_AXIS, over_half, camera.lens.slope(0.0))


def _forward_pieces(camera: Camera, cells: int, variable: int) -> FloatArray:
    at = np.linspace(0.0, 1.0, cells + 1)
    return _pieces(_forward_at(camera, at, variable)[1])


def _radius_at(camera: Camera, at: FloatArray, variable: int) -> FloatArray:
    """r at positions in [0, 1] of an inverse table; the inverse of the kernels' `_position`."""
    if variable == kernels.PLAIN:
        return camera.image_radius * np.sqrt(at)
    if variable == kernels.FROM_AXIS:
        return camera.image_radius * at
    return camera.image_radius * np.sqrt(at * (2 - at))


def _inverse_pieces(camera: Camera, cells: int, variable: int) -> FloatArray:
    at = np.linspace(0.0, 1.0, cells + 1)
    theta = angle_of_radius(camera.lens, _radius_at(camera, at, variable), camera.half_fov)
    return np.hstack([_pieces(1 / _radius_over_sine(camera, theta)), _pieces(np.cos(theta))])


def _probes(cells: int) -> FloatArray:
    """Positions in [0, 1] where a spline over `cells` cells is furthest from its nodes, and some that are not.

    The outermost cells, where a spline is bent otherwise than inside, get more of them.
    """
    inner = (np.arange(cells)[:, None] + [0.21, 0.5, 0.79]).ravel() / cells
    ends = np.arange(1, 64) / (16 * cells)
    return np.concatenate([inner, ends, 1 - ends, [0.0, 1.0]])


def _evaluate(pieces: FloatArray, at: FloatArray) -> FloatArray:
    cells = pieces.shape[0]
    cell = np.minimum((at * cells).astype(int), cells - 1)
    p0, p1, p2, p3 = pieces[cell].T
    t = at * cells - cell
    value: FloatArray = ((p3 * t + p2) * t + p1) * t + p0
    return value


def _forward_error(camera: Camera, pieces: FloatArray, variable: int) -> float:
    at = _probes(pieces.shape[0])
    theta, exact = _forward_at(camera, at, variable)
    lever = np.sin(theta) if variable == kernels.PLAIN else 2 * np.sin(theta / 2)
    return float(np.max(np.abs(_evaluate(pieces, at) - exact) * lever) * max(1.0, camera.aspect))


def _inverse_error(camera: Camera, pieces: FloatArray, variable: int) -> float:
    at = _probes(pieces.shape[0])
    r = _radius_at(camera, at, variable)
    exact = angle_of_radius(camera.lens, r, camera.half_fov)
    theta = np.arctan2(_evaluate(pieces[:, :4], at) * r, _evaluate(pieces[:, 4:], at))
    by_angle = np.abs(theta - exact) * camera.lens.slope(exact)
    return float(np.max(by_angle) * max(1.0, camera.aspect))
