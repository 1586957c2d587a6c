"""A grid of pixels over a picture, and how much of the sphere each looks at."""

from __future__ import annotations

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray


def pixel_grid(size: tuple[int, int], across: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Columns u (W,), rows v (H,) and pixels (H, W, 2), from edge to edge; `across` of them along the longer side."""
    width, height = size
    step = max(size) / across
    u = np.linspace(0, width - 1, max(2, round(width / step)))
    v = np.linspace(0, height - 1, max(2, round(height / step)))
    return u, v, np.stack(np.meshgrid(u, v), -1)


def solid_angles(camera: Camera, rays: FloatArray) -> FloatArray:
    """Solid angle (n,) of a pixel at unit rays (n, 3) inside the field: sin(theta)/(r r' aspect) steradians."""
    across = np.hypot(rays[:, 0], rays[:, 1])
    theta = np.arctan2(across, rays[:, 2])
    slope = camera.lens.slope(theta)
    with np.errstate(invalid="ignore", divide="ignore"):
        tangential = np.where(across > 1e-9, across / camera.lens.radius(theta), 1 / slope)
    return np.asarray(tangential / slope / camera.aspect)
