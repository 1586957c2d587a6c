from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.assess import Assessment, assess
from fullsphere.model.calibration.calibrate import Calibration, calibrate
from fullsphere.model.calibration.coverage import coverage
from fullsphere.model.calibration.difference import difference
from fullsphere.model.calibration.observability import Weakest, weakest
from fullsphere.model.calibration.points import Poses, Sightings, View
from fullsphere.model.calibration.ray_errors import ray_sigma, ray_sigma_map
from fullsphere.model.calibration.trends import radial_trend
from fullsphere.model.calibration.verification import chi_square, verify
from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError, UsageError
from fullsphere.model.lens import Equidistant, FloatArray, KannalaBrandt, Stereographic

SIZE = (1280, 1280)
NOISE = 0.3
SEEDS = 14


@pytest.fixture(scope="module")
def worlds(photographer: Any) -> list[Any]:
    return [photographer.box_world(seed, NOISE, views=2) for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def found(worlds: list[Any]) -> list[Calibration]:
    return [calibrate(world.views, SIZE, reject=False) for world in worlds]


@pytest.fixture(scope="module")
def assessed(found: list[Calibration]) -> list[Assessment]:
    return [assess(calibration) for calibration in found]


def assert_uniform(p_values: list[float]) -> None:
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3, sorted(p_values)


@pytest.mark.parametrize("which", range(4))
def test_p_values_of_trends_are_uniform_where_nothing_is_systematic(assessed: list[Assessment], which: int) -> None:
    assert_uniform([a.trends[which].p_value for a in assessed])


@pytest.mark.parametrize("which", range(4))
def test_p_values_of_harmonics_are_uniform_where_nothing_is_systematic(assessed: list[Assessment], which: int) -> None:
    assert_uniform([a.harmonics[which].p_value for a in assessed])


def test_means_of_bins_scatter_as_their_errors_say(assessed: list[Assessment]) -> None:
    for which in range(4):
        bins = [a.trends[which].bins for a in assessed]
        scores = np.concatenate([b.mean_px / b.error_px for b in bins])
        assert np.std(scores) == pytest.approx(1, abs=0.12)
        assert all(b.count.sum() == a.calibration.points for a, b in zip(assessed, bins, strict=True))


def test_the_chi_square_test_of_the_other_half_is_uniform(found: list[Calibration]) -> None:
    assert_uniform([verify(calibration, seed).chi_square.p_value for seed, calibration in enumerate(found)])


def test_the_halves_have_the_expected_rms(found: list[Calibration], assessed: list[Assessment]) -> None:
    halves = [a.verification for a in assessed]
    assert all(half is not None for half in halves)
    fit = [half.fit_rms_px / half.expected_fit_rms_px for half in halves if half]
    other = [half.verify_rms_px / half.expected_verify_rms_px for half in halves if half]
    assert np.mean(fit) == pytest.approx(1, abs=0.02)
    assert np.mean(other) == pytest.approx(1, abs=0.02)
    assert np.mean([half.ratio for half in halves if half]) > 1.03  # what a fit takes from noise, the other half pays
    first = halves[0]
    assert first is not None
    assert first.fit_points + first.verify_points == found[0].points
    assert first.expected_fit_rms_px == pytest.approx(
        found[0].sigma_px * math.sqrt(2) * math.sqrt(1 - 19 / (2 * first.fit_points))
    )
    assert first.sigma_px == pytest.approx(NOISE, rel=0.2)


def test_chi_square_counts_and_rejects_what_is_not_normal() -> None:
    rng = np.random.default_rng(0)
    exact = -2 * np.log(1 - (np.arange(1000) + 0.5) / 1000)
    even = chi_square(exact, 10**9)
    assert even.counts.tolist() == [100] * 10
    assert even.statistic == pytest.approx(0, abs=1e-9)
    assert even.p_value == pytest.approx(1)
    np.testing.assert_allclose(even.edges[:3], [0, -2 * math.log(0.9), -2 * math.log(0.8)])
    few = chi_square(exact[::83], 10**9)
    assert (len(few.counts), len(few.edges), few.freedom) == (4, 5, 3)
    heavy = np.sum(rng.standard_t(3, (1000, 2)) ** 2, -1) / 3
    assert chi_square(heavy, 2000).p_value < 1e-6
    p_values = []
    for _ in range(300):  # a sigma estimated from as many other residuals
        q = np.sum(rng.normal(0, 1, (200, 2)) ** 2, -1)
        p_values.append(chi_square(q / np.mean(rng.normal(0, 1, 400) ** 2), 400).p_value)
    assert_uniform(p_values)


def ray_error_ratios(worlds: list[Any], found: list[Calibration]) -> tuple[FloatArray, FloatArray]:
    """Rms error of rays at six pixels over the stated one: relative, absolute."""
    pixels = np.array([[643, 637], [643, 337], [343, 637], [643, 1137], [900, 900], [250, 300]], float)
    stated, actual = np.zeros((2, len(pixels))), np.zeros((2, len(pixels)))
    for world, calibration in zip(worlds, found, strict=True):
        reached = math.radians(calibration.observed_theta_deg[1])
        mine, theirs = (dataclasses.replace(c, half_fov=reached) for c in (calibration.camera, world.camera))
        turn = difference(theirs, mine, across=40).first_from_second
        rays, truth = calibration.camera.unproject(pixels), world.camera.unproject(pixels)
        for k, (error, relative) in enumerate(((rays @ turn.T - truth, True), (rays - truth, False))):
            actual[k] += np.sum(error**2, -1)
            stated[k] += ray_sigma(calibration, pixels, relative) ** 2
    assert np.all(stated[0] <= stated[1] * 1.001)
    first, second = np.sqrt(actual / stated)
    return first, second


def test_ray_errors_are_as_large_as_stated(worlds: list[Any], found: list[Calibration]) -> None:
    for ratio in ray_error_ratios(worlds, found):
        assert np.all((ratio > 0.5) & (ratio < 1.6)), ratio


@pytest.mark.slow
def test_statistics_over_many_seeds(photographer: Any) -> None:
    worlds = [photographer.box_world(seed, NOISE, views=2) for seed in range(1000, 1300)]
    found = [calibrate(world.views, SIZE, reject=False) for world in worlds]
    for ratio in ray_error_ratios(worlds, found):
        assert np.all((ratio > 0.88) & (ratio < 1.12)), ratio
    made = [assess(calibration) for calibration in found]
    for which in range(4):
        assert_uniform([a.trends[which].p_value for a in made])
        assert_uniform([a.harmonics[which].p_value for a in made])
    assert_uniform([a.verification.chi_square.p_value for a in made if a.verification])


def test_ray_errors_of_a_map_are_nan_outside_the_field_of_view(found: list[Calibration]) -> None:
    narrow = dataclasses.replace(found[0], camera=dataclasses.replace(found[0].camera, half_fov=1.0))
    shown = ray_sigma_map(narrow, across=20)
    pixels = np.stack(np.meshgrid(shown.u_px, shown.v_px), -1)
    seen = np.isfinite(narrow.camera.unproject(pixels)[..., 0])
    assert 0 < seen.sum() < seen.size
    np.testing.assert_array_equal(np.isfinite(shown.relative_rad), seen)
    np.testing.assert_array_equal(np.isfinite(shown.absolute_rad), seen)


def test_ray_errors_agree_with_differences_of_the_camera(found: list[Calibration]) -> None:
    calibration = found[0]
    pixel = np.array([900.0, 300.0])
    ray, columns = calibration.camera.unproject(pixel), []
    for k, value in enumerate(calibration.camera.values):
        step = 1e-5 * max(abs(value), 1.0)
        ends = []
        for sign in (1, -1):
            values = calibration.camera.values
            values[k] += sign * step
            ends.append(calibration.camera.with_values(values).unproject(pixel))
        columns.append((ends[0] - ends[1]) / (2 * step))
    by_value = np.stack(columns, -1)
    assert abs(ray @ by_value).max() < 1e-6
    expected = np.linalg.norm(by_value @ calibration.covariance_factor)
    assert ray_sigma(calibration, pixel, relative=False) == pytest.approx(expected, rel=1e-3)


def test_a_wrong_lens_shows_in_the_radial_trend(photographer: Any) -> None:
    world = photographer.box_world(3, NOISE, views=4)
    wrong, right = (calibrate(world.views, SIZE, lens) for lens in ("equidistant", "bakstein-pajdla"))
    trend = radial_trend(wrong)
    assert trend.p_value < 1e-12
    worst = int(np.argmax(np.abs(trend.bins.mean_px)))
    assert trend.largest_px == trend.bins.mean_px[worst]
    assert abs(trend.largest_px) > 1
    assert abs(radial_trend(right).largest_px) < 0.2
    flags = assess(wrong).flags
    assert any("radial residual follows theta" in flag for flag in flags)
    assert not any("residual follows" in flag for flag in assess(right).flags)


def test_a_wave_round_the_axis_is_found(photographer: Any) -> None:
    world = photographer.box_world(4, 0.1, views=3)
    views = []
    for view in world.views:
        x, y = (view.pixels - world.camera.centre).T
        phi = np.arctan2(y, x)
        wave = 0.2 * np.cos(2 * phi)
        views.append(View(view.image, view.points_on_target, view.pixels + wave[:, None] * np.stack([x, y], -1) / 400))
    waves = {(w.part, w.order): w for w in assess(calibrate(views, SIZE)).harmonics}
    assert waves["radial", 2].p_value < 1e-6
    assert waves["radial", 2].amplitude_px > 0.03


def test_errors_by_point_and_by_view_add_up(photographer: Any) -> None:
    world = photographer.box_world(5, NOISE, views=3)
    pixels = world.views[1].pixels.copy()
    pixels[7] += 40
    views = [world.views[0], dataclasses.replace(world.views[1], pixels=pixels), world.views[2]]
    calibration = calibrate(views, SIZE)
    assert calibration.rejected == 1
    made = assess(calibration)
    assert made.points.count.sum() == calibration.points
    total = math.sqrt(float(np.sum(made.points.count * made.points.rms_px**2)) / calibration.points)
    assert total == pytest.approx(calibration.rms_px)
    assert [(v.used, v.rejected) for v in made.views] == [
        (len(v.pixels) - k, k) for v, k in zip(calibration.views, (0, 1, 0), strict=True)
    ]
    first = made.views[0]
    distance = np.hypot(*calibration.residuals_px[0].T)
    assert first.worst_px == distance.max()
    assert first.worst_at_px == tuple(views[0].pixels[np.argmax(distance)])
    mark = made.points.points[0]
    mine = [
        residuals[used & np.all(view.points_on_target == mark, axis=1)]
        for view, residuals, used in zip(calibration.views, calibration.residuals_px, calibration.used, strict=True)
    ]
    np.testing.assert_allclose(made.points.mean_px[0], np.concatenate(mine).mean(0))


def test_too_few_points_are_not_verified_but_said() -> None:
    """13 unknowns, 9 points: half of them determine nothing."""
    rng = np.random.default_rng(6)
    camera = Camera(Equidistant(350.0), SIZE, (640.0, 640.0), half_fov=1.5)
    points = rng.uniform(-1, 1, (9, 3)) * [200, 200, 60] + [0, 0, 150]
    found = calibrate([View("few.png", points, camera.project(points))], SIZE, "equidistant")
    made = assess(found)
    assert made.verification is None
    assert "12 points" in made.verification_missing
    assert any("Not verified" in flag for flag in made.flags)


def test_coverage_says_what_was_not_seen(photographer: Any) -> None:
    whole = coverage(calibrate(photographer.box_world(7, NOISE, views=6).views, SIZE, half_fov=math.radians(95)))
    assert whole.flags == ()
    assert whole.covered > 0.95
    assert whole.extrapolated < 0.05
    half = []
    for view in photographer.box_world(7, NOISE, views=6).views:
        right = view.pixels[:, 0] > 620
        half.append(View(view.image, view.points_on_target[right], view.pixels[right]))
    found = coverage(calibrate(half, SIZE))
    assert found.covered < 0.75
    assert abs(found.gap_phi_deg) > 120
    assert any("hole" in flag and "left" in flag for flag in found.flags)
    inner = coverage(
        calibrate(photographer.box_world(7, NOISE, views=6, camera=photographer.camera(half_fov_deg=70)).views, SIZE)
    )
    assert any("extrapolated" in flag for flag in inner.flags)
    assert 0.1 < inner.extrapolated < 0.6
    assert inner.observed_theta_deg[1] < 70.1


def test_one_view_of_rings_at_one_depth_each_is_flagged(photographer: Any) -> None:
    rng = np.random.default_rng(13)
    theta, phi = np.radians([90, 85, 80, 75, 70, 60, 50, 40, 30]), np.radians(np.arange(0, 360, 10))
    t, p = (a.ravel() for a in np.meshgrid(theta, phi))
    cylinder = 150 * np.stack([np.cos(p), np.sin(p), 1 / np.tan(t)], -1)
    pose = Poses(Rotation.from_rotvec([[0.005, -0.005, 0.05]]).as_matrix(), np.array([[0.5, -0.5, 1.0]]))
    world = photographer.shoot(photographer.camera(), pose, cylinder, NOISE, rng)
    flags = coverage(calibrate(world.views, SIZE)).flags
    assert any("entrance pupil" in flag for flag in flags)
    assert any("one distance only" in flag for flag in flags)
    assert any("of the axis" in flag for flag in flags)
    box = coverage(calibrate(photographer.box_world(9, NOISE, views=1).views, SIZE))
    assert any("entrance pupil" in flag for flag in box.flags)
    assert not any("one distance only" in flag for flag in box.flags)


def loosest(photographer: Any, pose: Poses, marks: FloatArray) -> Weakest:
    world = photographer.shoot(photographer.camera(), pose, marks, 0.0, np.random.default_rng(0))
    sightings = Sightings.of(world.views)
    return weakest(world.camera, sightings.rays(world.poses), sightings.view)


def test_what_is_worst_determined_is_named(photographer: Any) -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-60, 60, 6), np.linspace(-60, 60, 6)))
    board = np.stack([x, y, np.zeros(36)], -1)
    ahead = np.array([[0.0, 0.0, 200.0]])
    straight = loosest(photographer, Poses(np.eye(3)[None], ahead), board)
    assert set(straight.groups) == {"the scale of the lens", "the distance of the target"}
    assert straight.hidden > 1000
    turns = Rotation.from_rotvec([[0.4, 0, 0], [-0.4, 0, 0], [0.01, 0.4, 0], [0, -0.4, 0]]).as_matrix()
    tilted = loosest(photographer, Poses(turns, np.repeat(ahead, 4, axis=0)), board)
    assert tilted.hidden < 0.1 * straight.hidden
    near = loosest(
        photographer, Poses(turns, np.array([[30, 0, 50], [-30, 0, 50], [0, 30, 50], [0, -30, 50.0]])), board
    )
    assert near.hidden < tilted.hidden
    again = loosest(photographer, Poses(np.repeat(np.eye(3)[None], 5, axis=0), np.repeat(ahead, 5, axis=0)), board)
    assert again.hidden == pytest.approx(straight.hidden, rel=0.01)  # more pictures from one pose tell nothing more
    assert "distances" in again.text


