from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.mosaic.arm import mount_angles, mount_of, positions, turned
from fullsphere.mosaic.circular_fit import MatchedPair, fit_circle
from fullsphere.mosaic.circular_motion import (
    Rays,
    ahead,
    find_pair_turn,
    plane_of,
    slope_by_turn,
    slopes_by_mount,
)

NOISE = 2e-4
Floats = NDArray[np.float64]


def rays_to(points: Floats, angle: float, mount: Floats, radius: float = 1.0) -> Floats:
    """Unit rays (n, 3) in the camera frame to points of the world, NaN where the camera does not look."""
    rays = (points - radius * positions(angle)) @ turned(angle) @ mount.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays[rays[:, 2] < math.cos(math.radians(91.5))] = np.nan
    return rays


def world(count: int = 800, near: float = 3, far: float = 40, seed: int = 0) -> Floats:
    random = np.random.default_rng(seed)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * np.exp(random.uniform(math.log(near), math.log(far), (count, 1)))


def matches(
    points: Floats, one: float, other: float, mount: Floats, noise: float = NOISE, seed: int = 1, radius: float = 1.0
) -> tuple[Rays, NDArray[np.intp]]:
    """What two frames have in common, and which points that is."""
    first, second = (rays_to(points, angle, mount, radius) for angle in (one, other))
    both = np.flatnonzero(np.isfinite(first[:, 0]) & np.isfinite(second[:, 0]))
    random = np.random.default_rng(seed)
    first, second = (rays + noise * random.normal(size=rays.shape) for rays in (first[both], second[both]))
    first, second = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (first, second))
    every = np.full(len(both), NOISE)
    return Rays(first, second, every, every), both


def pairs_of(angles: Floats, mount: Floats, steps: tuple[int, ...] = (1, 3, 6), **world_of: float) -> list[MatchedPair]:
    """Pairs round the full turn, with keypoints whose noise is the same in all pairs."""
    points = world(seed=4, near=world_of.get("near", 3), far=world_of.get("far", 40))
    n, random = len(angles), np.random.default_rng(7)
    seen = [rays_to(points, angle, mount) for angle in angles]
    seen = [rays + NOISE * random.normal(size=rays.shape) for rays in seen]
    seen = [rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in seen]
    pairs = []
    for k, step in itertools.product(range(n), steps):
        i, j = k, (k + step) % n
        both = np.flatnonzero(np.isfinite(seen[i][:, 0]) & np.isfinite(seen[j][:, 0]))
        every = np.full(len(both), NOISE)
        rays = Rays(seen[i][both], seen[j][both], every, every)
        pairs.append(MatchedPair(i, j, rays, both, both, both % 5 == 0))
    return pairs


@pytest.mark.parametrize("turn_deg", [-38.0, -2.0, 0.7, 12.0, 60.0])
def test_matches_of_the_true_turn_lie_in_its_planes_and_ahead(turn_deg: float) -> None:
    turn, mount = math.radians(turn_deg), mount_of(0.02, -0.05, 0.3)
    rays, _ = matches(world(), 1.1, 1.1 + turn, mount, noise=0)
    plane = plane_of(rays, mount, turn)
    np.testing.assert_allclose(plane.off, 0, atol=1e-14)
    assert ahead(plane, rays, 0.0).all()
    assert (plane.beyond > 0).mean() > 0.99


def test_slopes_are_those_of_finite_differences() -> None:
    mount, turn, step = mount_of(0.03, -0.04, 0.2), 0.31, 1e-6
    rays, _ = matches(world(50), 0.0, 0.33, mount)
    plane = plane_of(rays, mount, turn)
    by_turn = (plane_of(rays, mount, turn + step).off - plane_of(rays, mount, turn - step).off) / (2 * step)
    np.testing.assert_allclose(slope_by_turn(plane), by_turn, atol=1e-8)
    for axis, slope in zip(np.eye(3), slopes_by_mount(plane, turn, np.eye(3)).T, strict=True):
        turned_by = [mount @ _small(-sign * step * axis) for sign in (1, -1)]
        more, less = (plane_of(rays, one, turn).off for one in turned_by)
        np.testing.assert_allclose(slope, (more - less) / (2 * step), atol=1e-8)


