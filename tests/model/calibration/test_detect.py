"""Corners are really found in the photo, and none that is not there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.boards import CharucoBoard
from fullsphere.model.calibration.detect import find_marks
from fullsphere.model.calibration.targets import Target
from fullsphere.model.camera import Camera
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import BaksteinPajdla
from fullsphere.mosaic.worlds import charuco_box, photograph, target_scene


def wide_camera(side: int) -> Camera:
    half = math.radians(91.5)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    lens = lens.scaled(0.485 * side / float(lens.radius(half)))
    return Camera(lens, (side, side), (side / 2 + 3.8, side / 2 - 6.6), half_fov=half)


def take(
    camera: Camera, boards: tuple[CharucoBoard, ...], position: Any, angles: Any, noise: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    turned = Rotation.from_euler("YXZ", angles, degrees=True).inv().as_matrix()
    scene = target_scene(boards, position)
    return turned, photograph(scene, camera, turned, noise=noise, vignetting=(-0.2, -0.1), seed=seed, supersampling=3)


@pytest.mark.parametrize(
    ("position", "angles", "noise", "seed"),
    [((25, -18, 12), (4, -3, 2.5), 0.005, 0), ((-40, 22, -15), (-3, 5, -4), 0.01, 1)],
)
def test_corners_of_a_wide_photo_are_found_where_they_are(position: Any, angles: Any, noise: float, seed: int) -> None:
    camera, boards = wide_camera(1600), charuco_box()
    turned, photo = take(camera, boards, position, angles, noise, seed)
    target = Target("box", boards)
    marks, pixels = find_marks(photo, target)
    points = target.points[marks]
    rays = (points - position) @ turned.T
    error = np.linalg.norm(pixels - camera.project(rays), axis=-1)
    everything = np.concatenate([board.marks_on_target() for board in boards])
    visible = np.isfinite(camera.project((everything - position) @ turned.T)).all(-1).sum()
    theta = np.degrees(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]))
    assert len(np.unique(points, axis=0)) == len(points)
    assert len(points) >= 0.9 * visible
    assert np.median(error) < 0.02
    assert error.max() < 0.25
    assert theta.max() > 90.5


def test_mirrored_photo_has_no_corners() -> None:
    camera, boards = wide_camera(900), charuco_box()
    _, photo = take(camera, boards, (25, -18, 12), (4, -3, 2.5), 0.005, 0)
    assert len(find_marks(photo, Target("box", boards)).pixels) > 300
    assert len(find_marks(photo[:, ::-1], Target("box", boards)).pixels) == 0


@pytest.mark.parametrize("kind", ["noise", "black", "squares", "tiny"])
def test_picture_without_a_target_has_no_corners(kind: str) -> None:
    random = np.random.default_rng(2)
    picture = {
        "noise": random.integers(0, 256, (600, 600, 3), np.uint8),
        "black": np.zeros((300, 400, 3), np.uint8),
        "squares": np.kron(random.integers(0, 2, (60, 60), np.uint8) * 255, np.ones((10, 10), np.uint8)),
        "tiny": np.zeros((1, 1, 3), np.uint8),
    }[kind]
    found = find_marks(picture, Target("box", charuco_box()))
    assert found.marks.shape == (0,) and found.pixels.shape == (0, 2)


def test_pictures_of_more_than_8_bits_are_refused() -> None:
    with pytest.raises(UsageError, match="8-bit"):
        find_marks(np.zeros((10, 10), np.uint16), Target("box", charuco_box()))
