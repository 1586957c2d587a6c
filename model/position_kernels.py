"""The compiled loop from a target whose rays are separable straight to positions in a fisheye picture."""

from __future__ import annotations

import numpy as np

from fullsphere.model.kernels import compiled

_CHUNK = 256


@compiled
def grid_to_lens(
    across: np.ndarray,
    along: np.ndarray,
    rows: np.ndarray,
    turn: np.ndarray,
    pairs: np.ndarray,
    z_min: float,
    lens: np.ndarray,
    bounds: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> int:
    """Positions in a lens's picture of the rays (horizontal x, vertical, horizontal z) of a rectangle.

    Parameters
    ----------
    across, along, rows
        (w,) x and (w,) z of the columns, in C order; (h, 2) horizontal and vertical of each row.
    turn
        (3, 3) rotation into the camera frame.
    pairs
        (2 m,) of g(z) = r(theta)/sin(theta) over z from `z_min` to 1: in each cell the value at its start and what it
        grows by, so that one load brings both.
    lens
        Centre u, centre v, aspect.
    bounds
        Least u, least v, greatest u, greatest v of the picture.
    u, v
        (h, w) are written; NaN outside the picture.  Their type is that of all the reckoning.

    Returns
    -------
    How many positions are inside.
    """
    kind = u.dtype.type
    cells = pairs.shape[0] // 2
    per_z = kind(cells) / (kind(1) - kind(z_min))
    least, last = kind(z_min), np.int32(cells - 1)
    cu, cv, aspect = kind(lens[0]), kind(lens[1]), kind(lens[2])
    u0, v0, u1, v1 = kind(bounds[0]), kind(bounds[1]), kind(bounds[2]), kind(bounds[3])
    nothing = kind(np.nan)
    width = across.shape[0]
    cell = np.empty(_CHUNK, np.uint32)
    part = np.empty(3 * _CHUNK, u.dtype)  # x, y and the place in the cell
    read = np.empty(2 * _CHUNK, u.dtype)
    inside = 0
    for j in range(rows.shape[0]):
        horizontal, vertical = rows[j, 0], rows[j, 1]
        xx, x1, xz = kind(horizontal * turn[0, 0]), kind(vertical * turn[0, 1]), kind(horizontal * turn[0, 2])
        yx, y1, yz = kind(horizontal * turn[1, 0]), kind(vertical * turn[1, 1]), kind(horizontal * turn[1, 2])
        zx, z1, zz = kind(horizontal * turn[2, 0]), kind(vertical * turn[2, 1]), kind(horizontal * turn[2, 2])
        for start in range(0, width, _CHUNK):
            count = min(_CHUNK, width - start)
            to_right, ahead = across[start : start + count], along[start : start + count]
            to_u, to_v = u[j, start : start + count], v[j, start : start + count]
            seen = 0
            for k in range(count):
                a, b = to_right[k], ahead[k]
                z = zx * a + zz * b + z1
                at = (z - least) * per_z
                reached = at >= kind(0)
                seen += np.int32(reached)
                whole = min(np.int32(at), last)
                cell[k] = np.uint32(whole) if reached else np.uint32(0)
                part[2 * _CHUNK + k] = at - kind(whole) if reached else nothing
            if seen == 0:
                for k in range(count):
                    to_u[k] = nothing
                for k in range(count):
                    to_v[k] = nothing
                continue
            for k in range(count):
                i = cell[k]
                read[k] = pairs[i + i]
                read[_CHUNK + k] = pairs[i + i + np.uint32(1)]
            found = 0
            for k in range(count):
                a, b = to_right[k], ahead[k]
                g = read[k] + part[2 * _CHUNK + k] * read[_CHUNK + k]
                p = g * (xx * a + xz * b + x1) + cu
                q = aspect * g * (yx * a + yz * b + y1) + cv
                within = (p >= u0) & (p <= u1) & (q >= v0) & (q <= v1)
                found += np.int32(within)
                to_u[k] = p if within else nothing
                to_v[k] = q if within else nothing
            inside += found
    return inside


@compiled
def split_inside(pixels: np.ndarray, offset: float, bounds: np.ndarray, u: np.ndarray, v: np.ndarray) -> int:
    """Positions (h, w, 2) moved by `offset` as u and v (h, w), NaN outside `bounds`; answers how many are inside."""
    nothing = u.dtype.type(np.nan)
    inside = 0
    for j in range(u.shape[0]):
        for i in range(u.shape[1]):
            p, q = pixels[j, i, 0] + offset, pixels[j, i, 1] + offset
            within = (p >= bounds[0]) & (p <= bounds[2]) & (q >= bounds[1]) & (q <= bounds[3])
            inside += np.int32(within)
            u[j, i] = p if within else nothing
            v[j, i] = q if within else nothing
    return inside
