from __future__ import annotations

import csv
import dataclasses
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.calibrate import Calibration, calibrate, curve_of, locate
from fullsphere.model.calibration.points import Poses, Sightings, View, read_points
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError, UsageError
from fullsphere.model.lens import (
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    EnhancedUnifiedCamera,
    Equidistant,
    Equisolid,
    FloatArray,
    KannalaBrandt,
    Lens,
    Orthographic,
    Perspective,
    ScaledStereographic,
    Scaramuzza,
    Stereographic,
    Thoby,
    UnifiedCamera,
)

SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[3].parent / "shared"))
POINTS = SHARED / "data" / "calibration"
OV_CUBE = POINTS / "ov-cube" / "corners_3d.csv"
SIZE = (1280, 1280)


def curve_error(calibration: Calibration, truth: Camera) -> FloatArray:
    """Found minus true radius in whole degrees of the observed angles."""
    first, last = calibration.observed_theta_deg
    theta = np.radians(np.arange(math.ceil(first), math.floor(last) + 1))
    return calibration.camera.lens.radius(theta) - truth.lens.radius(theta)


@pytest.mark.parametrize(
    ("lens", "half_fov_deg"),
    [
        (BaksteinPajdla(900.0, 3.2, 80.0, 1.3), 95),
        (Equisolid(390.0), 95),
        (Equidistant(350.0), 95),
        (Stereographic(270.0), 95),
        (ScaledStereographic(1250.0, 2.9), 95),
        (Orthographic(600.0), 75),
        (Perspective(600.0), 44),
        (Thoby(400.0), 95),
        (KannalaBrandt(380.0, -0.031, 0.0043, -0.0005, 0.0001), 95),
        (Brown(900.0, -0.2, 0.06, -0.01), 44),
        (Scaramuzza(380.0, -7e-4, 2e-7, -8e-10), 95),
        (UnifiedCamera(380.0, 0.62), 95),
        (EnhancedUnifiedCamera(380.0, 0.62, 1.1), 95),
        (DoubleSphere(330.0, -0.15, 0.6), 95),
        (DoubleSphere(480.0, 0.2, 0.75), 95),
    ],
    ids=lambda value: getattr(value, "projection", ""),
)
def test_exact_measurements_give_the_exact_camera(photographer: Any, lens: Lens, half_fov_deg: float) -> None:
    world = photographer.box_world(0, 0.0, camera=photographer.camera(lens, half_fov_deg))
    found = calibrate(world.views, SIZE, type(lens))
    assert found.rms_px < 1e-6
    assert np.max(np.abs(curve_error(found, world.camera))) < 1e-4
    np.testing.assert_allclose(found.camera.centre, world.camera.centre, atol=1e-4)
    assert found.camera.aspect == pytest.approx(1.002, abs=1e-7)
    np.testing.assert_allclose(found.poses.camera_from_target, world.poses.camera_from_target, atol=1e-6)
    np.testing.assert_allclose(found.poses.translation, world.poses.translation, atol=1e-3)


@pytest.mark.parametrize("lens", [BaksteinPajdla(900.0, 3.2, 80.0, 1.3), Equisolid(390.0)], ids=lambda v: v.projection)
@pytest.mark.parametrize("seed", range(4))
def test_errors_are_as_large_as_noise_and_covariance_say(photographer: Any, lens: Lens, seed: int) -> None:
    sigma = 0.3
    world = photographer.box_world(seed, sigma, camera=photographer.camera(lens))
    found = calibrate(world.views, SIZE, type(lens))
    unknowns = len(found.camera.values) + 6 * len(found.views)
    freedom = 2 * found.points - unknowns
    chi2 = found.points * found.rms_px**2 / sigma**2
    assert stats.chi2.ppf(0.0005, freedom) < chi2 < stats.chi2.ppf(0.9995, freedom)
    curve = curve_of(found)
    within = slice(1, math.floor(found.observed_theta_deg[1]) + 1)
    error = curve.r_px - world.camera.lens.radius(np.radians(curve.theta_deg))
    assert np.max(np.abs(error[within]) / curve.sigma_px[within]) < 4.5
    assert np.all(curve.sigma_px[within] < 0.5)


