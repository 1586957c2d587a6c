"""The cameras that are tried first, and the lens of four parameters that takes over."""

import math

import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle
from fullsphere.model.lens import Equidistant, Equisolid, Stereographic
from fullsphere.mosaic.self_calibration import as_bakstein_pajdla, starting_cameras
from laws import fisheye

CIRCLE = ImageCircle((410.3, 295.8), 280.0)


def test_starts_on_a_circle_image_that_circle() -> None:
    starts = starting_cameras((800, 600), CIRCLE)
    for camera in starts:
        assert camera.image_radius == pytest.approx(CIRCLE.radius)
        assert camera.centre == CIRCLE.centre
        assert camera.size == (800, 600)
        assert camera.aspect == 1
    halves = [camera.half_fov for camera in starts]
    assert halves == sorted(halves)
    assert halves[0] < math.radians(90) < math.radians(110) < halves[-1]


def test_starts_without_a_circle_reach_the_corners() -> None:
    starts = starting_cameras((800, 600), None)
    for camera in starts:
        assert camera.image_radius == pytest.approx(500)
        assert camera.centre == (399.5, 299.5)
        assert np.isfinite(camera.unproject(np.array([[400, 300], [0.5, 0.5], [798.5, 598.5]]))).all()
    halves = np.array([camera.half_fov for camera in starts])
    assert np.all(np.diff(np.log(np.tan(halves / 2))) < math.log(1.6))  # no field of view is far from a start
    assert halves[0] < math.radians(10)


@pytest.mark.parametrize(
    "camera",
    [
        *starting_cameras((800, 600), CIRCLE),
        *starting_cameras((800, 600), None),
        Camera(Stereographic(150.0), (800, 600), (400.0, 300.0), half_fov=math.radians(100)),
        fisheye(800, aspect=1.02),
    ],
    ids=lambda camera: f"{camera.lens.projection} {math.degrees(camera.half_fov):.0f}",
)
def test_bakstein_pajdla_takes_over_the_curve(camera: Camera) -> None:
    taken = as_bakstein_pajdla(camera)
    theta = np.linspace(0, camera.half_fov, 200)
    off = np.abs(taken.lens.radius(theta) - camera.lens.radius(theta))
    assert off.max() < 0.01 * camera.image_radius
    assert (taken.size, taken.centre, taken.aspect, taken.half_fov) == (
        camera.size,
        camera.centre,
        camera.aspect,
        camera.half_fov,
    )


@pytest.mark.parametrize("lens", [Equidistant(160.0), Equisolid(170.0)])
def test_every_parameter_of_the_new_lens_moves_the_curve(lens: Equidistant | Equisolid) -> None:
    """Otherwise the adjustment could not move it."""
    taken = as_bakstein_pajdla(Camera(lens, (800, 600), (400.0, 300.0), half_fov=math.radians(95))).lens
    theta = np.linspace(0, math.radians(95), 50)
    worth = np.abs(taken.radius_by_parameter(theta) * taken.values).max(0)  # px for a parameter changed by its size
    assert worth.min() > 10
