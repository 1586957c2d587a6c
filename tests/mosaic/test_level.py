"""Up from cameras held level, and the panorama's middle from the first of them."""

import numpy as np
import pytest
from hypothesis import given
from turning import orientation

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.level import level_turn
from laws import SEEDS, law, rotation


def is_rotation(turn: FloatArray) -> bool:
    return bool(np.allclose(turn @ turn.T, np.eye(3), atol=1e-12) and np.linalg.det(turn) > 0)


@given(seed=SEEDS)
@law(40)
def test_level_cameras_give_the_true_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    level = [orientation(*rng.uniform([-180, -70], [180, 70])) for _ in range(5)]
    level.append(orientation(np.rad2deg(np.arctan2(level[0][2, 0], level[0][2, 2])) + 90))  # not all one way
    level_from_now = rotation(seed)
    turn, how = level_turn([r @ level_from_now for r in level])
    assert how == "camera-x-axes"
    assert is_rotation(turn)
    np.testing.assert_allclose(turn @ level_from_now.T @ [0, 1, 0], [0, 1, 0], atol=1e-9)
    forward = (level[0] @ level_from_now @ turn.T)[2]
    assert abs(forward[0]) < 1e-9  # the first camera looks along longitude zero
    assert forward[2] > 0


@given(seed=SEEDS)
@law(20)
def test_cameras_not_quite_level_give_up_nearly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotations = [orientation(45 * k, rng.uniform(-40, 40), rng.normal(0, 2)) for k in range(8)]
    turn, _ = level_turn(rotations)
    assert np.rad2deg(np.arccos((turn @ [0, 1, 0])[1])) < 4


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_a_first_camera_that_looks_straight_up_or_down(pitch: float) -> None:
    rotations = [orientation(0, pitch), *(orientation(yaw) for yaw in (0, 70, 150))]
    turn, how = level_turn(rotations)
    assert how == "camera-x-axes"
    assert is_rotation(turn)
    np.testing.assert_allclose(turn @ [0, 1, 0], [0, 1, 0], atol=1e-9)


@pytest.mark.parametrize(
    "rotations",
    [[rotation(3)], [rotation(3)] * 4, [orientation(0, pitch) @ rotation(3) for pitch in (-60, -20, 10, 80)]],
    ids=["one", "all alike", "only tilted"],
)
def test_parallel_x_axes_fix_no_horizon(rotations: list[FloatArray]) -> None:
    turn, how = level_turn(rotations)
    assert how == "none"
    np.testing.assert_array_equal(turn, rotations[0])


def test_cameras_that_point_every_way_up_are_not_called_level() -> None:
    upside = [orientation(yaw, 0, roll) for yaw in (0, 90) for roll in (0, 180)]
    turn, how = level_turn(upside)
    assert how == "none"
    assert is_rotation(turn)
