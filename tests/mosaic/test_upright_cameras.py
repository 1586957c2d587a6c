"""Up from how cameras were held: level or nearly, upright or on their sides, all round or not."""

import numpy as np
import pytest
from hypothesis import given
from turning import orientation

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.upright_cameras import Upright, across, up_from_cameras
from laws import SEEDS, law, rotation

UP = np.array([0.0, -1.0, 0.0])


def tilt_deg(upright: Upright, up: FloatArray = UP) -> float:
    return float(np.rad2deg(np.arccos(np.clip(upright.up @ up, -1, 1))))


def held(rng: np.random.Generator, angles: list[tuple[float, float, float]], jitter_deg: float) -> list[FloatArray]:
    return [orientation(*(np.array(a) + rng.normal(0, jitter_deg, 3))) for a in angles]


@given(seed=SEEDS)
@law(30)
def test_level_cameras_give_the_true_up_in_any_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = rotation(seed)
    pitch = rng.uniform(-50, 50)
    upright = up_from_cameras([orientation(60 * k + rng.uniform(-20, 20), pitch) @ world for k in range(6)])
    assert tilt_deg(upright, world.T @ UP) < 0.05
    assert not upright.opposite


@given(seed=SEEDS)
@law(30)
def test_a_turn_by_hand(seed: int) -> None:
    upright = up_from_cameras(held(np.random.default_rng(seed), [(45.0 * k, 0.0, 0.0) for k in range(8)], 3.0))
    assert tilt_deg(upright) < 5
    assert tilt_deg(upright) < 4 * upright.sigma_deg


def test_rows_tell_more_than_rolls_alone() -> None:
    """Frames rolled by 12 degrees and pitched in two exact rows: the rows carry."""
    by_rows, by_rolls = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        rolled = [orientation(45 * k, 30 * (-1) ** k, rng.normal(0, 12)) for k in range(8)]
        by_rows.append(tilt_deg(up_from_cameras(rolled)))
        x_axes = np.array(rolled)[:, 0]
        by_rolls.append(np.rad2deg(np.arccos(abs(np.linalg.eigh(x_axes.T @ x_axes)[1][1, 0]))))
    assert np.median(by_rows) < 0.5 * np.median(by_rolls)


@given(seed=SEEDS)
@law(20)
def test_frames_held_on_their_sides_with_zenith_and_nadir(seed: int) -> None:
    rng = np.random.default_rng(seed)
    around = [(60.0 * k, 0.0, 90.0) for k in range(6)]
    upright = up_from_cameras(held(rng, [*around, (0.0, 88.0, 0.0), (40.0, -88.0, 0.0)], 2.0))
    assert min(tilt_deg(upright), 180 - tilt_deg(upright)) < 5
    assert upright.opposite  # held on the right side or on the left one: they cannot tell


@pytest.mark.parametrize("roll", [90.0, -90.0])
def test_orientation_tags_tell_the_side(roll: float) -> None:
    frames = held(np.random.default_rng(5), [(60.0 * k, 0.0, roll) for k in range(6)], 1.0)
    # a camera rolled to the right gives a picture whose top is to the left: it is turned to the right to be upright
    upright = up_from_cameras(frames, [1 if roll > 0 else 3] * 6)
    assert tilt_deg(upright) < 3
    assert not upright.opposite


def test_one_frame_held_on_its_side_among_level_ones() -> None:
    angles = [(45.0 * k, 0.0, 90.0 if k == 2 else 0.0) for k in range(8)]
    assert tilt_deg(up_from_cameras(held(np.random.default_rng(1), angles, 1.0))) < 2


def test_one_frame_badly_rolled_among_level_ones() -> None:
    angles = [(45.0 * k, 0.0, 35.0 if k == 2 else 0.0) for k in range(8)]
    assert tilt_deg(up_from_cameras(held(np.random.default_rng(1), angles, 0.5))) < 1.5


def test_two_frames_back_to_back() -> None:
    upright = up_from_cameras([orientation(1, -1, 0.5), orientation(180, 1.5, -0.5)])
    assert tilt_deg(upright) < 3
    assert upright.sigma_deg > 1.5  # x axes alone leave pitch open


@pytest.mark.parametrize("rotations", [[rotation(3)], [rotation(3)] * 4], ids=["one", "all alike"])
def test_frames_that_look_one_way_are_known_to_tell_little(rotations: list[FloatArray]) -> None:
    assert up_from_cameras(rotations).sigma_deg > 25


def test_across() -> None:
    for axis in [*np.eye(3), rotation(2)[0]]:
        frame = np.vstack([across(axis), axis])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
