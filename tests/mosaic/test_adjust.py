"""Bundle adjustment on the sphere against known truth, its derivatives, and the accuracy it states."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turning import matched, ring, turn_between, turned

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.mosaic.adjust import adjust, with_same_circle
from laws import fisheye

CAMERA = fisheye(800, aspect=1.01)
COUNT = 5
TRUTH = ring(COUNT)
GROUP = np.arange(COUNT)
LENS = ("a_px", "b", "c_px", "d")
CENTRE = ("centre_u_px", "centre_v_px")


def curve_difference_px(a: Camera, b: Camera) -> float:
    """The largest difference of the two curves r(theta) inside the field of view that matches come from."""
    theta = np.linspace(0, 0.9 * CAMERA.half_fov, 50)
    return float(np.abs(a.lens.radius(theta) - b.lens.radius(theta)).max())


def bent(camera: Camera) -> Camera:
    """The camera known badly: the curve up to ten pixels off, the centre by some."""
    a, b, c, d, u, v, aspect = camera.values
    moved = with_same_circle(camera, np.array([1.03 * a, b, 0.97 * c, d, u + 4, v - 3, aspect]))
    assert moved is not None
    return moved


def test_without_noise_the_truth_comes_back() -> None:
    result = adjust(matched(CAMERA, TRUTH), turned(TRUTH, 3), GROUP, [CAMERA])
    assert turn_between(result.rotations, TRUTH).max() < 1e-9
    assert result.cost < 1e-12
    assert max(r.max() for r in result.residuals_px) < 1e-6
    assert result.cameras[0] == CAMERA


def test_without_noise_the_camera_comes_back_too() -> None:
    links = matched(CAMERA, TRUTH)
    result = adjust(links, turned(TRUTH, 1), GROUP, [bent(CAMERA)], (*LENS, *CENTRE), tolerance=1e-12)
    assert turn_between(result.rotations, TRUTH).max() < 1e-6
    assert curve_difference_px(result.cameras[0], CAMERA) < 1e-3
    np.testing.assert_allclose(result.cameras[0].centre, CAMERA.centre, atol=1e-3)
    assert result.cameras[0].aspect == CAMERA.aspect  # it was not free


def test_the_first_frame_and_those_outside_the_group_stay() -> None:
    start = turned(TRUTH, 2)
    start[0] = TRUTH[0]
    links = matched(CAMERA, TRUTH, [(1, 2), (2, 3), (1, 3)])
    result = adjust(links, start, np.array([1, 2, 3]), [CAMERA])
    np.testing.assert_array_equal(result.rotations[[0, 1, 4]], start[[0, 1, 4]])
    assert result.sigma[[0, 4]].tolist() == [0, 0]
    between = result.rotations[3] @ result.rotations[1].T
    assert turn_between(between, TRUTH[3] @ TRUTH[1].T) < 1e-9


def errors_and_sigmas(
    seeds: Sequence[int], outliers: float = 0.0, free: Sequence[str] = ()
) -> tuple[FloatArray, FloatArray]:
    """Angles (runs, frames) in radians off the truth in the mean world, and the standard deviations stated."""
    errors, sigmas = [], []
    for seed in seeds:
        links = matched(CAMERA, TRUTH, noise_px=0.4, outliers=outliers, seed=seed)
        result = adjust(links, turned(TRUTH, 1, seed), GROUP, [CAMERA], free)
        world = Rotation.from_matrix(np.swapaxes(TRUTH, 1, 2) @ result.rotations)
        errors.append((world.mean().inv() * world).magnitude())
        sigmas.append(result.sigma)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize(("free", "runs"), [((), 30), ((*LENS, *CENTRE), 5)], ids=["camera known", "camera free"])
def test_the_stated_sigma_is_the_scatter(free: Sequence[str], runs: int) -> None:
    """Over many runs of 5 frames the root mean square angle is sigma, a tenth or so more or less."""
    errors, sigmas = errors_and_sigmas(range(runs), free=free)
    normal = errors / sigmas
    assert normal.max() < 4
    assert np.sqrt(np.mean(normal**2)) == pytest.approx(1, abs=0.2)


def test_a_fifth_of_wrong_matches_does_not_move_the_result() -> None:
    clean, sigma = errors_and_sigmas(range(5))
    spoilt, _ = errors_and_sigmas(range(5), outliers=0.2)
    assert spoilt.max() < 4 * sigma.max()
    assert np.sqrt(np.mean(spoilt**2)) < 1.6 * np.sqrt(np.mean(clean**2))


def test_residuals_are_the_noise_of_one_keypoint() -> None:
    result = adjust(matched(CAMERA, TRUTH, count=120, noise_px=0.5), TRUTH, GROUP, [CAMERA])
    every = np.concatenate(result.residuals_px)
    assert np.sqrt(np.mean(every**2) / 2) == pytest.approx(0.5, rel=0.08)
    assert [len(r) for r in result.residuals_px] == [len(link.pixels_i) for link in matched(CAMERA, TRUTH, count=120)]


def test_camera_parameters_within_the_noise() -> None:
    links = matched(CAMERA, TRUTH, count=150, noise_px=0.3)
    result = adjust(links, turned(TRUTH, 1), GROUP, [bent(CAMERA)], (*LENS, *CENTRE, "aspect"))
    assert curve_difference_px(result.cameras[0], CAMERA) < 0.4
    np.testing.assert_allclose(result.cameras[0].centre, CAMERA.centre, atol=0.3)
    assert result.cameras[0].aspect == pytest.approx(CAMERA.aspect, abs=5e-4)


def test_frames_that_nothing_holds_are_no_geometry() -> None:
    with pytest.raises(GeometryError, match="determine"):
        adjust(matched(CAMERA, TRUTH, [(0, 1)]), TRUTH, np.array([0, 1, 2]), [CAMERA])


def test_matches_of_one_thing_alone_are_no_geometry() -> None:
    (link,) = matched(CAMERA, TRUTH, [(0, 1)])
    with pytest.raises(GeometryError, match="determine"):
        adjust([link.kept(np.arange(len(link.pixels_i)) == 0)], TRUTH, np.array([0, 1]), [CAMERA])


def test_the_circle_keeps_its_radius() -> None:
    values = CAMERA.values
    values[0] *= 1.05
    moved = with_same_circle(CAMERA, values)
    assert moved is not None
    assert float(moved.lens.radius(moved.half_fov)) == pytest.approx(float(CAMERA.lens.radius(CAMERA.half_fov)))
    assert moved.half_fov < CAMERA.half_fov
    assert with_same_circle(CAMERA, np.full(7, np.nan)) is None
    small = Camera(Equidistant(100.0), (400, 400), (200.0, 200.0), half_fov=1.5)
    assert with_same_circle(small, np.array([10.0, 200, 200, 1])) is None  # it would have to see past 140 degrees


def test_the_result_does_not_depend_on_which_way_a_link_points() -> None:
    links = matched(CAMERA, TRUTH, noise_px=0.3)
    back = [
        dataclasses.replace(x, i=x.j, j=x.i, pixels_i=x.pixels_j, pixels_j=x.pixels_i, j_from_i=x.j_from_i.T)
        for x in links
    ]
    there, again = (adjust(some, turned(TRUTH, 1), GROUP, [CAMERA], tolerance=1e-12) for some in (links, back))
    assert turn_between(there.rotations, again.rotations).max() < 0.2 * there.sigma.max()
