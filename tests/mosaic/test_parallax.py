"""A rotation is told from a rotation and a translation, and how much parallax there is comes out right."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning import orientation, turn_between
from walking import evidence_of, room_points

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.parallax import Parallax, pair_parallax, parallaxes
from laws import SEEDS, fisheye, law, rotation

CAMERA = fisheye(900)
TURNS = np.array([orientation(0), orientation(70, 5, -3)])


def compared(moved: FloatArray, noise_px: float = 0.3, wrong: float = 0.1, seed: int = 0) -> Parallax:
    positions = np.array([np.zeros(3), moved])
    evidence = evidence_of(CAMERA, TURNS, positions, room_points(900, seed), noise_px, wrong, seed)
    found = parallaxes(evidence, [CAMERA], [(0, 1)])
    assert set(found) == {(0, 1)}
    return found[0, 1]


@given(seed=SEEDS, noise_px=st.floats(0.05, 0.6), wrong=st.floats(0, 0.4))
@law(20)
def test_turning_on_the_spot_is_a_rotation(seed: int, noise_px: float, wrong: float) -> None:
    found = compared(np.zeros(3), noise_px, wrong, seed)
    assert found.verdict == "rotation"
    assert found.size_px < 0.7 * noise_px
    assert turn_between(found.rotation, TURNS[1] @ TURNS[0].T) < 2e-3
    assert found.sigma_px == pytest.approx(noise_px, rel=0.35)


@given(seed=SEEDS, noise_px=st.floats(0.05, 0.6), wrong=st.floats(0, 0.3))
@law(20)
def test_a_step_is_parallax_and_its_direction_is_found(seed: int, noise_px: float, wrong: float) -> None:
    step = 0.3 * rotation(seed)[0]
    found = compared(step, noise_px, wrong, seed)
    assert found.verdict == "parallax"
    assert found.gain > 0
    along = TURNS[1] @ step / np.linalg.norm(step)
    assert abs(found.direction @ along) > np.cos(np.deg2rad(12))


def test_parallax_grows_with_the_step() -> None:
    sizes = [compared(np.array([step, 0, 0])).size for step in (0.0, 0.03, 0.06, 0.12)]
    assert sizes[0] < 0.1 * sizes[1]
    assert np.diff(sizes).min() > 0
    assert 0.7 * 4 < sizes[3] / sizes[1] < 1.3 * 4


def test_a_centimetre_is_noticed_but_no_other_viewpoint() -> None:
    found = compared(np.array([0.01, 0, 0.005]), noise_px=0.2)
    assert found.gain > 0
    assert found.verdict == "rotation"


def test_keypoints_in_one_place_do_no_harm() -> None:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(120, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = a @ TURNS[1].T
    b[60:] = b[:60]  # every place twice, the second time wrongly matched
    pixel = np.full(120, 3e-3)
    found = pair_parallax(a, b, pixel, pixel, 40.0)
    assert found is not None
    assert found.verdict == "rotation"
    assert turn_between(found.rotation, TURNS[1]) < 1e-3


def test_few_matches_tell_nothing() -> None:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(15, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    pixel = np.full(15, 1e-3)
    assert pair_parallax(a, a, pixel, pixel, 10.0) is None


def test_noise_is_no_motion() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 300, 3))
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    pixel = np.full(300, 1e-3)
    assert pair_parallax(a, b, pixel, pixel, 10.0) is None


def test_exact_matches_are_a_rotation() -> None:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(100, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    pixel = np.full(100, 1e-3)
    found = pair_parallax(a, a, pixel, pixel, 10.0)
    assert found is not None
    assert found.verdict == "rotation"
    assert found.size_px == 0


def test_the_same_input_gives_the_same_bytes() -> None:
    one, two = (compared(np.array([0.1, 0.02, 0.0])) for _ in range(2))
    np.testing.assert_array_equal(one.rotation, two.rotation)
    assert one.size == two.size
