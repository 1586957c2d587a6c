"""The compiled loop that finds what a ray of a synthetic world meets."""

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