def test_one_picture_of_a_solid_target_is_enough(photographer: Any) -> None:
    world = photographer.box_world(9, 0.3, views=1)
    found = calibrate(world.views, SIZE)
    assert found.rms_px == pytest.approx(0.3 * math.sqrt(2), rel=0.15)
    assert np.max(np.abs(curve_error(found, world.camera))) < 1.5


def test_flat_targets_calibrate(photographer: Any) -> None:
    rng = np.random.default_rng(10)
    board = np.stack([*(a.ravel() for a in np.meshgrid(np.linspace(-150, 150, 9), np.linspace(-150, 150, 8)))], -1)
    board = np.column_stack([board, np.zeros(len(board))])
    poses = photographer.poses(8, rng, distance=90.0, tilt_deg=45.0)
    world = photographer.shoot(photographer.camera(), poses, board, 0.3, rng)
    found = calibrate(world.views, SIZE)
    assert found.rms_px == pytest.approx(0.3 * math.sqrt(2), rel=0.1)
    assert np.max(np.abs(curve_error(found, world.camera))) < 1.0


def test_covariance_predicts_the_scatter_of_the_curve(photographer: Any) -> None:
    camera = photographer.camera()
    rng = np.random.default_rng(11)
    poses = photographer.poses(2, rng)
    runs = []
    for seed in range(40):
        world = photographer.shoot(camera, poses, _marks(photographer), 0.3, np.random.default_rng(seed))
        runs.append(calibrate(world.views, SIZE))
    theta = np.array([10, 30, 50, 70, 85])
    radii = np.array([run.camera.lens.radius(np.radians(theta)) for run in runs])
    stated = np.array([curve_of(run).sigma_px[theta] for run in runs])
    ratio = radii.std(0, ddof=1) / np.sqrt(np.mean(stated**2, 0))
    assert np.all((ratio > 0.65) & (ratio < 1.4)), ratio
    bias = (radii.mean(0) - camera.lens.radius(np.radians(theta))) / radii.std(0) * math.sqrt(len(runs))
    assert np.all(np.abs(bias) < 4), bias


def _marks(photographer: Any) -> FloatArray:
    marks: FloatArray = photographer.box_world(0, 0.0, views=1).views[0].points_on_target
    return marks


def test_curve_uncertainty_agrees_with_a_dense_reference(photographer: Any) -> None:
    """One dense matrix of central differences over poses and curve, the curve written as a plain polynomial."""
    world = photographer.box_world(12, 0.3, views=2)
    found = calibrate(world.views, SIZE)
    sightings = Sightings.of(world.views)
    rays = sightings.rays(found.poses)
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    outward = rays[:, :2] / np.hypot(rays[:, 0], rays[:, 1])[:, None]
    # tangent of the Bakstein-Pajdla curves at the result, as an orthonormal set of four curves
    nodes = np.radians(np.arange(1.0, 96.0))
    tangent = found.camera.lens.radius_by_parameter(nodes)
    basis, mixing = np.linalg.qr(tangent / np.linalg.norm(tangent, axis=0))
    fit = np.polynomial.chebyshev.Chebyshev.fit
    curves = [fit(nodes, column, 24) for column in basis.T]
    aspect = found.camera.aspect
    by_curve = np.stack([outward * [1, aspect] * curve(theta)[:, None] for curve in curves], -1)
    zero, one = np.zeros(len(theta)), np.ones(len(theta))
    y = found.camera.lens.radius(theta) * outward[:, 1]
    by_frame = np.stack([np.stack([one, zero], 1), np.stack([zero, one], 1), np.stack([zero, y], 1)], -1)
    by_pose = np.zeros((len(theta), 2, 12))
    for k in range(12):
        view, axis = divmod(k, 6)
        nudge = 1e-5 * np.eye(6)[axis]
        ends = []
        for sign in (1, -1):
            rotation, shift = found.poses.camera_from_target.copy(), found.poses.translation.copy()
            rotation[view] = Rotation.from_rotvec(sign * nudge[:3]).as_matrix() @ rotation[view]
            shift[view] += sign * nudge[3:]
            wide = dataclasses.replace(found.camera, half_fov=found.camera.lens.theta_max * 0.999)
            ends.append(wide.project(sightings.rays(Poses(rotation, shift))))
        by_pose[:, :, k] = (ends[0] - ends[1]) / 2e-5
    dense = np.concatenate([by_curve, by_frame, by_pose], -1).reshape(2 * len(theta), -1)
    covariance = np.linalg.inv(dense.T @ dense)[:4, :4]
    variance = found.points * found.rms_px**2 / (2 * found.points - dense.shape[1])
    shown = np.array([10, 30, 60, 85])
    rows = np.stack([curve(np.radians(shown)) for curve in curves], -1)
    reference = np.sqrt(variance * np.sum(rows @ covariance * rows, -1))
    np.testing.assert_allclose(curve_of(found).sigma_px[shown], reference, rtol=2e-3)
    assert np.linalg.cond(mixing) > 100  # the four values are interchangeable, the four curves are not


