"""The compiled loops of synthetic worlds: what a ray meets, and how ink covers a sheet."""

from __future__ import annotations

import numpy as np

from fullsphere.model.kernels import compiled

_OUTSIDE = -10.0  # texels; a NaN here would make cv2.remap answer NaN or black as it pleases


@compiled
def meet_panels(
    rays: np.ndarray,
    texel_from_ray: np.ndarray,
    sizes: np.ndarray,
    corners: np.ndarray,
    miss_u: float,
    miss_v: float,
    map_u: np.ndarray,
    map_v: np.ndarray,
) -> None:
    """Where in the atlas each ray (n, 3) meets the nearest panel: map_u, map_v (n,); outside of it for a NaN ray.

    texel_from_ray (m, 3, 3) takes a ray to (w u, w v, w), w = 1/distance in lengths of the ray; a panel is met where
    w > 0 and (u, v) is inside its sizes (m, 2) in texels.  corners (m, 2): the panel's first texel in the atlas.
    (miss_u, miss_v) is given where no panel is met.
    """
    for k in range(rays.shape[0]):
        a, b, c = rays[k, 0], rays[k, 1], rays[k, 2]
        if not (a == a and b == b and c == c):
            map_u[k] = _OUTSIDE
            map_v[k] = _OUTSIDE
            continue
        nearest, at_u, at_v = 0.0, miss_u, miss_v
        for i in range(texel_from_ray.shape[0]):
            m = texel_from_ray[i]
            w = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c
            if w > nearest:
                u = (m[0, 0] * a + m[0, 1] * b + m[0, 2] * c) / w
                v = (m[1, 0] * a + m[1, 1] * b + m[1, 2] * c) / w
                if -0.5 <= u <= sizes[i, 0] - 0.5 and -0.5 <= v <= sizes[i, 1] - 0.5:
                    nearest, at_u, at_v = w, corners[i, 0] + u, corners[i, 1] + v
        map_u[k] = at_u
        map_v[k] = at_v


@compiled
def add_outlines(vertices: np.ndarray, starts: np.ndarray, covered: np.ndarray) -> None:
    """Write polygons into a picture as signed areas: summed from left to right along its rows they are coverages.

    Polygon i has the vertices starts[i] to starts[i + 1] of `vertices` (n, 2), counted in texels of `covered`
    (h, w + 1) from the outer corner of the first; it is inside the picture and goes round clockwise in the picture's
    axes (down along its right side).  Where an edge crosses a row, the texels to its right gain the height that it
    covers there, and those that it passes through a share: the area to its right.  The coverage is exact.
    """
    height, width = covered.shape[0], covered.shape[1] - 1
    for i in range(starts.shape[0] - 1):
        for k in range(starts[i], starts[i + 1]):
            after = k + 1 if k + 1 < starts[i + 1] else starts[i]
            xa, ya, xb, yb = vertices[k, 0], vertices[k, 1], vertices[after, 0], vertices[after, 1]
            if ya == yb:
                continue
            sign = 1.0 if yb < ya else -1.0
            if yb < ya:
                xa, ya, xb, yb = xb, yb, xa, ya
            slope = (xb - xa) / (yb - ya)
            for row in range(max(0, int(np.floor(ya))), min(height, int(np.ceil(yb)))):
                top, bottom = max(ya, row), min(yb, row + 1.0)
                x0, x1 = xa + (top - ya) * slope, xa + (bottom - ya) * slope
                left, right = max(0.0, min(x0, x1)), min(float(width), max(x0, x1))
                given, part = sign * (bottom - top), 0.0  # part: of `given`, what the texels so far hold
                for column in range(min(width, int(left)), min(width, int(right)) + 1):
                    end = column + 1.0
                    if right <= end:  # the edge leaves the picture's row here: mean distance to the texel's right side
                        past = 1.0 if right == left else (right - max(left, column)) / (right - left)
                        middle = 0.5 * (max(left, column) + right)
                        here = past * (end - middle) + (1.0 - past)
                        covered[row, column] += given * (here - part)
                        if column < width:
                            covered[row, column + 1] += given * (1.0 - here)
                        break
                    past = (end - max(left, column)) / (right - left)
                    before = (max(left, column) - left) / (right - left)
                    here = past * (end - 0.5 * (max(left, column) + end)) + before
                    covered[row, column] += given * (here - part)
                    part = here


