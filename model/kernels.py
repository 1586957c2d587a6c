"""Every compiled ray <-> pixel loop.

A kernel reads tables, never a lens: cubic pieces in Horner form, `pieces[i] = (p0, p1, p2, p3)`, so that the value in
cell i at t in [0, 1] is ((p3 t + p2) t + p1) t + p0.  One kernel therefore serves every lens at the same speed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba
import numpy as np

_F = TypeVar("_F", bound=Callable[..., object])


def compiled(function: _F) -> _F:
    """Compile a kernel on first use.

    nogil: kernels are serial and driven by our own threads (numba's workqueue layer aborts when entered from
    several).  error_model numpy: a division by zero gives inf or NaN, as in the NumPy twin of the tests.  No
    fastmath: NaN means "outside" and must survive, and without re-association the bytes do not depend on how a
    picture was cut into tiles.  The cache saves seconds at start-up; where no folder for it can be written numba
    raises at import, and the kernel is compiled anew in every process instead.
    """
    try:
        return cast(_F, numba.njit(function, nogil=True, error_model="numpy", cache=True))
    except RuntimeError:
        return cast(_F, numba.njit(function, nogil=True, error_model="numpy"))


@compiled
def project_rays(
    rays: np.ndarray,
    rotation: np.ndarray,
    pieces: np.ndarray,
    z_min: float,
    centre_u: float,
    centre_v: float,
    aspect: float,
    pixels: np.ndarray,
) -> None:
    """u = centre_u + g(z) x, v = centre_v + aspect g(z) y for (x, y, z) = rotation @ ray; NaN where z < z_min.

    rays (n, 3) unit, pieces (m, 4) of g over [z_min, 1], pixels (n, 2) is written in its own type.
    """
    cells = pieces.shape[0]
    per_z = cells / (1.0 - z_min)
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for k in range(rays.shape[0]):
        a, b, c = rays[k, 0], rays[k, 1], rays[k, 2]
        z = r20 * a + r21 * b + r22 * c
        if z >= z_min:
            at = (z - z_min) * per_z
            cell = min(int(at), cells - 1)
            t = at - cell
            g = ((pieces[cell, 3] * t + pieces[cell, 2]) * t + pieces[cell, 1]) * t + pieces[cell, 0]
            pixels[k, 0] = centre_u + g * (r00 * a + r01 * b + r02 * c)
            pixels[k, 1] = centre_v + aspect * g * (r10 * a + r11 * b + r12 * c)
        else:
            pixels[k, 0] = np.nan
            pixels[k, 1] = np.nan


@compiled
def unproject_pixels(
    pixels: np.ndarray,
    pieces_s: np.ndarray,
    pieces_c: np.ndarray,
    q_max: float,
    centre_u: float,
    centre_v: float,
    aspect: float,
    rays: np.ndarray,
) -> None:
    """ray = (s(q) x, s(q) y, c(q)) with x = u - centre_u, y = (v - centre_v)/aspect, q = x^2 + y^2; NaN past q_max.

    pixels (n, 2), pieces (m, 4) of s = sin(theta)/r and c = cos(theta) over q in [0, q_max], rays (n, 3) is written.
    """
    cells = pieces_s.shape[0]
    per_q = cells / q_max
    for k in range(pixels.shape[0]):
        x = pixels[k, 0] - centre_u
        y = (pixels[k, 1] - centre_v) / aspect
        q = x * x + y * y
        if q <= q_max:
            at = q * per_q
            cell = min(int(at), cells - 1)
            t = at - cell
            s = ((pieces_s[cell, 3] * t + pieces_s[cell, 2]) * t + pieces_s[cell, 1]) * t + pieces_s[cell, 0]
            rays[k, 0] = s * x
            rays[k, 1] = s * y
            rays[k, 2] = ((pieces_c[cell, 3] * t + pieces_c[cell, 2]) * t + pieces_c[cell, 1]) * t + pieces_c[cell, 0]
        else:
            rays[k, 0] = np.nan
            rays[k, 1] = np.nan
            rays[k, 2] = np.nan
