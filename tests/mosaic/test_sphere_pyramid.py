"""Pyramids on the sphere: the compiled loops against slow twins, and laws at the poles and the edge."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fullsphere.model.errors import UsageError
from fullsphere.mosaic import sphere_pyramid
from fullsphere.mosaic.sphere_kernels import add_detail, fill_in, weigh_detail
from fullsphere.mosaic.sphere_pyramid import boxes, continued, expand, gaussian, latitudes, reduce, sizes
from laws import SEEDS, law

Float = NDArray[np.float64]


def picture_of(seed: int, height: int, channels: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((height, 2 * height, channels)).astype(np.float32)


def row_of(picture: Float, y: int) -> Float:
    """Row y of a sphere, which goes on past the poles on the other side."""
    height = len(picture)
    if 0 <= y < height:
        row: Float = picture[y]
        return row
    mirrored: Float = picture[-1 - y if y < 0 else 2 * height - 1 - y]
    return np.roll(mirrored, height, axis=0)


def blurred(row: Float, variance: float) -> Float:
    """Twice the box of half that variance, one column after the other."""
    whole, fraction = boxes(np.array([variance]), len(row))
    weights = dict.fromkeys(range(-int(whole[0]), int(whole[0]) + 1), 1.0)
    weights[int(whole[0]) + 1] = weights[-int(whole[0]) - 1] = float(fraction[0])
    for _ in range(2):
        total = sum(np.roll(row, -k, axis=0) * w for k, w in weights.items())
        row = np.asarray(total) / sum(weights.values())
    return row


def twin_of_reduce(fine: Float) -> Float:
    height = len(fine) // 2
    rows = []
    for y, latitude in enumerate(latitudes(height)):
        row = sum(w * row_of(fine, 2 * y - 1 + k) for k, w in enumerate((0.125, 0.375, 0.375, 0.125)))
        row = blurred(np.asarray(row), 0.75 * np.tan(latitude) ** 2)
        halved = sum(w * np.roll(row, 1 - k, axis=0) for k, w in enumerate((0.125, 0.375, 0.375, 0.125)))
        rows.append(np.asarray(halved)[::2])
    return np.array(rows)


def twin_of_expand(coarse: Float) -> Float:
    height = 2 * len(coarse)
    rows = []
    for y, latitude in enumerate(latitudes(height)):
        row = 0.75 * row_of(coarse, y // 2) + 0.25 * row_of(coarse, y // 2 + (1 if y % 2 else -1))
        row = blurred(row, 0.75 / 4 * np.tan(latitude) ** 2)
        left, right = 0.75 * row + 0.25 * np.roll(row, 1, axis=0), 0.75 * row + 0.25 * np.roll(row, -1, axis=0)
        rows.append(np.stack([left, right], axis=1).reshape(2 * len(row), -1))
    return np.array(rows)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("height", [2, 6, 10, 32])
def test_the_compiled_loops_are_their_slow_twins(height: int, channels: int) -> None:
    picture = picture_of(height, height, channels)
    np.testing.assert_allclose(reduce(picture), twin_of_reduce(picture.astype(np.float64)), rtol=2e-6)
    np.testing.assert_allclose(expand(picture), twin_of_expand(picture.astype(np.float64)), rtol=2e-6)


def test_small_loops_are_their_twins() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 5, 7, 3)).astype(np.float32)
    weight = (rng.random((5, 7)) * (rng.random((5, 7)) > 0.3)).astype(np.float32)
    w = weight[..., None]
    detail = b.copy()
    weigh_detail(a, weight, detail)
    np.testing.assert_allclose(detail, w * (a - b), rtol=1e-6)
    light = b.copy()
    add_detail(a, weight, 0.1, light)
    np.testing.assert_allclose(light, np.where(w > 0.1, b + a / np.maximum(w, 0.1), b), rtol=1e-6)
    coarser = b.copy()
    fill_in(a * w, weight, coarser)
    np.testing.assert_allclose(coarser, a * w + (1 - w) * b, rtol=1e-6)


@given(variance=st.floats(0, 2000), width=st.integers(2, 300))
@law(100)
def test_two_boxes_have_the_variance_asked_for_or_are_the_row(variance: float, width: int) -> None:
    whole, fraction = (float(value[0]) for value in boxes(np.array([variance]), width))
    assert 0 <= fraction <= 1
    assert 2 * whole + 1 + 2 * fraction <= width + 1e-9
    k = np.arange(1, int(whole) + 1)
    each = (2 * (k**2).sum() + 2 * fraction * (whole + 1) ** 2) / (2 * whole + 1 + 2 * fraction)
    if whole + fraction < (width - 1) / 2 - 1e-9:
        np.testing.assert_allclose(2 * each, variance, rtol=1e-9, atol=1e-9)
    else:
        assert 2 * each <= variance + 1e-6


def test_the_width_of_boxes_grows_without_steps() -> None:
    variance = np.linspace(0, 50, 20001)
    whole, fraction = boxes(variance, 1000)
    steps = np.diff(whole + fraction)
    assert steps.min() >= 0
    assert steps.max() < 0.01


@given(seed=SEEDS, turn=st.integers(1, 31))
@law(20)
def test_turning_by_a_coarse_pixel_turns_and_turning_upside_down_mirrors(seed: int, turn: int) -> None:
    picture = picture_of(seed, 32, 3)
    np.testing.assert_allclose(reduce(np.roll(picture, 2 * turn, 1)), np.roll(reduce(picture), turn, 1), atol=1e-6)
    np.testing.assert_allclose(expand(np.roll(picture, turn, 1)), np.roll(expand(picture), 2 * turn, 1), atol=1e-6)
    np.testing.assert_allclose(reduce(picture[::-1, ::-1]), reduce(picture)[::-1, ::-1], atol=1e-6)
    np.testing.assert_allclose(expand(picture[::-1, ::-1]), expand(picture)[::-1, ::-1], atol=1e-6)


def rays_of(height: int) -> Float:
    latitude, longitude = latitudes(height)[:, None], (np.arange(2 * height) + 0.5) / height * np.pi
    across = np.cos(latitude)
    return np.stack([across * np.sin(longitude), np.sin(latitude) + 0 * longitude, across * np.cos(longitude)], -1)


def test_what_is_smooth_on_the_sphere_passes_both_ways_over_poles_and_edge() -> None:
    fine, coarse = rays_of(128).astype(np.float32), rays_of(64).astype(np.float32)
    # a row near a pole is a small circle, of which an arc as long as the kernel is wide no longer is straight:
    # a slope of 1 is flattened over two pixels, by less than a pixel's worth
    assert np.abs(reduce(fine) - coarse).max() < np.pi / 128
    assert np.abs(expand(coarse) - fine).max() < np.pi / 128
    away = slice(16, -16)
    assert np.abs(reduce(fine) - coarse)[away].max() < 2e-3
    assert np.abs(expand(coarse) - fine)[away].max() < 2e-3


def test_sizes_halve_until_they_are_small_or_odd() -> None:
    assert sizes(512, 1024)[-1] == (8, 16)
    assert len(sizes(512, 1024)) == 7
    assert sizes(100, 200) == [(100, 200), (50, 100), (25, 50)]
    assert sizes(24, 48, smallest=1)[-1] == (3, 6)
    with pytest.raises(UsageError, match="twice"):
        sizes(100, 201)


def test_a_gaussian_pyramid_is_reductions_of_reductions() -> None:
    picture = picture_of(3, 32, 2)
    pyramid = gaussian(picture, 3)
    np.testing.assert_array_equal(pyramid[2], reduce(reduce(picture)))
    assert [len(level) for level in pyramid] == [32, 16, 8]


@given(seed=SEEDS, constant=st.floats(-8, 8, width=32))
@law(20)
def test_a_picture_is_carried_on_from_what_is_known_and_that_stays(seed: int, constant: float) -> None:
    rng = np.random.default_rng(seed)
    known = (rng.random((32, 64)) > rng.choice([0.2, 0.9, 0.998])).astype(np.float32)
    known[5, 7] = 1
    picture = picture_of(seed, 32, 3)
    carried = continued(picture * known[..., None], known)
    np.testing.assert_array_equal(carried[known > 0], picture[known > 0])
    seen = picture[known > 0]
    assert (carried >= seen.min(0) - 1e-5).all()
    assert (carried <= seen.max(0) + 1e-5).all()
    flat = continued(np.full((32, 64, 1), constant, np.float32) * known[..., None], known)
    np.testing.assert_allclose(flat, constant, rtol=1e-5, atol=1e-30)


def test_of_nothing_known_nothing_follows() -> None:
    assert not continued(np.zeros((16, 32, 3), np.float32), np.zeros((16, 32), np.float32)).any()


def test_the_levels_are_the_same_whatever_the_memory_layout() -> None:
    picture = picture_of(8, 16, 3)
    np.testing.assert_array_equal(reduce(np.asfortranarray(picture)), reduce(picture))
    np.testing.assert_array_equal(sphere_pyramid.expand(picture[..., 1]), expand(picture)[..., 1])
