"""Yaw, pitch and roll beside SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fullsphere.model.yaw_pitch_roll import angles_of_rotation, rotation_of_angles


def test_rotations_are_those_of_scipy_and_come_back() -> None:
    for angles in np.random.default_rng(1).uniform((-180, -90, -180), (180, 90, 180), (50, 3)).tolist():
        matrix = rotation_of_angles(*angles)
        assert np.abs(matrix - Rotation.from_euler("YXZ", angles, degrees=True).as_matrix()).max() < 1e-15
        assert angles_of_rotation(matrix) == pytest.approx(angles, abs=1e-9)


def test_right_up_and_clockwise() -> None:
    assert rotation_of_angles(90, 0, 0)[:, 2] == pytest.approx([1, 0, 0])  # it looks to the right
    assert rotation_of_angles(0, 90, 0)[:, 2] == pytest.approx([0, -1, 0])  # up
    assert rotation_of_angles(0, 0, 90)[:, 0] == pytest.approx([0, 1, 0])  # what was to its right is below


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_straight_up_and_down_it_is_all_yaw(pitch: float) -> None:
    matrix = rotation_of_angles(30, pitch, 20)
    yaw, found, roll = angles_of_rotation(matrix)
    assert found == pytest.approx(pitch)
    assert roll == 0
    assert rotation_of_angles(yaw, found, roll) == pytest.approx(matrix, abs=1e-12)
