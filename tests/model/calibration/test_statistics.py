"""What a calibration says of its own errors, against the errors it makes: over many seeds, truth known."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.calibrate import calibrate, curve_of
from fullsphere.model.calibration.points import Poses, Sightings, View
from fullsphere.model.calibration.reduction import inverse_factor
from fullsphere.model.calibration.solve import Solution, solve
from fullsphere.model.calibration.verification import Verification, verify
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

NOISE_PX = 0.3
THETA_DEG = np.array([10, 30, 50, 70, 90])
VALUES = ("centre_u_px", "centre_v_px", "aspect")


class Setting(NamedTuple):
    """Three views of a box, and what theory says of any fit to them when only the noise changes."""

    camera: Camera
    poses: Poses
    exact: Sightings
    bound: FloatArray  # standard deviations of r(theta), then of VALUES: no unbiased estimator has smaller ones

    @property
    def freedom(self) -> int:
        return 2 * self.exact.count - len(self.camera.values) - 6 * len(self.exact.images)

    def seen(self, seed: int) -> Sightings:
        noise = np.random.default_rng(seed).normal(0, NOISE_PX, self.exact.pixels.shape)
        return dataclasses.replace(self.exact, pixels=self.exact.pixels + noise)


@pytest.fixture(scope="module")
def setting(photographer: Any) -> Setting:
    world = photographer.box_world(5, 0.0, views=3)
    exact = Sightings.of(world.views)
    found = solve(exact, world.camera, world.poses)
    assert found.rms_px < 1e-9
    return Setting(world.camera, world.poses, exact, NOISE_PX * spread(found))


def spread(solution: Solution) -> FloatArray:
    """Standard deviations of r(theta) and VALUES for noise of variance 1 (Cramer-Rao: inverse of the information)."""
    camera, factor = solution.camera, inverse_factor(solution.triangle)
    curve = camera.lens.radius_by_parameter(np.radians(THETA_DEG))
    rows = [factor[camera.parameter_names.index(name)] for name in VALUES]
    deviations: FloatArray = np.linalg.norm(np.concatenate([curve @ factor[: curve.shape[1]], rows]), axis=-1)
    return deviations


def estimates(camera: Camera) -> FloatArray:
    values = camera.values
    shown = [values[camera.parameter_names.index(name)] for name in VALUES]
    return np.concatenate([camera.lens.radius(np.radians(THETA_DEG)), shown])


class Outcome(NamedTuple):
    """Over S fits: scatter over the bound, mean error over its own standard deviation, share of intervals that hold."""

    scatter: FloatArray
    bias: FloatArray
    held: FloatArray


def many(setting: Setting, seeds: range) -> Outcome:
    """Fits from the true camera, with 95 % intervals by Student's t."""
    truth, t = estimates(setting.camera), float(stats.t.ppf(0.975, setting.freedom))
    errors, held = [], []
    for seed in seeds:
        solution = solve(setting.seen(seed), setting.camera, setting.poses)
        sigma = math.sqrt(float(np.sum(solution.residuals**2)) / setting.freedom)
        errors.append(estimates(solution.camera) - truth)
        held.append(np.abs(errors[-1]) <= t * sigma * spread(solution))
    scatter = np.std(errors, axis=0, ddof=1)
    return Outcome(scatter / setting.bound, np.mean(errors, 0) / scatter * math.sqrt(len(seeds)), np.mean(held, axis=0))


def test_the_camera_scatters_as_the_bound_says(setting: Setting) -> None:
    """80 fits: a scatter is known to 8 %, a coverage to 2.4 %; four standard deviations are allowed."""
    scatter, bias, held = many(setting, range(80))
    assert np.all(np.abs(scatter - 1) < 0.32), scatter
    assert np.all(np.abs(bias) < 4), bias
    assert np.all(held > 0.85), held


@pytest.mark.slow
def test_scatter_and_coverage_over_2000_seeds(setting: Setting) -> None:
    """A scatter is known to 1.6 %, a coverage to 0.5 % (the five of the curve hold or fail nearly together)."""
    scatter, bias, held = many(setting, range(1000, 3000))
    print("\n           scatter/bound   bias/its sigma   95 % intervals that hold")
    for name, *row in zip([*(f"r({t})" for t in THETA_DEG), *VALUES], scatter, bias, held, strict=True):
        print(f"{name:>11} {row[0]:12.4f} {row[1]:16.2f} {row[2]:18.4f}")
    print(f"curve: scatter/bound {scatter[:5].mean():.4f}, 95 % intervals hold {held[:5].mean():.4f}")
    assert np.all(np.abs(scatter - 1) < 0.1)
    assert np.all(np.abs(bias) < 4)
    assert 0.94 <= held[:5].mean() <= 0.96
    assert np.all((held > 0.935) & (held < 0.965))


def largest_gap(setting: Setting, seed: int) -> float:
    """Between the calibration that searches its start and the fit from the true camera, in standard deviations."""
    seen = setting.seen(seed)
    views = [
        View(image, seen.points[seen.view == k], seen.pixels[seen.view == k]) for k, image in enumerate(seen.images)
    ]
    found = calibrate(views, setting.camera.size)
    assert found.rejected == 0
    best = solve(seen, setting.camera, setting.poses)
    return float(np.max(np.abs(estimates(found.camera) - estimates(best.camera)) / setting.bound))


