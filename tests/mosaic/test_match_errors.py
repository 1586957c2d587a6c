"""Residuals of matches on the sphere, and their derivatives."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turning import matched, ring

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equisolid, FloatArray
from fullsphere.mosaic.match_errors import MatchArrays, MatchErrors, held_out_px, match_errors
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig
from laws import central_difference, fisheye

FISHEYE = fisheye(800, aspect=1.01)
OTHER = Camera(Equisolid(300.0), (900, 800), (452.0, 397.0), half_fov=1.6, aspect=0.99)
TRUTH = ring(5)
ONE, TWO = Rig.of_one_camera(5), Rig(np.array([0, 0, 1, 0, 1]), np.arange(5))


def link_of_two_cameras(count: int) -> Link:
    """Frames 1 and 2, the second taken by the other camera."""
    (link,) = matched(FISHEYE, TRUTH, [(1, 2)], count=count)
    rays = FISHEYE.unproject(link.pixels_i) @ link.j_from_i.T
    seen = np.isfinite(OTHER.project(rays)[:, 0])
    return dataclasses.replace(link.kept(seen), pixels_j=OTHER.project(rays[seen]))


@pytest.mark.parametrize("rig", [ONE, TWO], ids=["one camera", "two cameras"])
def test_derivatives_are_those_of_the_residuals(rig: Rig) -> None:
    """At matches without error, where the whitening of a residual of zero does not count."""
    link = matched(FISHEYE, TRUTH, [(1, 2)], count=60)[0] if rig is ONE else link_of_two_cameras(60)
    matches, cameras = MatchArrays.of([link]), (FISHEYE, OTHER)
    errors = match_errors(matches, TRUTH, cameras, rig)
    np.testing.assert_allclose(errors.residual, 0, atol=1e-9)

    def turned(frame: int) -> Callable[[FloatArray], FloatArray]:
        def residual(turn: FloatArray) -> FloatArray:
            moved = TRUTH.copy()
            moved[frame] = Rotation.from_rotvec(turn).as_matrix() @ moved[frame]
            return match_errors(matches, moved, cameras, rig).residual

        return residual

    def changed(index: int) -> Callable[[FloatArray], FloatArray]:
        def residual(values: FloatArray) -> FloatArray:
            others = list(cameras)
            others[index] = cameras[index].with_values(values)
            return match_errors(matches, TRUTH, others, rig).residual

        return residual

    def near(found: FloatArray, expected: FloatArray) -> None:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())

    near(errors.by_i, central_difference(turned(1), np.zeros(3), 1e-4))
    near(errors.by_j, central_difference(turned(2), np.zeros(3), 1e-4))
    by_first = central_difference(changed(0), FISHEYE.values, 1e-4)
    if rig is ONE:
        near(errors.by_camera_i + errors.by_camera_j, by_first)
    else:
        near(errors.by_camera_i, by_first)
        near(errors.by_camera_j[..., : len(OTHER.values)], central_difference(changed(1), OTHER.values, 1e-4))
        assert not errors.by_camera_j[..., len(OTHER.values) :].any()


def test_the_kernel_is_its_slow_twin() -> None:
    """Whitening and derivatives with matrices as the equations say it."""
    link = link_of_two_cameras(40)
    link = dataclasses.replace(link, pixels_j=link.pixels_j + np.random.default_rng(3).normal(size=link.pixels_j.shape))
    found = match_errors(MatchArrays.of([link]), TRUTH, (FISHEYE, OTHER), TWO)
    turn = TRUTH[2] @ TRUTH[1].T
    for m, (pixel_i, pixel_j) in enumerate(zip(link.pixels_i, link.pixels_j, strict=True)):
        ray_i = FISHEYE.unproject(pixel_i)
        ray_j = turn @ ray_i
        at_i, at_j = FISHEYE.project_with_jacobians(ray_i), OTHER.project_with_jacobians(ray_j)
        carried = at_j.d_pixel_d_ray @ turn @ np.linalg.pinv(at_i.d_pixel_d_ray)
        whiten = np.linalg.inv(np.linalg.cholesky(np.eye(2) + carried @ carried.T))
        cross_i, cross_j = (np.cross(np.eye(3), ray) for ray in (ray_i, ray_j))
        values = len(OTHER.values)
        np.testing.assert_allclose(found.residual[m], whiten @ (at_j.pixels - pixel_j), atol=1e-9)
        np.testing.assert_allclose(found.by_i[m], whiten @ at_j.d_pixel_d_ray @ turn @ cross_i, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(found.by_j[m], -whiten @ at_j.d_pixel_d_ray @ cross_j, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(found.by_camera_i[m], -whiten @ carried @ at_i.d_pixel_d_parameter, atol=1e-6)
        np.testing.assert_allclose(found.by_camera_j[m, :, :values], whiten @ at_j.d_pixel_d_parameter, atol=1e-6)


def test_whitened_residuals_have_the_covariance_of_a_keypoint() -> None:
    """Half of the noise lies in frame i and is carried over by the projection: unit covariance all the same."""
    residuals = []
    for seed in range(60):
        links = matched(FISHEYE, TRUTH, [(0, 1)], count=50, noise_px=0.1, seed=seed)
        residuals.append(match_errors(MatchArrays.of(links), TRUTH, (FISHEYE,), ONE).residual / 0.1)
    np.testing.assert_allclose(np.cov(np.concatenate(residuals).T), np.eye(2), atol=0.1)


def test_distances_of_matches_held_back_are_those_on_the_sphere() -> None:
    """A turn of the second frame about its axis moves a ray by the angle times the sine of its distance to the axis."""
    (link,) = matched(FISHEYE, TRUTH, [(1, 2)], count=50)
    link = dataclasses.replace(link, held_i=link.pixels_i, held_j=link.pixels_j)
    assert held_out_px([link], TRUTH, (FISHEYE,), ONE).max() < 1e-6
    turned = TRUTH.copy()
    turned[2] = Rotation.from_rotvec([0, 0, 1e-3]).as_matrix() @ turned[2]
    sine = np.linalg.norm(FISHEYE.unproject(link.held_j)[:, :2], axis=1)
    expected = 1e-3 * sine * FISHEYE.image_radius / FISHEYE.half_fov
    np.testing.assert_allclose(held_out_px([link], turned, (FISHEYE,), ONE), expected, rtol=1e-4)


def test_without_links_there_is_nothing() -> None:
    assert MatchArrays.of([]).pixels_i.shape == (0, 2)
    errors = match_errors(MatchArrays.of([]), TRUTH, (FISHEYE,), ONE)
    assert isinstance(errors, MatchErrors)
    assert errors.by_i.shape == (0, 2, 3)