@compiled
def meet_sheet(
    x: float, y: float, z: float, a: float, b: float, c: float, radius: float, paper: np.ndarray
) -> tuple[float, float, float, bool]:
    """Where the ray (a, b, c) from (x, y, z) meets a sheet, all in the board's frame; see `Placement`.

    Returns distance in lengths of the ray (infinite where it is missed), the place (x, y) on the paper, and whether
    the paper is met from behind.  paper (4,): lower x and y, upper x and y.  Where a rolled strip is longer than the
    tube is round, its ends cover each other and the half nearer to the middle of the strip is seen of each.
    """
    if np.isinf(radius):
        far = -z / c
        u, v = x + far * a, y + far * b
        if far > 0 and paper[0] <= u <= paper[2] and paper[1] <= v <= paper[3]:
            return far, u, v, c < 0
        return np.inf, 0.0, 0.0, False
    height = z + radius  # over the tube's axis
    square, half, rest = a * a + c * c, x * a + height * c, x * x + height * height - radius * radius
    discriminant = half * half - square * rest
    if square == 0.0 or not discriminant > 0:
        return np.inf, 0.0, 0.0, False
    root = np.sqrt(discriminant)
    middle, around = 0.5 * (paper[0] + paper[2]), 2.0 * np.pi * radius
    for side in range(2):
        far = (-half + (2 * side - 1) * root) / square
        if far <= 0:
            continue
        v = y + far * b
        u = radius * np.arctan2(x + far * a, height + far * c)
        u -= around * np.floor((u - middle) / around + 0.5)
        if paper[0] <= u <= paper[2] and paper[1] <= v <= paper[3]:
            return far, u, v, side == 0
    return np.inf, 0.0, 0.0, False


@compiled
def see_sheets(
    rays: np.ndarray,
    turn: np.ndarray,
    place: np.ndarray,
    radius: np.ndarray,
    paper: np.ndarray,
    texel: np.ndarray,
    ink: np.ndarray,
    shape: np.ndarray,
    first: np.ndarray,
    tones: np.ndarray,
    lamps: np.ndarray,
    background: float,
    light: np.ndarray,
) -> None:
    """Light (n,) along each ray (n, 3), 0 for a NaN ray: the nearest sheet's reflectance under its lamp, or background.

    Of each of m sheets: turn (m, 3, 3) board from world, place (m, 3) of the eye in the board's frame, radius (m,),
    paper (m, 4) and texel (m,) mm, its picture of the ink, shape (m, 2) from first (m,) on in the flat array `ink`
    (0 none, 255 full), and its lamp (m, 5): slopes of the light, place and brightness of a pool of it, over the paper
    from -1 to 1.  tones (2,): reflectance of paper and of ink.  A sheet's back is blank.
    """
    for k in range(rays.shape[0]):
        a, b, c = rays[k, 0], rays[k, 1], rays[k, 2]
        if not (a == a and b == b and c == c):
            light[k] = 0.0
            continue
        nearest, seen, u, v, blank = np.inf, -1, 0.0, 0.0, False
        for i in range(turn.shape[0]):
            m = turn[i]
            far, at_u, at_v, behind = meet_sheet(
                place[i, 0],
                place[i, 1],
                place[i, 2],
                m[0, 0] * a + m[0, 1] * b + m[0, 2] * c,
                m[1, 0] * a + m[1, 1] * b + m[1, 2] * c,
                m[2, 0] * a + m[2, 1] * b + m[2, 2] * c,
                radius[i],
                paper[i],
            )
            if far < nearest:
                nearest, seen, u, v, blank = far, i, at_u, at_v, behind
        if seen < 0:
            light[k] = background
            continue
        height, width, start = shape[seen, 0], shape[seen, 1], first[seen]
        across = min(max((u - paper[seen, 0]) / texel[seen] - 0.5, 0.0), width - 1.0)
        down = min(max((v - paper[seen, 1]) / texel[seen] - 0.5, 0.0), height - 1.0)
        i, j = min(int(down), height - 2), min(int(across), width - 2)
        s, t = across - j, down - i
        corner = start + i * width + j
        upper = (1.0 - s) * ink[corner] + s * ink[corner + 1]
        lower = (1.0 - s) * ink[corner + width] + s * ink[corner + width + 1]
        inked = 0.0 if blank else ((1.0 - t) * upper + t * lower) / 255.0
        half_u = 0.5 * (paper[seen, 2] - paper[seen, 0])
        half_v = 0.5 * (paper[seen, 3] - paper[seen, 1])
        p, q = (u - paper[seen, 0]) / half_u - 1.0, (v - paper[seen, 1]) / half_v - 1.0
        if not np.isinf(radius[seen]):
            p = np.sin(u / radius[seen])  # the same light on both ends of the strip
        lamp = lamps[seen]
        level = 0.82 + lamp[0] * p + lamp[1] * q
        level += lamp[4] * np.exp(-((p - lamp[2]) ** 2) - (q - lamp[3]) ** 2)
        light[k] = level * (tones[0] + (tones[1] - tones[0]) * inked)
