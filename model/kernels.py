"""Every compiled ray <-> pixel loop of a tabulated lens.

A kernel reads tables, never a lens: cubic pieces in Horner form, `pieces[i] = (p0, p1, p2, p3)`, so that the value in
cell i at t in [0, 1] is ((p3 t + p2) t + p1) t + p0.  One kernel therefore serves every lens at the same speed.

Loops are written so that LLVM vectorises them: `compiled_apart`, flat arrays (of which the distance from one ray to
the next is a constant), selects in place of branches, unsigned positions in a table.  A type is computed in when
all arguments, the numbers too, are of that type.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.compiler import Compiler

_F = TypeVar("_F", bound=Callable[..., object])


class _ArraysApart(Compiler):
    """numba's compiler, told that no two arrays overlap: without this LLVM may not read a table while it stores."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)  # type: ignore[no-untyped-call]
        self.state.flags.noalias = True


def compiled(function: _F) -> _F:
    """Compile a kernel on first use.

    nogil: kernels are serial and driven by our own threads (numba's workqueue layer aborts when entered from
    several).  error_model numpy: a division by zero gives inf or NaN, as in the NumPy twin of the tests.  No
    fastmath: NaN means "outside" and must survive, and without re-association the bytes do not depend on how a
    picture was cut into tiles.  The cache saves seconds at start-up; where no folder for it can be written numba
    raises at import, and the kernel is compiled anew in every process instead.
    """
    return _compiled(function)


def compiled_apart(function: _F) -> _F:
    """Compile a kernel as `compiled` does, of which no array that is written overlaps another argument.

    Only with that promise does LLVM vectorise a loop that looks values up in a table.  The bits are those of the
    scalar loop: nothing is re-associated or fused.
    """
    return _compiled(function, pipeline_class=_ArraysApart)


def _compiled(function: _F, **options: Any) -> _F:
    try:
        return cast(_F, numba.njit(function, nogil=True, error_model="numpy", cache=True, **options))
    except RuntimeError:
        return cast(_F, numba.njit(function, nogil=True, error_model="numpy", **options))


PLAIN, FROM_AXIS, FROM_RIM, HALF_ANGLE = 0, 1, 2, 3
"""The variable over which the cells of a table are equal: z or q itself, a root of q counted from the axis or from the
rim, the cosine of half the angle."""


@compiled
def _cubic(pieces: np.ndarray, cell: Any, t: Any) -> Any:
    """Value of the piece of `cell` at t."""
    p = np.uint64(np.uint32(4 * cell))
    return ((pieces[p + 3] * t + pieces[p + 2]) * t + pieces[p + 1]) * t + pieces[p]


