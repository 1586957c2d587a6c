"""What another lens formula says of the first one's uncertainty: much where matches do not reach, little elsewhere."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turning import matched, orientation, ring

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, FloatArray, Thoby
from fullsphere.mosaic.lens_spread import gain, with_lens_spread
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.self_calibration import as_bakstein_pajdla, with_other_lens
from fullsphere.mosaic.solution import Solution, solve_links

FREE = ("a_px", "b", "c_px", "d", "centre_u_px", "centre_v_px")
HALF = math.radians(97.5)
BACK_TO_BACK = np.array([np.eye(3), orientation(180, 1, 2)])


def of_circle(lens: Thoby, half_fov: float = HALF) -> Camera:
    return Camera(lens.scaled(580 / float(lens.radius(half_fov))), (1200, 1200), (602.0, 596.0), half_fov=half_fov)


DUAL = of_circle(Thoby(300.0))


def solved(camera: Camera, true: FloatArray, seed: int, count: int, noise_px: float = 0.3) -> tuple[Solution, Solution]:
    """Frames of a camera under a Bakstein-Pajdla lens, found from an equidistant one, and under another."""
    links = matched(camera, true, count=count, noise_px=noise_px, seed=seed)
    rig = Rig.of_one_camera(len(true))
    guess = Camera(Equidistant(580 / camera.half_fov), camera.size, camera.centre, half_fov=camera.half_fov)
    one = solve_links(links, rig, [as_bakstein_pajdla(guess)], FREE)
    other = with_other_lens(one, rig, ())
    assert other is not None
    return one, other


def curve_sigma_px(solution: Solution, theta: FloatArray) -> FloatArray:
    lens = solution.adjustment.cameras[0].lens
    by_value = np.asarray(lens.radius_by_parameter(theta))
    own = solution.adjustment.covariances[0][:4, :4]
    return np.asarray(np.sqrt(np.einsum("ti,ij,tj->t", by_value, own, by_value)))


def curve_factor(solutions: list[Solution], camera: Camera) -> float:
    """Root mean square of true errors of the curve over stated ones."""
    theta = np.linspace(0, camera.half_fov - math.radians(2), 40)[1:]
    ratios = []
    for solution in solutions:
        off = solution.adjustment.cameras[0].lens.radius(theta) - camera.lens.radius(theta)
        ratios.append(np.mean(off**2) / np.mean(curve_sigma_px(solution, theta) ** 2))
    return float(np.sqrt(np.mean(ratios)))


def turn_factor(solutions: list[Solution], true: FloatArray) -> float:
    """The same of orientations."""
    ratios = []
    for solution in solutions:
        turns = Rotation.from_matrix(np.swapaxes(true, 1, 2) @ solution.adjustment.rotations)
        off = (turns.mean().inv() * turns).magnitude()
        ratios.append(np.mean(off**2) / np.mean(solution.adjustment.sigma**2))
    return float(np.sqrt(np.mean(ratios)))


def test_frames_back_to_back_state_how_little_they_know() -> None:
    """Sharp matches along the rim alone leave a long valley of lenses: sigma covers where in it the fit ends."""
    both = [solved(DUAL, BACK_TO_BACK, seed, 400, 0.03) for seed in range(6)]
    spread = [with_lens_spread(one, other) for one, other in both]
    assert curve_factor(spread, DUAL) < 1.5
    assert turn_factor(spread, BACK_TO_BACK) < 1.5


def test_a_formula_that_bends_the_orientations_says_so() -> None:
    """Matches everywhere, of a curve that Bakstein-Pajdla lenses follow to a tenth of a pixel only."""
    camera, true = of_circle(Thoby(300.0)), ring(5)
    one, other = solved(camera, true, 0, 400, 0.1)
    assert gain(one, other) > 10
    assert curve_factor([one], camera) > 1.5
    assert 0.7 < curve_factor([with_lens_spread(one, other)], camera) < 1.5


def test_where_matches_determine_the_lens_the_sigma_stays() -> None:
    camera = as_bakstein_pajdla(of_circle(Thoby(300.0), math.radians(91)))
    one, other = solved(camera, ring(5), 1, 300)
    spread = with_lens_spread(one, other)
    assert np.all(spread.adjustment.sigma >= one.adjustment.sigma)
    assert np.all(spread.adjustment.sigma < 1.3 * one.adjustment.sigma)


def test_a_lens_that_fits_worse_says_nothing() -> None:
    one, other = solved(DUAL, BACK_TO_BACK, 0, 400)
    worse = tuple(1.2 * r for r in other.adjustment.residuals_px)
    spread = with_lens_spread(one, other._replace(adjustment=other.adjustment._replace(residuals_px=worse)))
    np.testing.assert_allclose(spread.adjustment.sigma, one.adjustment.sigma, rtol=1e-3)
    np.testing.assert_allclose(spread.adjustment.covariances[0], one.adjustment.covariances[0], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("px", [0.0, 3.0])
def test_the_variance_added_is_the_curves_distance(px: float) -> None:
    """On the whole, whatever part of it the formula can follow; and the axis's own beside it."""
    one, other = solved(DUAL, BACK_TO_BACK, 0, 400)
    camera, adjusted = one.adjustment.cameras[0], one.adjustment
    bare = one._replace(adjustment=adjusted._replace(covariances=(1e-12 * np.eye(7),)))
    moved = dataclasses.replace(other.adjustment.cameras[0], centre=(camera.centre[0] + px, camera.centre[1]))
    same = other.adjustment._replace(cameras=(moved,), residuals_px=adjusted.residuals_px)
    spread = with_lens_spread(bare, other._replace(adjustment=same))
    theta = np.linspace(0, min(camera.half_fov, moved.half_fov), 61)[1:]
    apart = moved.lens.radius(theta) - camera.lens.radius(theta)
    assert np.mean(curve_sigma_px(spread, theta) ** 2) == pytest.approx(np.mean(apart**2), rel=1e-3)
    assert math.sqrt(spread.adjustment.covariances[0][4, 4]) == pytest.approx(px, abs=1e-5)
