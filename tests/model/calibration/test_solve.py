from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration import reduction
from fullsphere.model.calibration import solve as solving
from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.calibration.linear_pose import linear_poses
from fullsphere.model.calibration.points import Poses, Sightings
from fullsphere.model.calibration.solve import descend, solve
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import BaksteinPajdla, Equisolid, Lens, Perspective, ScaledStereographic


def test_triangles_hold_the_squares_of_their_rows() -> None:
    rng = np.random.default_rng(2)
    counts = [3, 64, 65, 2500]
    view = np.repeat(np.arange(4), counts)
    rows = rng.normal(size=(view.size, 2, 9))
    triangles = reduction.triangles_by_view(rows, view, 4)
    for k in range(4):
        own = rows[view == k].reshape(-1, 9)
        np.testing.assert_allclose(triangles[k].T @ triangles[k], own.T @ own, atol=1e-10 * counts[k])


@pytest.mark.parametrize("flat", [False, True])
def test_linear_poses_are_exact_for_exact_rays_past_90_degrees(photographer: Any, flat: bool) -> None:
    rng = np.random.default_rng(3)
    camera, poses = photographer.camera(), photographer.poses(5, rng)
    marks = rng.uniform(-250, 250, (60, 3)) * [1, 1, 0 if flat else 1]
    sightings = Sightings.of(photographer.shoot(camera, poses, marks, 0.0, rng).views)
    found = linear_poses(sightings, camera)
    np.testing.assert_allclose(found.camera_from_target, poses.camera_from_target, atol=1e-9)
    np.testing.assert_allclose(found.translation, poses.translation, atol=1e-6)


@pytest.mark.parametrize(
    "truth", [Equisolid(350.0), ScaledStereographic(1250.0, 2.9), BaksteinPajdla(900, 3.2, 80, 1.3)]
)
def test_a_fitted_lens_follows_the_curve_it_is_given(truth: Lens) -> None:
    theta = np.radians(np.linspace(1, 95, 60))
    lens = fitted_lenses(BaksteinPajdla, theta, truth.radius(theta))[0]
    assert np.max(np.abs(lens.radius(theta) - truth.radius(theta))) < 3.0
    assert lens.theta_max > theta[-1]


def test_no_perspective_lens_is_fitted_past_90_degrees() -> None:
    theta = np.radians(np.linspace(1, 95, 60))
    with pytest.raises(GeometryError, match="95 degrees"):
        fitted_lenses(Perspective, theta, 300 * theta)


@pytest.mark.parametrize("ratios", [(3.0, 9.0), (2.0, 5.0), (9.0, 3.0), (1.3, 1.15)])
def test_starts_of_very_different_shape_reach_one_minimum(photographer: Any, ratios: tuple[float, float]) -> None:
    world = photographer.box_world(4, noise_px=0.3)
    sightings = Sightings.of(world.views)
    best = solve(sightings, world.camera, world.poses)
    theta = np.linspace(0.01, world.camera.half_fov, 100)
    shape = BaksteinPajdla(1.0, ratios[0], 1.0, ratios[1]).radius_by_parameter(theta)[:, [0, 2]]
    a, c = np.linalg.lstsq(shape, world.camera.lens.radius(theta), rcond=None)[0]
    start = dataclasses.replace(world.camera, lens=BaksteinPajdla(a, ratios[0], c, ratios[1]), half_fov=1.5)
    found = solve(sightings, start, world.poses)
    assert found.rms_px == pytest.approx(best.rms_px, abs=1e-6)
    assert np.max(np.abs(found.camera.lens.radius(theta) - best.camera.lens.radius(theta))) < 1e-2
    assert found.iterations <= 12


def test_values_that_are_not_free_stay(photographer: Any) -> None:
    world = photographer.box_world(5, noise_px=0.3)
    moved = dataclasses.replace(world.camera, centre=(650.0, 630.0))
    turned = Rotation.from_rotvec([0.02, 0.0, -0.01]).as_matrix() @ world.poses.camera_from_target
    solution = descend(Sightings.of(world.views), moved, Poses(turned, world.poses.translation), ("centre_u_px",))
    assert solution.converged
    assert solution.camera.lens == world.camera.lens
    assert solution.camera.centre[1] == 630.0
    assert solution.camera.centre[0] != 650.0
    assert solution.triangle.shape == (1, 1)


def test_an_end_short_of_the_minimum_is_an_error_that_says_what_was_reached(
    photographer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = photographer.box_world(6, noise_px=0.3)
    far = dataclasses.replace(world.camera, lens=Equisolid(300.0))
    monkeypatch.setattr(solving.descend, "__defaults__", (None, 2, None))
    with pytest.raises(GeometryError, match=r"2 steps reached rms [0-9.]+ px"):
        solve(Sightings.of(world.views), far, world.poses)


def test_a_start_outside_the_lens_is_refused(photographer: Any) -> None:
    world = photographer.box_world(7, noise_px=0.0)
    narrow = dataclasses.replace(world.camera, lens=Perspective(300.0), half_fov=1.0)
    with pytest.raises(GeometryError, match="domain of the perspective lens"):
        descend(Sightings.of(world.views), narrow, world.poses)
