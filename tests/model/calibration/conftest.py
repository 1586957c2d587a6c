"""A world with known truth: a camera inside a box whose five inner faces carry marks."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.points import Poses, View
from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, Lens


def box_marks(per_side: int = 7) -> np.ndarray:
    """(n, 3) marks on the floor z = 0 and the four walls up to z = -300 of a box 400 wide."""
    a, b = np.meshgrid(np.linspace(-180, 180, per_side), np.linspace(-290, -15, per_side))
    across, depth = a.ravel(), b.ravel()
    side = np.full(across.shape, 200.0)
    floor = np.meshgrid(np.linspace(-180, 180, per_side), np.linspace(-180, 180, per_side))
    return np.concatenate(
        [
            np.stack([floor[0].ravel(), floor[1].ravel(), np.zeros(across.size)], -1),
            np.stack([across, side, depth], -1),
            np.stack([across, -side, depth], -1),
            np.stack([side, across, depth], -1),
            np.stack([-side, across, depth], -1),
        ]
    )


@dataclasses.dataclass(frozen=True)
class World:
    """The camera and poses that pictures were made with, and what was measured in them."""

    camera: Camera
    poses: Poses
    views: tuple[View, ...]


class Photographer:
    """Takes pictures of marks; each picture keeps the marks inside the field of view and the rectangle."""

    def camera(self, lens: Lens | None = None, half_fov_deg: float = 95.0, aspect: float = 1.002) -> Camera:
        lens = lens or BaksteinPajdla(900.0, 3.2, 80.0, 1.3)  # r(90 degrees) = 556 px
        return Camera(lens, (1280, 1280), (643.0, 637.5), aspect=aspect, half_fov=math.radians(half_fov_deg))

    def poses(self, views: int, rng: np.random.Generator, distance: float = 200.0, tilt_deg: float = 20.0) -> Poses:
        turn = Rotation.from_rotvec(rng.uniform(-1, 1, (views, 3)) * math.radians(tilt_deg))
        at = np.stack([*rng.uniform(-60, 60, (2, views)), rng.uniform(-1.2, -0.8, views) * distance], -1)
        return Poses(turn.as_matrix(), -np.einsum("vij,vj->vi", turn.as_matrix(), at))

    def shoot(
        self, camera: Camera, poses: Poses, marks: np.ndarray, noise_px: float, rng: np.random.Generator
    ) -> World:
        views = []
        for k, (turn, shift) in enumerate(zip(poses.camera_from_target, poses.translation, strict=True)):
            pixels = camera.project(marks @ turn.T + shift)
            with np.errstate(invalid="ignore"):
                inside = np.all((pixels >= 0) & (pixels <= np.array(camera.size) - 1), axis=1)
            noise = rng.normal(0, noise_px, pixels.shape) if noise_px else 0.0
            views.append(View(f"{k:02d}.png", marks[inside], np.clip(pixels + noise, 0, 1279)[inside]))
        return World(camera, poses, tuple(views))

    def box_world(
        self, seed: int, noise_px: float, views: int = 4, camera: Camera | None = None, **pose: float
    ) -> World:
        rng = np.random.default_rng(seed)
        return self.shoot(camera or self.camera(), self.poses(views, rng, **pose), box_marks(), noise_px, rng)


@pytest.fixture(scope="session")
def photographer() -> Photographer:
    return Photographer()