def test_the_paper_s_cylinder_and_half_cylinder_find_their_start(photographer: Any) -> None:
    """Sections 4 and 6: 72 points at one depth per angle, and 285 on a half cylinder."""
    rng = np.random.default_rng(13)
    camera = photographer.camera()
    theta, phi = np.radians([90, 85, 80, 75, 70, 60, 50, 40, 30]), np.radians(np.arange(0, 360, 45))
    t, p = (a.ravel() for a in np.meshgrid(theta, phi))
    cylinder = 150 * np.stack([np.cos(p), np.sin(p), 1 / np.tan(t)], -1)
    turn, height = np.meshgrid(np.radians(np.arange(-90, 91, 10)), np.linspace(-350, 350, 15))
    half = np.stack([250 * np.sin(turn.ravel()), height.ravel(), 250 * np.cos(turn.ravel())], -1)
    for marks, count, curve_limit in ((cylinder, 72, 15.0), (half, 285, 2.0)):
        pose = Poses(Rotation.from_rotvec([[0.03, -0.02, 0.05]]).as_matrix(), np.array([[4.0, -3.0, 5.0]]))
        world = photographer.shoot(camera, pose, marks, 0.3, rng)
        assert len(world.views[0].pixels) >= count - 2
        found = calibrate(world.views, SIZE)
        expected = 0.3 * math.sqrt(2) * math.sqrt(1 - 13 / (2 * found.points))
        assert found.rms_px == pytest.approx(expected, rel=0.2)
        assert np.max(np.abs(curve_error(found, camera))) < curve_limit


def test_the_result_is_the_same_every_time_and_in_any_order_of_views(photographer: Any) -> None:
    world = photographer.box_world(14, 0.3)
    first, again, reversed_ = (calibrate(v, SIZE) for v in (world.views, world.views, world.views[::-1]))
    assert first.camera == again.camera
    assert np.max(np.abs(curve_error(reversed_, first.camera))) < 1e-3


def test_field_of_view_reaches_the_largest_whole_circle_or_what_was_asked_for(photographer: Any) -> None:
    world = photographer.box_world(15, 0.0, camera=photographer.camera(half_fov_deg=80))
    found = calibrate(world.views, SIZE)
    rim = float(found.camera.lens.radius(found.camera.half_fov))
    assert rim == pytest.approx((1279 - 643.0) + 0.5, abs=0.01)
    assert found.observed_theta_deg[1] <= 80.0
    assert calibrate(world.views, SIZE, half_fov=1.4).camera.half_fov == 1.4
    with pytest.raises(CameraError, match="half field of view"):
        calibrate(world.views, SIZE, half_fov=9.0)


def test_progress_wraps_the_search(photographer: Any) -> None:
    seen = []

    def watched(items: Iterable[Any]) -> Iterable[Any]:
        for item in items:
            seen.append(item)
            yield item

    calibrate(photographer.box_world(16, 0.0, views=1).views, SIZE, progress=watched)
    assert len(seen) > 5


def test_mirrored_and_shuffled_points_are_refused(photographer: Any) -> None:
    world = photographer.box_world(17, 0.3)
    rng = np.random.default_rng(0)
    mirrored = [View(v.image, v.points_on_target * [1, 1, -1], v.pixels) for v in world.views]
    shuffled = [View(v.image, v.points_on_target, rng.permutation(v.pixels)) for v in world.views]
    for views in (mirrored, shuffled):
        with pytest.raises(GeometryError, match="belong together"):
            calibrate(views, SIZE)