def test_a_hidden_change_is_as_small_in_the_picture_as_stated(photographer: Any) -> None:
    """A board straight ahead, 1 % further off and through a lens 1 % longer, poses and lens free to adapt."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-60, 60, 6), np.linspace(-60, 60, 6)))
    board = np.stack([x, y, np.zeros(36)], -1)
    camera = photographer.camera()
    near, far = (board + np.array([0, 0, distance]) for distance in (200, 202))
    longer = dataclasses.replace(camera, lens=camera.lens.scaled(1.01))
    moved = np.linalg.norm(camera.project(far) - camera.project(near))
    both = np.linalg.norm(longer.project(far) - camera.project(near))
    found = weakest(camera, near, np.zeros(36, int))
    assert both < 0.1 * moved
    assert found.hidden > moved / both  # and with a little tilt, centre and shape it hides better still


def wide(lens: Any, centre: tuple[float, float] = (640.0, 640.0), half_fov: float = 1.6) -> Camera:
    return Camera(lens, SIZE, centre, half_fov=half_fov)


def test_one_curve_by_two_lenses_differs_by_nothing() -> None:
    same = difference(wide(Equidistant(380.0)), wide(KannalaBrandt(380.0, 0.0, 0.0, 0.0, 0.0)))
    assert same.largest_rad < 1e-12
    assert same.largest_px < 1e-9
    assert same.rotation_deg < 1e-6
    np.testing.assert_allclose(same.first_from_second, np.eye(3), atol=1e-12)


def test_a_shifted_centre_is_mostly_a_rotation() -> None:
    shifted = difference(wide(Equidistant(380.0)), wide(Equidistant(380.0), (641.0, 640.0)))
    assert shifted.rotation_deg == pytest.approx(math.degrees(1 / 380), rel=0.3)
    assert shifted.rms_px < 0.5
    assert shifted.profile_rad[0] < shifted.profile_rad[-1]


def test_the_difference_of_two_curves_is_that_of_their_angles() -> None:
    first, second = wide(Equidistant(380.0)), wide(Equidistant(383.8))
    found = difference(first, second)
    assert found.rotation_deg < 0.01
    np.testing.assert_allclose(found.profile_rad, np.radians(found.theta_deg) * (1 - 380 / 383.8), atol=5e-5)
    assert found.largest_theta_deg == pytest.approx(math.degrees(1.6), abs=1)
    assert found.largest_rad == pytest.approx(1.6 * (1 - 380 / 383.8), rel=0.02)
    radius = np.hypot(*(np.stack(np.meshgrid(found.u_px, found.v_px), -1) - 640).transpose(2, 0, 1))
    length: FloatArray = np.linalg.norm(found.shift_px, axis=-1)
    inside = np.isfinite(length)
    np.testing.assert_allclose(length[inside], radius[inside] * (1 - 380 / 383.8), atol=0.02)
    assert np.isnan(found.angle_rad[0, 0])


def test_cameras_that_cannot_be_compared_are_refused() -> None:
    first = wide(Equidistant(380.0))
    with pytest.raises(UsageError, match="1280 x 1280 and 640 x 480"):
        difference(first, Camera(Stereographic(200.0), (640, 480), (320.0, 240.0), half_fov=1.0))
    with pytest.raises(GeometryError, match="nothing in common"):
        difference(wide(Equidistant(380.0), half_fov=0.1), wide(Equidistant(380.0), (1200.0, 640.0), half_fov=0.1))