@compiled_apart
def project_rays(
    rays: np.ndarray,
    rotation: np.ndarray,
    pieces: np.ndarray,
    z_min: float,
    z_limit: float,
    centre_u: float,
    centre_v: float,
    aspect: float,
    pixels: np.ndarray,
) -> None:
    """u = centre_u + g(z) x, v = centre_v + aspect g(z) y for (x, y, z) = rotation @ ray.

    NaN where z < z_limit, or the squared length of a ray is further from 1 than 1e-5: zero, infinite, NaN.

    rays (3 n,) unit, rotation (9,), pieces (4 m,) of g over [z_min, 1]; pixels (2 n,) is written.
    """
    real = pieces.dtype.type
    zero, one, rounding, nan = real(0.0), real(1.0), real(1e-5), real(np.nan)
    last = real(pieces.size // 4 - 1)
    per_z = real(pieces.size // 4) / (one - z_min)
    r00, r01, r02 = rotation[0], rotation[1], rotation[2]
    r10, r11, r12 = aspect * rotation[3], aspect * rotation[4], aspect * rotation[5]
    r20, r21, r22 = rotation[6], rotation[7], rotation[8]
    for k in range(np.uint64(pixels.size // 2)):
        a, b, c = rays[3 * k], rays[3 * k + 1], rays[3 * k + 2]
        z = r20 * a + r21 * b + r22 * c
        inside = (z >= z_limit) & (abs(a * a + b * b + c * c - one) <= rounding)
        at = (z - z_min) * per_z if inside else zero
        cell = np.int32(min(max(at, zero), last))
        t = at - real(cell)
        g = _cubic(pieces, cell, t)
        u = centre_u + g * (r00 * a + r01 * b + r02 * c)
        v = centre_v + g * (r10 * a + r11 * b + r12 * c)
        pixels[2 * k] = u if inside else nan
        pixels[2 * k + 1] = v if inside else nan


@compiled_apart
def project_rays_half_angle(
    rays: np.ndarray,
    rotation: np.ndarray,
    pieces: np.ndarray,
    w_min: float,
    w_limit: float,
    centre_u: float,
    centre_v: float,
    aspect: float,
    pixels: np.ndarray,
) -> None:
    """`project_rays` of a lens that sees nearly all round: u = centre_u + h(w) x/w, v = centre_v + aspect h(w) y/w.

    w = cos(theta/2), and h(w) = r(theta)/(2 sin(theta/2)) is smooth where r/sin(theta) runs away, towards 180 degrees.
    There w^2 = (1 + z)/2 would be what is left of a difference, and is taken as (x^2 + y^2)/(2 (1 - z)) instead.

    NaN where w < w_limit, straight behind, and as in `project_rays`; pieces (4 m,) of h over [w_min, 1].
    """
    real = pieces.dtype.type
    zero, half, one, rounding, nan = real(0.0), real(0.5), real(1.0), real(1e-5), real(np.nan)
    last = real(pieces.size // 4 - 1)
    per_w = real(pieces.size // 4) / (one - w_min)
    r00, r01, r02 = rotation[0], rotation[1], rotation[2]
    r10, r11, r12 = rotation[3], rotation[4], rotation[5]
    r20, r21, r22 = rotation[6], rotation[7], rotation[8]
    for k in range(np.uint64(pixels.size // 2)):
        a, b, c = rays[3 * k], rays[3 * k + 1], rays[3 * k + 2]
        x = r00 * a + r01 * b + r02 * c
        y = r10 * a + r11 * b + r12 * c
        z = r20 * a + r21 * b + r22 * c
        w = np.sqrt(half * (one + z if z > zero else (x * x + y * y) / (one - z)))
        inside = (w >= w_limit) & (w > zero) & (abs(a * a + b * b + c * c - one) <= rounding)
        at = (w - w_min) * per_w if inside else zero
        cell = np.int32(min(max(at, zero), last))
        t = at - real(cell)
        g = _cubic(pieces, cell, t) / w
        u = centre_u + g * x
        v = centre_v + g * (aspect * y)
        pixels[2 * k] = u if inside else nan
        pixels[2 * k + 1] = v if inside else nan


@compiled
def _position(share: Any, variable: int) -> Any:
    """Where in a table, 0 to 1, a share of q_max in [0, 1] stands.

    The root counted from the axis makes a curve with even powers of theta smooth there; counted from the rim it does
    so where r(theta) stops growing, and theta runs away like a root.
    """
    if variable == PLAIN:
        return share
    one = type(share)(1.0)
    if variable == FROM_AXIS:
        return np.sqrt(share)
    return one - np.sqrt(max(one - share, type(share)(0.0)))


@compiled_apart
def unproject_pixels(
    pixels: np.ndarray,
    pieces_s: np.ndarray,
    pieces_c: np.ndarray,
    variable: int,
    q_max: float,
    q_limit: float,
    centre_u: float,
    centre_v: float,
    aspect: float,
    rays: np.ndarray,
) -> None:
    """ray = (s(q) x, s(q) y, c(q)) with x = u - centre_u, y = (v - centre_v)/aspect, q = x^2 + y^2.

    NaN where q > q_limit or is NaN.

    pixels (2 n,), pieces (4 m,) of s = sin(theta)/r and c = cos(theta) over q in [0, q_max], whose cells lie as
    `variable` says; rays (3 n,) is written.
    """
    real = pieces_s.dtype.type
    zero, nan = real(0.0), real(np.nan)
    cells, last = real(pieces_s.size // 4), real(pieces_s.size // 4 - 1)
    per_q, per_aspect = real(1.0) / q_max, real(1.0) / aspect
    for k in range(np.uint64(pixels.size // 2)):
        x = pixels[2 * k] - centre_u
        y = (pixels[2 * k + 1] - centre_v) * per_aspect
        q = x * x + y * y
        inside = q <= q_limit
        at = _position(q * per_q if inside else zero, variable) * cells
        cell = np.int32(min(at, last))
        t = at - real(cell)
        s = _cubic(pieces_s, cell, t)
        z = _cubic(pieces_c, cell, t)
        rays[3 * k] = s * x if inside else nan
        rays[3 * k + 1] = s * y if inside else nan
        rays[3 * k + 2] = z if inside else nan


@compiled
def unproject_grid(
    xs: np.ndarray,
    ys: np.ndarray,
    pieces_s: np.ndarray,
    pieces_c: np.ndarray,
    variable: int,
    q_max: float,
    q_limit: float,
    rays: np.ndarray,
) -> None:
    """`unproject_pixels` of the grid of pixels at xs (w,), ys (h,) from the centre; rays (h, w, 3) is written.

    Neighbours look up the same cell: here the scalar loop is the faster one.
    """
    real = pieces_s.dtype.type
    nan = real(np.nan)
    cells, last = real(pieces_s.size // 4), real(pieces_s.size // 4 - 1)
    per_q = real(1.0) / q_max
    for row in range(ys.size):
        y = ys[row]
        for column in range(xs.size):
            x = xs[column]
            q = x * x + y * y
            if q <= q_limit:
                at = _position(q * per_q, variable) * cells
                cell = np.int32(min(at, last))
                t = at - real(cell)
                s = _cubic(pieces_s, cell, t)
                rays[row, column, 0] = s * x
                rays[row, column, 1] = s * y
                rays[row, column, 2] = _cubic(pieces_c, cell, t)
            else:
                rays[row, column, 0] = nan
                rays[row, column, 1] = nan
                rays[row, column, 2] = nan