def test_the_search_for_a_start_reaches_the_same_minimum(setting: Setting) -> None:
    assert max(largest_gap(setting, seed) for seed in range(4)) < 0.05


@pytest.mark.slow
def test_the_search_for_a_start_reaches_the_same_minimum_over_150_seeds(setting: Setting) -> None:
    gaps = [largest_gap(setting, seed) for seed in range(1000, 1150)]
    print(f"\nlargest distance between the two minima: {max(gaps):.4f} standard deviations")
    assert max(gaps) < 0.05


def paper_s_cylinder() -> FloatArray:
    """72 points round the axis, one depth for each of nine angles."""
    theta, phi = np.meshgrid(np.radians([90, 85, 80, 75, 70, 60, 50, 40, 30]), np.radians(np.arange(0, 360, 45)))
    return np.asarray(150 * np.stack([np.cos(phi), np.sin(phi), 1 / np.tan(theta)], -1).reshape(-1, 3))


def paper_s_half_cylinder() -> FloatArray:
    """285 points: a line of 15 before a turntable with 19 stops."""
    turn, height = np.meshgrid(np.radians(np.arange(-90, 91, 10)), np.linspace(-350, 350, 15))
    return np.stack([250 * np.sin(turn), height, 250 * np.cos(turn)], -1).reshape(-1, 3)


class Experiments(NamedTuple):
    """Error of r(theta) at 30 to 90 degrees and its stated standard deviation (S, 4), and the verifications."""

    errors: FloatArray
    sigma: FloatArray
    verified: list[Verification]

    @property
    def p_values(self) -> list[float]:
        return [one.chi_square.p_value for one in self.verified]


def experiments(photographer: Any, marks: FloatArray, seeds: range) -> Experiments:
    camera = photographer.camera(aspect=1.0)
    pose = Poses(Rotation.from_euler("YXZ", [[1.0, -0.7, 3.0]], degrees=True).as_matrix(), np.array([[2.0, -1.5, 1.0]]))
    shown = THETA_DEG[1:]
    errors, sigma, verified = [], [], []
    for seed in seeds:
        world = photographer.shoot(camera, pose, marks, NOISE_PX, np.random.default_rng(seed))
        found = calibrate(world.views, camera.size)
        radii = np.radians(shown)
        errors.append(found.camera.lens.radius(radii) - camera.lens.radius(radii))
        sigma.append(curve_of(found).sigma_px[shown])
        verified.append(verify(found))
    return Experiments(np.array(errors), np.array(sigma), verified)


def test_a_cylinder_passes_its_verification_while_the_curve_is_off_and_the_stated_sigma_says_so(
    photographer: Any,
) -> None:
    made = experiments(photographer, paper_s_cylinder(), range(8))
    assert all((one.fit_points, one.verify_points) == (36, 36) for one in made.verified)
    assert np.median(made.p_values) > 0.2
    for one in made.verified:
        assert one.verify_rms_px == pytest.approx(one.expected_verify_rms_px, rel=0.4)
    assert np.median(np.abs(made.errors[:, -1])) > 1.0  # pixels, with residuals of 0.4
    assert np.median(made.sigma[:, -1]) > 1.0
    assert np.all(np.abs(made.errors) < 3.5 * made.sigma)


def test_a_half_cylinder_fixes_the_curve(photographer: Any) -> None:
    made = experiments(photographer, paper_s_half_cylinder(), range(8))
    assert all(one.fit_points + one.verify_points == 285 for one in made.verified)
    assert np.median(made.p_values) > 0.2
    assert np.max(made.sigma) < 0.3
    assert np.all(np.abs(made.errors) < 3.5 * made.sigma)


@pytest.mark.slow
@pytest.mark.parametrize("marks", [paper_s_cylinder, paper_s_half_cylinder])
def test_the_paper_s_experiments_over_100_seeds(photographer: Any, marks: Any) -> None:
    made = experiments(photographer, marks(), range(1000, 1100))
    z = made.errors / made.sigma
    held, rms = np.mean(np.abs(z) < 1.96, 0), np.sqrt(np.mean(z**2, 0))
    passed = np.mean(np.array(made.p_values) > 0.05)
    uniform = stats.kstest(made.p_values, "uniform").pvalue
    off, sigma = np.median(np.abs(made.errors[:, -1])), np.median(made.sigma[:, -1])
    print(f"\n{marks.__name__}: median of 100 runs: r(90) off by {off:.2f} px, stated sigma {sigma:.2f} px")
    print(f"errors over sigma at 30 to 90 degrees: rms {rms.round(2)}, largest {np.abs(z).max():.1f}")
    print(f"1.96 sigma hold in {held}; chi-square passes at 5 % in {passed:.0%}; p uniform: {uniform:.2f}")
    # a share of 100 is known to 2.2 %; no limit for the largest: with so few points some noise is fitted as well by
    # another lens, far off, whose sigma speaks of its own neighbourhood only
    assert np.all((held > 0.87) & (held <= 1.0)) and np.all(rms < 1.25)
    assert uniform > 1e-3 and passed > 0.87
