"""Compiled loops between unit rays and the pixels of surfaces that are no lens.

A pixel costs arctangents, so everything is written for the processor's vector units: no branches but selects, and the
work goes through short rows of numbers that lie side by side in the first cache.  Positions are computed in the
type of `pixels`, rays are turned in float64 before that.

The series are Chebyshev interpolants: of atan(t)/t over t^2 <= tan^2(22.5 degrees), absolute error 4e-16, and of
2 atanh(t)/t over t^2 <= tan^4(22.5 degrees), 1e-14.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fullsphere.model.kernels import compiled

LATITUDE, TANGENT, MERCATOR = 0, 1, 2
"""How a surface counts its rows: by the latitude, its tangent, or asinh of its tangent."""

_ROW = 512  # rays that are computed side by side: six rows of float64 stay in the first cache
_TAN_22 = math.sqrt(2) - 1
_SQRT_2 = math.sqrt(2)
_LN_2 = math.log(2)
_PI_4, _PI_2, _PI = math.pi / 4, math.pi / 2, math.pi
_EXPONENT, _NO_SIGN, _ONE = 1023, 2047, 1023 << 52
_FRACTION = (1 << 52) - 1


@compiled
def _arctangent(y: Any, x: Any, like: np.ndarray) -> Any:
    """atan2(y, x) in the type of `like`; NaN of (0, 0), and the sign of zero does not count."""
    real = like.dtype.type
    a, b = abs(y), abs(x)
    low, high = min(a, b), max(a, b)
    steep = low > real(_TAN_22) * high
    t = (low - high if steep else low) / (low + high if steep else high)
    s = t * t
    p = real(-0.02531754911139672) * s + real(0.05024846626865846)
    p = p * s + real(-0.065060109401502)
    p = p * s + real(0.07673540457056326)
    p = p * s + real(-0.09089530488531684)
    p = p * s + real(0.11111048887248477)
    p = p * s + real(-0.1428571266289279)
    p = p * s + real(0.19999999978415176)
    p = p * s + real(-0.33333333333221604)
    p = p * s + real(1.0)
    angle = p * t + (real(_PI_4) if steep else real(0.0))
    angle = real(_PI_2) - angle if a > b else angle
    angle = real(_PI) - angle if x < real(0.0) else angle
    return -angle if y < real(0.0) else angle


@compiled
def _mercator(x: np.ndarray, y: np.ndarray, z: np.ndarray, count: int) -> None:
    """y becomes asinh(y / hypot(x, z)); infinite where x and z are 0.

    It is the logarithm of e = (hypot(x, y, z) + |y|) / hypot(x, z): e = 2^n m with m from 1/sqrt(2) to sqrt(2), and
    log m = 2 atanh((m - 1)/(m + 1)).  n and m are taken out of the bits of e, from one row of numbers into others:
    where one was read and written as two types, nothing would go side by side.
    """
    e, powers, fractions = np.empty(_ROW), np.empty(_ROW), np.empty(_ROW, np.int64)
    bits, mantissas = e.view(np.int64), fractions.view(np.float64)
    for k in range(count):
        a, b, c = np.float64(x[k]), np.float64(y[k]), np.float64(z[k])
        level = a * a + c * c
        e[k] = (np.sqrt(level + b * b) + abs(b)) / np.sqrt(level)
    for k in range(count):
        powers[k] = np.float64(((bits[k] >> 52) & _NO_SIGN) - _EXPONENT)
        fractions[k] = (bits[k] & _FRACTION) | _ONE
    for k in range(count):
        m, power = mantissas[k], powers[k]
        high = m > _SQRT_2
        m = 0.5 * m if high else m
        n = power + 1.0 if high else power
        t = (m - 1.0) / (m + 1.0)
        s = t * t
        p = 0.19608096664225536 * s + 0.22174249829581194
        p = p * s + 0.28572166148075795
        p = p * s + 0.39999994891808144
        p = p * s + 0.6666666667957935
        p = p * s + 2.0
        log = n * _LN_2 + p * t if power <= _EXPONENT else np.inf
        y[k] = -log if y[k] < 0 else log


@compiled
def project_rows(
    rays: np.ndarray,
    turn: np.ndarray,
    vertical: int,
    columns: np.ndarray,
    rows: np.ndarray,
    pixels: np.ndarray,
) -> None:
    """Pixels of a surface whose columns are longitudes and whose rows are a function of latitude.

    rays (n, 3); turn (3, 3) takes them to where the middle column looks along z; columns is (middle, pixels per
    radian, left border, right border, pixels round the circle) and rows (zero, pixels per unit downwards), both in
    the type of pixels (n, 2), which is written.  From the right border on the column a circle before answers.
    """
    real = pixels.dtype.type
    middle, per_radian, left, right, circle = columns[0], columns[1], columns[2], columns[3], columns[4]
    zero, per_unit = rows[0], rows[1]
    r00, r01, r02 = turn[0, 0], turn[0, 1], turn[0, 2]
    r10, r11, r12 = turn[1, 0], turn[1, 1], turn[1, 2]
    r20, r21, r22 = turn[2, 0], turn[2, 1], turn[2, 2]
    x, y, z = np.empty(_ROW, pixels.dtype), np.empty(_ROW, pixels.dtype), np.empty(_ROW, pixels.dtype)
    u, v = np.empty(_ROW, pixels.dtype), np.empty(_ROW, pixels.dtype)
    nowhere = real(np.nan)
    for first in range(0, rays.shape[0], _ROW):
        given, answer = rays[first : first + _ROW], pixels[first : first + _ROW]
        count = given.shape[0]
        for k in range(count):
            a, b, c = given[k, 0], given[k, 1], given[k, 2]
            x[k] = r00 * a + r01 * b + r02 * c
            y[k] = r10 * a + r11 * b + r12 * c
            z[k] = r20 * a + r21 * b + r22 * c
        for k in range(count):
            upright = abs(x[k]) + abs(z[k]) == real(0.0)  # a pole is in every column: it gets the middle one
            ahead = real(1.0) if upright else z[k]
            at = max(middle + per_radian * _arctangent(x[k], ahead, pixels), left)
            u[k] = at - circle if at >= right else at
        if vertical == LATITUDE:
            for k in range(count):
                v[k] = zero + per_unit * _arctangent(y[k], np.sqrt(x[k] * x[k] + z[k] * z[k]), pixels)
        elif vertical == TANGENT:
            for k in range(count):
                v[k] = zero + per_unit * (y[k] / np.sqrt(x[k] * x[k] + z[k] * z[k]))
        else:
            _mercator(x, y, z, count)
            for k in range(count):
                v[k] = zero + per_unit * y[k]
        for k in range(count):
            known = abs(u[k]) + abs(v[k]) < real(np.inf)
            answer[k, 0] = u[k] if known else nowhere
            answer[k, 1] = v[k] if known else nowhere


@compiled
def project_cube(
    rays: np.ndarray, turn: np.ndarray, cells: np.ndarray, half: float, inset: float, pixels: np.ndarray
) -> None:
    """Pixels of a cube map: a ray belongs to the face of its longest component, and of x, y, z the first longest.

    rays (n, 3); turn (3, 3); cells (6, 3) is for the faces +x, -x, -y, +y, +z, -z the pixel in the middle and the sign
    (-1: the cell is turned by 180 degrees), in the type of pixels (n, 2), which is written; half is half a face's
    side in pixels, and no position is further than `inset`, a little less, to the right of its cell's middle or below.
    """
    real = pixels.dtype.type
    r00, r01, r02 = turn[0, 0], turn[0, 1], turn[0, 2]
    r10, r11, r12 = turn[1, 0], turn[1, 1], turn[1, 2]
    r20, r21, r22 = turn[2, 0], turn[2, 1], turn[2, 2]
    u0, u1, u2, u3, u4, u5 = cells[0, 0], cells[1, 0], cells[2, 0], cells[3, 0], cells[4, 0], cells[5, 0]
    v0, v1, v2, v3, v4, v5 = cells[0, 1], cells[1, 1], cells[2, 1], cells[3, 1], cells[4, 1], cells[5, 1]
    s0, s1, s2, s3, s4, s5 = cells[0, 2], cells[1, 2], cells[2, 2], cells[3, 2], cells[4, 2], cells[5, 2]
    reach, furthest = real(half), real(inset)
    x, y, z = np.empty(_ROW, pixels.dtype), np.empty(_ROW, pixels.dtype), np.empty(_ROW, pixels.dtype)
    for first in range(0, rays.shape[0], _ROW):
        given, answer = rays[first : first + _ROW], pixels[first : first + _ROW]
        count = given.shape[0]
        for k in range(count):
            a, b, c = given[k, 0], given[k, 1], given[k, 2]
            x[k] = r00 * a + r01 * b + r02 * c
            y[k] = r10 * a + r11 * b + r12 * c
            z[k] = r20 * a + r21 * b + r22 * c
        for k in range(count):
            a, b, c = x[k], y[k], z[k]
            along_x = abs(a) >= abs(b) and abs(a) >= abs(c)
            along_y = abs(b) >= abs(c)
            middle_u = (
                (u0 if a > 0 else u1) if along_x else ((u3 if b > 0 else u2) if along_y else (u4 if c > 0 else u5))
            )
            middle_v = (
                (v0 if a > 0 else v1) if along_x else ((v3 if b > 0 else v2) if along_y else (v4 if c > 0 else v5))
            )
            sign = (s0 if a > 0 else s1) if along_x else ((s3 if b > 0 else s2) if along_y else (s4 if c > 0 else s5))
            depth = abs(a) if along_x else (abs(b) if along_y else abs(c))
            right = (-c if a > 0 else c) if along_x else (a if along_y else (a if c > 0 else -a))
            down = b if along_x else ((-c if b > 0 else c) if along_y else b)
            scale = sign * reach / depth
            x[k] = middle_u + min(max(right * scale, -reach), furthest)
            y[k] = middle_v + min(max(down * scale, -reach), furthest)
        for k in range(count):
            answer[k, 0] = x[k]
            answer[k, 1] = y[k]


@compiled
def window_of_rows(directions: np.ndarray, profile: np.ndarray, rays: np.ndarray) -> None:
    """Ray (horizontal x, vertical, horizontal z) of all columns (x, z) and rows (horizontal, vertical).

    directions (w, 2), profile (h, 2), rays (h, w, 3) is written in its own type.
    """
    for j in range(profile.shape[0]):
        horizontal, vertical = profile[j, 0], profile[j, 1]
        for i in range(directions.shape[0]):
            rays[j, i, 0] = horizontal * directions[i, 0]
            rays[j, i, 1] = vertical
            rays[j, i, 2] = horizontal * directions[i, 1]


@compiled
def _write_cube_ray(u: float, v: float, faces: np.ndarray, side: int, pitch: int, ray: np.ndarray) -> None:
    across, down = u + 0.5, v + 0.5
    ray[0] = ray[1] = ray[2] = np.nan
    if 0 <= across < faces.shape[1] * pitch and 0 <= down < faces.shape[0] * pitch:
        i, j = int(across / pitch), int(down / pitch)
        face = faces[j, i]
        a = (across - i * pitch - 0.5 * pitch) / (0.5 * side)
        b = (down - j * pitch - 0.5 * pitch) / (0.5 * side)
        scale = 1.0 / math.sqrt(1.0 + a * a + b * b)
        ray[0] = scale * (face[0, 0] * a + face[0, 1] * b + face[0, 2])
        ray[1] = scale * (face[1, 0] * a + face[1, 1] * b + face[1, 2])
        ray[2] = scale * (face[2, 0] * a + face[2, 1] * b + face[2, 2])


@compiled
def unproject_cube(pixels: np.ndarray, faces: np.ndarray, side: int, pitch: int, rays: np.ndarray) -> None:
    """Unit rays of a cube map's pixels, NaN in cells without a face and beyond the picture.

    pixels (n, 2); faces (rows, columns, 3, 3) holds for each cell what takes (right, down, 1) to a ray, NaN where there
    is no face; side is that of a face and pitch that of a cell, in pixels; rays (n, 3) is written.
    """
    for k in range(pixels.shape[0]):
        _write_cube_ray(pixels[k, 0], pixels[k, 1], faces, side, pitch, rays[k])


@compiled
def window_of_cube(left: int, top: int, faces: np.ndarray, side: int, pitch: int, rays: np.ndarray) -> None:
    """`unproject_cube` of the whole pixels of a rectangle, rays (h, w, 3) is written in its own type."""
    height, width = rays.shape[0], rays.shape[1]
    for j in range(height):
        cell_row = (top + j) // pitch
        b = (top + j - cell_row * pitch + 0.5 - 0.5 * pitch) / (0.5 * side)
        row = rays[j]
        for cell in range(left // pitch, (left + width - 1) // pitch + 1):
            first, last = max(cell * pitch - left, 0), min((cell + 1) * pitch - left, width)
            if cell < 0 or cell >= faces.shape[1] or cell_row < 0 or cell_row >= faces.shape[0]:
                row[first:last] = np.nan
                continue
            face = faces[cell_row, cell]
            ax, ay, az = face[0, 0], face[1, 0], face[2, 0]
            x, y, z = face[0, 1] * b + face[0, 2], face[1, 1] * b + face[1, 2], face[2, 1] * b + face[2, 2]
            start = left + first - cell * pitch + 0.5 - 0.5 * pitch
            part = row[first:last]
            for i in range(part.shape[0]):
                a = (start + i) / (0.5 * side)
                scale = 1.0 / np.sqrt(1.0 + a * a + b * b)
                part[i, 0] = scale * (x + ax * a)
                part[i, 1] = scale * (y + ay * a)
                part[i, 2] = scale * (z + az * a)