def _small(vector: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


@pytest.mark.parametrize("turn_deg", [-25.0, -1.0, 2.0, 45.0])
def test_the_turn_of_two_frames_is_found_among_wrong_matches(turn_deg: float) -> None:
    turn, mount = math.radians(turn_deg), np.eye(3)
    rays, _ = matches(world(), 0.0, turn, mount)
    wrong = np.arange(len(rays.first)) % 3 == 0
    rays = rays._replace(second=np.where(wrong[:, None], np.roll(rays.second, 7, axis=0), rays.second))
    found = find_pair_turn(rays, mount, 8.0)
    assert found is not None
    assert found.turn == pytest.approx(turn, abs=max(4 * found.sigma, 1e-5))
    assert found.sigma < 2e-4
    assert (found.agree & wrong).sum() < 0.1 * wrong.sum()


def test_a_turn_is_found_where_nothing_is_near() -> None:
    rays, _ = matches(world(near=1e6, far=1e7), 0.0, 0.2, np.eye(3))
    found = find_pair_turn(rays, np.eye(3), 8.0)
    assert found is not None
    assert found.turn == pytest.approx(0.2, abs=1e-4)


def test_a_mount_known_to_two_degrees_does_for_neighbours() -> None:
    rays, _ = matches(world(), 0.0, 0.1, mount_of(0.02, 0.03, -0.03))
    found = find_pair_turn(rays, np.eye(3), 40.0)
    assert found is not None
    assert found.turn == pytest.approx(0.1, abs=2e-3)


def test_matches_of_nothing_give_no_turn() -> None:
    random = np.random.default_rng(0)
    one, other = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in random.normal(size=(2, 200, 3)))
    every = np.full(200, NOISE)
    assert find_pair_turn(Rays(one, other, every, every), np.eye(3), 8.0) is None
    few = Rays(one[:5], other[:5], every[:5], every[:5])
    assert find_pair_turn(few, np.eye(3), 8.0) is None


def test_angles_and_mount_are_found_as_exactly_as_told() -> None:
    n = 40
    random = np.random.default_rng(2)
    angles = np.arange(n) * 2 * np.pi / n + random.normal(0, 0.02, n)
    angles -= angles[0]
    true = np.array([0.004, 0.014, -0.01])
    start = angles + np.r_[0, random.normal(0, 0.002, n - 1)]
    fit = fit_circle(pairs_of(angles, mount_of(*true)), start, np.eye(3))
    off = fit.angles - angles
    off -= off.mean()
    assert np.abs(off).max() < math.radians(0.02)
    assert 0.6 < np.sqrt(np.mean((off / fit.sigmas) ** 2)) < 1.7
    wrong = mount_angles(fit.mount) - true
    assert (np.abs(wrong) < 4 * fit.mount_sigmas).all()
    assert (np.abs(wrong) < math.radians(0.03)).all()
    assert fit.spread == pytest.approx(1, abs=0.1)
    assert fit.held_spread == pytest.approx(1, abs=0.1)


def test_known_angles_stay_and_the_mount_is_found() -> None:
    angles = np.arange(24) * 2 * np.pi / 24
    true = mount_of(0.01, -0.02, 0.03)
    fit = fit_circle(pairs_of(angles, true, (1,)), angles, np.eye(3), angles_known=True)
    assert (fit.angles == angles).all()
    assert not fit.sigmas.any()
    assert (np.abs(mount_angles(fit.mount) - mount_angles(true)) < 4 * fit.mount_sigmas).all()


def test_a_known_mount_stays() -> None:
    angles = np.arange(24) * 2 * np.pi / 24
    fit = fit_circle(pairs_of(angles, np.eye(3), (1,)), angles + 0.001 * np.sin(angles), np.eye(3), mount_known=True)
    assert (fit.mount == np.eye(3)).all()
    assert not fit.mount_sigmas.any()


def test_yaw_is_held_small_where_all_is_far() -> None:
    angles = np.arange(24) * 2 * np.pi / 24
    fit = fit_circle(pairs_of(angles, mount_of(0, 0.01, 0), (1, 3), near=1e6, far=1e7), angles, np.eye(3))
    yaw, pitch, _ = mount_angles(fit.mount)
    assert abs(yaw) < math.radians(1)
    assert fit.mount_sigmas[0] > math.radians(0.3)
    assert pitch == pytest.approx(0.01, abs=2e-4)
