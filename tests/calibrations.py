"""Small calibrations for tests, made without fitting: points in all directions, noise as residuals."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.points import LeftOut, Poses, View
from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, FloatArray

HOSTILE = "<script>alert(1)</script>&.png"
CAMERA = Camera(
    BaksteinPajdla(540.0, 2.1, 60.0, 1.2), (640, 600), (318.0, 301.0), half_fov=math.radians(92), aspect=1.01
)


def made_calibration(
    points: int = 400,
    views: int = 2,
    sigma_px: float = 0.2,
    rejected: int = 0,
    camera: Camera = CAMERA,
    reach_deg: float = 90.0,
) -> Calibration:
    """A calibration of `views` views with `points` each, the first `rejected` of the first view not used."""
    rng = np.random.default_rng(0)
    scaled = _within(camera)
    targets, seen, residuals, used = [], [], [], []
    for _ in range(views):
        rays = _directions(rng, points, reach_deg)
        target = rays * rng.uniform(300, 900, (points, 1))
        noise = rng.normal(0, sigma_px, (points, 2))
        chosen = np.ones(points, bool)
        targets.append(target)
        seen.append(scaled.project(target) - noise)
        residuals.append(noise)
        used.append(chosen)
    used[0][:rejected] = False
    residuals[0][:rejected] = np.where(np.arange(rejected)[:, None] % 2, np.nan, 40 * sigma_px)
    names = [HOSTILE, *(f"view {k}.png" for k in range(1, views))]
    values = len(scaled.values)
    return Calibration(
        camera=scaled,
        views=tuple(View(*item) for item in zip(names, targets, seen, strict=True)),
        poses=Poses(np.stack([np.eye(3)] * views), np.zeros((views, 3))),
        residuals_px=tuple(residuals),
        used=tuple(used),
        left_out=(LeftOut("dark & <b>blurred</b>.png", "no target was <i>found</i>"),),
        observed_theta_deg=(2.0, reach_deg),
        covariance_factor=1e-2 * rng.normal(size=(values, values)) * np.abs(scaled.values)[:, None] / 100,
        sigma_px=sigma_px,
    )


def _within(camera: Camera) -> Camera:
    """The camera with a lens that images the edge of its field at 0.46 of the picture's lower side."""
    lens = camera.lens.scaled(0.46 * min(camera.size) / camera.image_radius)
    return Camera(lens, camera.size, camera.centre, half_fov=camera.half_fov, aspect=camera.aspect)


def _directions(rng: np.random.Generator, count: int, reach_deg: float) -> FloatArray:
    theta, phi = np.radians(rng.uniform(2, reach_deg, count)), rng.uniform(-math.pi, math.pi, count)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