def test_wrong_points_among_right_ones_are_rejected(photographer: Any) -> None:
    world = photographer.box_world(21, 0.3)
    pixels = world.views[2].pixels.copy()
    pixels[:4] = pixels[-4:]
    views = [*world.views[:2], View("spoilt.png", world.views[2].points_on_target, pixels)]
    found = calibrate(views, SIZE)
    assert found.rejected == 4 and not found.used[2][:4].any()
    assert found.rms_px < 0.45 < 10 < found.rms_with_rejected_px
    with pytest.raises(GeometryError, match=r"worst .* of spoilt\.png"):
        calibrate(views, SIZE, reject=False)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("flat", [False, True])
def test_a_fifth_of_the_points_may_be_wrong(photographer: Any, seed: int, flat: bool) -> None:
    camera = photographer.camera()
    rng = np.random.default_rng(seed)
    poses = photographer.poses(4, rng, tilt_deg=30.0) if flat else photographer.poses(4, rng)
    marks = flat_marks() if flat else None
    world = photographer.shoot(camera, poses, marks, 0.3, rng) if flat else photographer.box_world(seed, 0.3)
    views, wrong = [], []
    for view in world.views:
        spoilt = rng.random(len(view.pixels)) < 0.2
        pixels = np.where(spoilt[:, None], rng.uniform(0, 1279, view.pixels.shape), view.pixels)
        views.append(View(view.image, view.points_on_target, pixels))
        wrong.append(spoilt)
    found = calibrate(views, SIZE)
    clean = calibrate(world.views, SIZE)
    missed = np.concatenate(found.used) & np.concatenate(wrong)
    assert np.count_nonzero(missed) <= 3  # a wrong point may lie where it belongs
    assert np.count_nonzero(~np.concatenate(found.used) & ~np.concatenate(wrong)) == 0
    theta = np.radians(np.linspace(5, clean.observed_theta_deg[1], 20))
    assert np.abs(found.camera.lens.radius(theta) - clean.camera.lens.radius(theta)).max() < 0.5


def test_a_view_whose_points_are_shuffled_is_left_out_by_name(photographer: Any) -> None:
    world = photographer.box_world(23, 0.3, views=5)
    views = list(world.views)
    views[3] = View("shuffled.png", views[3].points_on_target, np.random.default_rng(0).permutation(views[3].pixels))
    found = calibrate(views, SIZE)
    assert [left.image for left in found.left_out] == ["shuffled.png"]
    assert "of its" in found.left_out[0].reason
    assert len(found.views) == 4 and found.rms_px < 0.45


def test_noise_alone_is_never_rejected(photographer: Any) -> None:
    assert [calibrate(photographer.box_world(seed, 0.5).views, SIZE).rejected for seed in range(30, 40)] == [0] * 10


def test_too_few_points_for_the_unknowns_are_refused(photographer: Any) -> None:
    view = photographer.box_world(18, 0.0, views=1).views[0]
    few = View(view.image, view.points_on_target[::30][:6], view.pixels[::30][:6])
    assert len(few.pixels) == 6
    with pytest.raises(GeometryError, match="6 points give 12 measurements for 13 unknowns"):
        calibrate([few], SIZE)


def test_points_that_leave_the_lens_open_are_refused(photographer: Any) -> None:
    """A board straight before the camera: a longer lens from further away gives nearly the same picture."""
    rng = np.random.default_rng(19)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-60, 60, 6), np.linspace(-60, 60, 6)))
    board = np.stack([x, y, np.zeros(36)], -1)
    pose = Poses(np.eye(3)[None], np.array([[0.0, 0.0, 200.0]]))
    world = photographer.shoot(photographer.camera(), pose, board, 0.3, rng)
    with pytest.raises(GeometryError):
        calibrate(world.views, SIZE)


def test_a_wrong_size_and_an_unknown_lens_are_named(photographer: Any) -> None:
    views = photographer.box_world(20, 0.0, views=1).views
    with pytest.raises(GeometryError, match="outside the picture of 640 x 480"):
        calibrate(views, (640, 480))
    with pytest.raises(UsageError, match="bakstein-pajdla"):
        calibrate(views, SIZE, "fisheye")
    with pytest.raises(GeometryError, match="perspective"):
        calibrate(views, SIZE, "perspective")


