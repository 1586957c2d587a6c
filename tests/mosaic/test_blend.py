"""The laws of a blender: constant stays constant, one picture is itself, the order does not matter."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.mosaic.blend import Feather
from laws import SEEDS, law

SHAPE = (7, 9)


@given(seed=SEEDS, constant=st.floats(0, 1000, width=32), count=st.integers(1, 6))
@law(30)
def test_a_constant_scene_stays_constant(seed: int, constant: float, count: int) -> None:
    rng = np.random.default_rng(seed)
    blender, fed = Feather(*SHAPE), np.zeros(SHAPE, bool)
    for _ in range(count):
        weight = (rng.random(SHAPE) * (rng.random(SHAPE) > 0.5)).astype(np.float32)
        fed |= weight > 0
        blender.feed(np.full((*SHAPE, 3), constant, np.float32), weight)
    light, coverage = blender.blended()
    np.testing.assert_array_equal(coverage, fed)
    np.testing.assert_allclose(light[fed], constant, rtol=1e-6, atol=1e-30)  # subnormal numbers have fewer digits
    np.testing.assert_array_equal(light[~fed], 0)
    assert light.dtype == coverage.dtype == np.float32


@given(seed=SEEDS)
@law(20)
def test_one_picture_is_itself_whatever_its_weight(seed: int) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.random((*SHAPE, 3)).astype(np.float32)
    blender = Feather(*SHAPE)
    blender.feed(picture, (10 ** rng.uniform(-12, 3, SHAPE)).astype(np.float32))
    np.testing.assert_allclose(blender.blended()[0], picture, rtol=1e-6)
    blender.feed(picture, rng.random(SHAPE).astype(np.float32))  # and again with itself
    np.testing.assert_allclose(blender.blended()[0], picture, rtol=1e-6)


@given(seed=SEEDS)
@law(20)
def test_the_order_does_not_matter_and_the_result_is_the_weighted_mean(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pictures = rng.random((5, *SHAPE, 3)).astype(np.float32)
    weights = rng.random((5, *SHAPE)).astype(np.float32)
    expected = np.average(pictures, axis=0, weights=np.repeat(weights[..., None], 3, axis=-1))
    for order in (range(5), range(4, -1, -1)):
        blender = Feather(*SHAPE)
        for k in order:
            blender.feed(pictures[k], weights[k])
        np.testing.assert_allclose(blender.blended()[0], expected, rtol=1e-5)


def test_nothing_fed_is_nothing_covered() -> None:
    light, coverage = Feather(*SHAPE).blended()
    assert not light.any()
    assert not coverage.any()


def test_asking_does_not_change_the_answer() -> None:
    blender = Feather(*SHAPE)
    blender.feed(np.ones((*SHAPE, 3), np.float32), np.full(SHAPE, 0.3, np.float32))
    first, second = blender.blended(), blender.blended()
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
