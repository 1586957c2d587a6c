"""Matches are mutual and clear; a rotation is found among wrong matches, and none among noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning import turn_between

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.matching import MIN_INLIERS, best_rotation, fit_rotation, held_back, match_features
from laws import SEEDS, angle_between, law, rotation

TOLERANCE = 0.01


def directions(count: int, rng: np.random.Generator) -> FloatArray:
    rays = rng.normal(size=(count, 3))
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def nearly(rays: FloatArray, angle: float, rng: np.random.Generator) -> FloatArray:
    moved = rays + angle * rng.normal(size=rays.shape)
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def described(count: int, rng: np.random.Generator) -> Features:
    descriptors = rng.random((count, 128)) ** 4
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(rng.uniform(0, 500, (count, 2)), descriptors.astype(np.float32))


@given(seed=SEEDS, angle=st.one_of(st.floats(0.0, 0.002), st.just(0.0)))
@law(20)
def test_a_rotation_is_found_among_60_percent_wrong_matches(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    truth, a = rotation(seed), directions(200, rng)
    b = nearly(a @ truth.T, angle, rng)
    wrong = np.arange(200) < 120
    b[wrong] = directions(120, rng)
    fit = fit_rotation(a, b, np.full(200, TOLERANCE), seed=1)
    assert fit is not None
    assert turn_between(fit.rotation, truth) < max(angle, 1e-7)
    assert fit.inliers[~wrong].mean() > 0.98
    assert fit.inliers[wrong].sum() <= 3


@given(seed=SEEDS)
@law(15)
def test_inliers_are_what_agrees_with_the_rotation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = directions(120, rng)
    b = nearly(a @ rotation(seed).T, 0.5 * TOLERANCE, rng)
    tolerance = rng.uniform(0.5, 2, 120) * TOLERANCE
    fit = fit_rotation(a, b, tolerance, seed=0)
    assert fit is not None
    np.testing.assert_array_equal(fit.inliers, angle_between(a @ fit.rotation.T, b) < tolerance)
    np.testing.assert_allclose(fit.rotation @ fit.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(fit.rotation) == pytest.approx(1)


@given(seed=SEEDS)
@law(15)
def test_no_rotation_among_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert fit_rotation(directions(300, rng), directions(300, rng), np.full(300, TOLERANCE), seed=0) is None


@pytest.mark.parametrize("count", [0, 1, 2, MIN_INLIERS - 1])
def test_too_few_matches_are_no_rotation(count: int) -> None:
    a = directions(count, np.random.default_rng(0))
    assert fit_rotation(a, a, np.full(count, TOLERANCE), seed=0) is None


def test_rays_all_in_one_place_fix_no_rotation() -> None:
    a = nearly(np.tile([0.0, 0.0, 1.0], (50, 1)), 1e-3, np.random.default_rng(0))
    assert fit_rotation(a, a, np.full(50, TOLERANCE), seed=0) is None


def test_the_same_seed_gives_the_same_bytes() -> None:
    rng = np.random.default_rng(0)
    a = directions(150, rng)
    b = nearly(a @ rotation(0).T, 0.003, rng)
    b[:80] = directions(80, rng)
    one, two = (fit_rotation(a, b, np.full(150, TOLERANCE), seed=5) for _ in range(2))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.rotation, two.rotation)
    np.testing.assert_array_equal(one.inliers, two.inliers)


@given(seed=SEEDS)
@law(15)
def test_best_rotation_is_the_least_squares_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, weight = directions(30, rng), rng.uniform(0.1, 3, 30)
    b = nearly(a @ rotation(seed).T, 0.2, rng)
    best = best_rotation(a, b, weight)

    def cost(r: FloatArray) -> float:
        return float((weight * ((b - a @ r.T) ** 2).sum(1)).sum())

    for axis in np.vstack([np.eye(3), -np.eye(3)]) * 1e-3:
        x, y, z = axis
        nudge = np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        q, r = np.linalg.qr(nudge)
        assert cost(q * np.sign(np.diag(r)) @ best) > cost(best)


def test_best_rotation_of_mirrored_rays_is_no_mirror() -> None:
    a = directions(20, np.random.default_rng(0))
    assert np.linalg.det(best_rotation(a, a * [1, 1, -1], np.ones(20))) == pytest.approx(1)


def test_matches_are_found_whatever_the_order() -> None:
    rng = np.random.default_rng(0)
    a = described(300, rng)
    order = rng.permutation(300)
    b = Features(a.pixels[order], a.descriptors[order])
    found = match_features(a, b)
    np.testing.assert_array_equal(found.first, np.arange(300))
    np.testing.assert_array_equal(order[found.second], found.first)


def test_what_looks_like_two_things_or_like_nothing_is_not_matched() -> None:
    rng = np.random.default_rng(0)
    a, others = described(50, rng), described(40, rng)
    both = np.vstack([a.descriptors[:25], a.descriptors[:5], others.descriptors]).astype(np.float32)
    twice = Features(np.zeros((len(both), 2)), both)
    found = match_features(a, twice)
    np.testing.assert_array_equal(found.first, np.arange(5, 25))  # 0..4 are there twice, 25..49 not at all
    np.testing.assert_array_equal(found.second, np.arange(5, 25))


@pytest.mark.parametrize(("left", "right"), [(0, 50), (50, 0), (1, 50), (50, 1), (0, 0)])
def test_frames_without_features_match_nothing(left: int, right: int) -> None:
    rng = np.random.default_rng(0)
    found = match_features(described(left, rng), described(right, rng))
    assert len(found.first) == len(found.second) == 0


@given(seed=SEEDS)
@law(10)
def test_one_keypoint_in_five_is_held_back_whatever_the_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(-50, 4000, (4000, 2))
    held = held_back(pixels)
    assert abs(held.sum() - 800) < 5 * np.sqrt(4000 * 0.2 * 0.8)
    order = rng.permutation(4000)
    np.testing.assert_array_equal(held_back(pixels[order]), held[order])
    np.testing.assert_array_equal(held_back(pixels[:7]), held[:7])


def test_held_back_keypoints_have_no_pattern() -> None:
    u, v = np.meshgrid(np.arange(300.0), np.arange(200.0))
    held = held_back(np.stack([u, v], -1).reshape(-1, 2)).reshape(200, 300).astype(float) - 0.2
    for turned in (held[:, 1:] * held[:, :-1], held[1:] * held[:-1], held[1:, 1:] * held[:-1, :-1]):
        assert abs(turned.mean()) < 5 * 0.16 / np.sqrt(turned.size)
    assert abs(held.mean(0)).max() < 5 * 0.4 / np.sqrt(200)