def flat_marks() -> FloatArray:
    """(400, 3) marks of a large board with z = 0."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-400, 400, 20), np.linspace(-400, 400, 20)))
    return np.stack([x, y, np.zeros(x.size)], -1)


needs_ov_cube = pytest.mark.skipif(not OV_CUBE.exists(), reason=f"real data: {OV_CUBE} is not here")


@needs_ov_cube
def test_ov_cube_all_pictures() -> None:
    found, plain = (calibrate(read_points(OV_CUBE), (1280, 800), reject=reject) for reject in (True, False))
    assert plain.points == found.points + found.rejected == 3888
    assert plain.rms_px <= 0.2640
    assert found.rms_px <= 0.24 and found.rms_with_rejected_px <= 0.2645
    assert len(found.views) == 15 and found.rejected < 40


@needs_ov_cube
def test_ov_cube_each_picture_alone() -> None:
    views = read_points(OV_CUBE)
    own, others = {}, {}
    for view in views:
        found = calibrate([view], (1280, 800))
        lens = dataclasses.replace(found.camera, half_fov=found.camera.lens.theta_max * (1 - 1e-9))
        residuals = np.concatenate(locate([other for other in views if other is not view], lens)[1])
        own[view.image], others[view.image] = found.rms_px, float(np.sqrt(np.mean(np.sum(residuals**2, 1))))
    assert max(own.values()) < 0.29, own
    assert max(others.values()) <= 0.33, others


def test_from_one_view_pixels_are_square_unless_they_clearly_are_not(photographer: Any) -> None:
    for aspect, expected in ((1.0, 1.0), (1.002, 1.002)):
        world = photographer.box_world(3, 0.3, views=1, camera=photographer.camera(aspect=aspect))
        found = calibrate(world.views, SIZE)
        assert found.camera.aspect == pytest.approx(expected, abs=3e-4)
        assert (found.camera.aspect == 1.0) == (aspect == 1.0)
        assert (found.covariance[-1, -1] == 0.0) == (aspect == 1.0)


# rms that other implementations of the lenses reach on these points
REAL: list[tuple[str, tuple[int, int], str, float]] = [
    ("ov-cube/corners_3d.csv", (1280, 800), "kannala-brandt", 0.2630),
    ("ov-cube/corners_3d.csv", (1280, 800), "double-sphere", 0.2641),
    ("camodocal/corners.csv", (1280, 960), "kannala-brandt", 0.4960),
    ("ov-plane/corners.csv", (1280, 800), "kannala-brandt", 0.4815),
    ("ov-plane/corners.csv", (1280, 800), "double-sphere", 0.4914),
    ("urban-fisheye2/corners.csv", (748, 480), "kannala-brandt", 0.3230),
]


@pytest.mark.skipif(not POINTS.exists(), reason=f"real data: {POINTS} is not here")
@pytest.mark.parametrize(("file", "size", "lens", "rms_px"), REAL)
def test_real_points_through_other_lenses(file: str, size: tuple[int, int], lens: str, rms_px: float) -> None:
    assert calibrate(_views(POINTS / file), size, lens, reject=False).rms_px == pytest.approx(rms_px, abs=2e-4)


@pytest.mark.skipif(not POINTS.exists(), reason=f"real data: {POINTS} is not here")
def test_a_bowed_board_is_seen_to_be_bowed() -> None:
    views = _views(POINTS / "ov-plane" / "corners.csv")  # in cm
    flat, bowed = (calibrate(views, (1280, 800), bow=bow, reject=False) for bow in (False, True))
    assert flat.rms_px <= 0.4830 and flat.bow_mm is None
    assert bowed.rms_px <= 0.4015 and bowed.bow_mm is not None
    assert 0.035 < max(map(abs, bowed.bow_mm)) < 0.05


@pytest.mark.skipif(not POINTS.exists(), reason=f"real data: {POINTS} is not here")
def test_a_polynomial_that_starts_below_90_degrees_grows_to_points_beyond() -> None:
    found = calibrate(_views(POINTS / "ov-plane" / "corners.csv"), (1280, 800), "scaramuzza")
    assert found.observed_theta_deg[1] > 92
    assert found.rms_px < 0.8


def _views(path: Path) -> list[View]:
    """Views of a table whose columns are named as here, or X, Y, Z, u, v."""
    rows: dict[str, list[list[float]]] = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            names = ("x_mm", "y_mm", "z_mm", "u_px", "v_px") if "x_mm" in row else ("X", "Y", "Z", "u", "v")
            rows.setdefault(row["image"], []).append([float(row[name]) for name in names])
    return [View(image, np.array(v)[:, :3], np.array(v)[:, 3:]) for image, v in rows.items()]
