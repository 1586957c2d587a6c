"""The laws of cameras, over every lens, past 90 degrees and with the hard rays."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import CameraError
from fullsphere.model.lens import BaksteinPajdla, Equidistant, FloatArray, Perspective
from laws import (
    PROJECTIONS,
    SEEDS,
    angle_between,
    cameras,
    central_difference,
    fisheye,
    hard_rays,
    law,
    rays_at,
    steps,
    widest,
)

every_lens = pytest.mark.parametrize("projection", PROJECTIONS)


def circle_pixels(camera: Camera, seed: int, count: int = 100) -> FloatArray:
    """Pixels (n, 2) all over the image circle, its centre and points of its rim among them."""
    rng = np.random.default_rng(seed)
    share = np.concatenate([np.sqrt(rng.random(count)), [0.0, 1e-12, 1e-6, 1.0, 1.0, 1.0]])
    phi = np.concatenate([rng.uniform(-math.pi, math.pi, count + 3), [0.0, math.pi / 2, -2.0]])
    r = float(camera.lens.radius(camera.half_fov)) * share
    return np.stack([camera.centre[0] + r * np.cos(phi), camera.centre[1] + camera.aspect * r * np.sin(phi)], -1)


@every_lens
@given(data=st.data())
@law(30)
def test_project_inverts_unproject(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    pixels = circle_pixels(camera, data.draw(SEEDS))
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose(camera.project(rays), pixels, rtol=0, atol=1e-9)


@every_lens
@given(data=st.data())
@law(30)
def test_unproject_inverts_project(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    rays = hard_rays(camera.half_fov, data.draw(SEEDS))
    back = camera.unproject(camera.project(rays))
    error_px = angle_between(rays, back) * camera.pixels_per_radian(rays)
    np.testing.assert_allclose(error_px, 0, atol=1e-9)


@every_lens
@given(data=st.data())
@law(30)
def test_the_length_of_a_ray_does_not_matter(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    rays = rays_at(np.linspace(0, camera.half_fov * (1 - 1e-9), 40), data.draw(SEEDS))
    for length in (1e-100, 1e-3, 7.3, 1e100):
        np.testing.assert_allclose(camera.project(length * rays), camera.project(rays), rtol=0, atol=1e-9)


@every_lens
@given(data=st.data())
@law(15)
def test_beyond_the_field_of_view_is_nan_and_never_a_clamp(projection: str, data: st.DataObject) -> None:
    camera, seed = data.draw(cameras(projection)), data.draw(SEEDS)
    rim = float(camera.lens.radius(camera.half_fov))
    phi = np.linspace(-math.pi, math.pi, 50)
    for r in (rim * (1 + 1e-9), rim + 1e-3, 2 * rim, 1e6 * rim):
        beyond = np.stack([r * np.cos(phi), camera.aspect * r * np.sin(phi)], -1) + camera.centre
        assert np.all(np.isnan(camera.unproject(beyond)))
    if camera.half_fov < math.pi - 1e-5:
        theta = np.linspace(camera.half_fov + 1e-6, math.pi, 50)
        rays = rays_at(theta, seed)
        assert np.all(np.isnan(camera.project(rays)))
        assert np.all(np.isnan(camera.project_with_jacobians(rays).pixels))
        assert np.all(np.isnan(camera.project_with_jacobians(rays).d_pixel_d_ray))
        assert np.all(np.isnan(camera.project_with_jacobians(rays).d_pixel_d_parameter))


@every_lens
@given(data=st.data())
@law(30)
def test_derivative_by_the_ray(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    rays = rays_at(np.concatenate([np.linspace(0, 0.99 * camera.half_fov, 40), [1e-9, 1e-5]]), data.draw(SEEDS))
    rays = rays[np.linalg.norm(rays - [0, 0, -1], axis=1) > 0.05]  # the pole behind: u and v have no derivative there
    rays = rays * np.random.default_rng(0).uniform(0.5, 2, (len(rays), 1))
    got = camera.project_with_jacobians(rays)
    open_camera = dataclasses.replace(camera, half_fov=min(camera.half_fov * 1.01, camera.lens.theta_max))
    expected = central_difference(open_camera.project, rays, 1e-4)
    np.testing.assert_array_equal(got.pixels, camera.project(rays))
    np.testing.assert_allclose(got.d_pixel_d_ray, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    assert np.abs(got.d_pixel_d_ray @ rays[..., None]).max() <= 1e-12 * np.abs(expected).max()  # blind along the ray


@every_lens
@given(data=st.data())
@law(30)
def test_derivative_by_the_parameters(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    camera = dataclasses.replace(camera, half_fov=0.95 * camera.half_fov)
    rays = hard_rays(camera.half_fov, data.draw(SEEDS))
    values = camera.values
    worth = np.concatenate([steps(camera.lens), np.maximum(np.abs(values[-3:]), 1e-3)])

    def pixels_with(moved: FloatArray) -> FloatArray:
        return camera.with_values(moved).project(rays)

    got = camera.project_with_jacobians(rays).d_pixel_d_parameter
    assert got.shape == (len(rays), 2, len(camera.parameter_names))
    expected = central_difference(pixels_with, values, 1e-4 * worth)
    worth /= max(camera.size)  # one part of a parameter, in parts of the picture
    np.testing.assert_allclose(got * worth, expected * worth, atol=1e-8 * max(1.0, np.abs(got * worth).max()))


@pytest.mark.parametrize("bad", [(0.0, 0.0, 0.0), (math.nan, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_what_is_no_direction_of_the_camera_is_nan(bad: tuple[float, float, float]) -> None:
    camera = fisheye(500)
    assert np.all(np.isnan(camera.project(bad)))
    assert np.all(np.isnan(camera.project_with_jacobians(bad).pixels))
    assert np.all(np.isnan(camera.unproject([math.nan, 3.0])))


def test_shapes_are_kept() -> None:
    camera = fisheye(500)
    assert camera.project([0.0, 0.1, 1.0]).shape == (2,)
    assert camera.unproject(np.full((4, 5, 2), 250.0)).shape == (4, 5, 3)
    jacobians = camera.project_with_jacobians(np.ones((4, 5, 3)))
    assert jacobians.d_pixel_d_ray.shape == (4, 5, 2, 3)
    assert jacobians.d_pixel_d_parameter.shape == (4, 5, 2, 7)
    assert isinstance(camera, Projection)


def test_conventions() -> None:
    """u to the right for x to the right, v down for y down, and the optical axis at the centre."""
    camera = Camera(Equidistant(100.0), (400, 400), (190.0, 205.0), aspect=0.95, half_fov=math.radians(110))
    quarter = math.pi / 2 * 100
    np.testing.assert_allclose(camera.project([0, 0, 1]), [190, 205], atol=1e-12)
    np.testing.assert_allclose(camera.project([1, 0, 0]), [190 + quarter, 205], atol=1e-12)
    np.testing.assert_allclose(camera.project([0, 1, 0]), [190, 205 + 0.95 * quarter], atol=1e-12)


def test_equations_of_the_paper_by_hand() -> None:
    """Equations 2 to 6 with plain arithmetic: a = 260, b = 1.9, c = 120, d = 1.3 and the ray (3, 4, -1)."""
    camera = Camera(BaksteinPajdla(260.0, 1.9, 120.0, 1.3), (900, 800), (450.25, 401.5), aspect=1.02, half_fov=1.9)
    theta = math.pi - math.acos(1 / math.sqrt(26))  # 101.3 degrees: behind the camera
    r = 260 * math.tan(theta / 1.9) + 120 * math.sin(theta / 1.3)
    u, v = camera.project([3.0, 4.0, -1.0]).tolist()
    assert u == pytest.approx(450.25 + r * 3 / 5, abs=1e-10)
    assert v == pytest.approx(401.5 + 1.02 * r * 4 / 5, abs=1e-10)
    # And as numbers worked out apart from any program: theta = 1.768192 rad, tan = 1.342630, sin = 0.977895.
    assert (u, v) == pytest.approx((730.109, 782.108), abs=0.001)


@every_lens
@given(data=st.data())
@law(20)
def test_scaled_camera_sees_the_resampled_picture(projection: str, data: st.DataObject) -> None:
    """A point at u of a picture is at (u + 0.5) k - 0.5 of one k times as large: borders fall on borders."""
    camera, factor, seed = data.draw(cameras(projection)), data.draw(st.floats(0.1, 8)), data.draw(SEEDS)
    rays = hard_rays(camera.half_fov * (1 - 1e-9), seed)
    scaled = camera.scaled(factor)
    expected = (camera.project(rays) + 0.5) * factor - 0.5
    np.testing.assert_allclose(scaled.project(rays), expected, rtol=0, atol=1e-8)
    pixels = circle_pixels(dataclasses.replace(camera, half_fov=camera.half_fov * (1 - 1e-9)), seed)
    error = angle_between(scaled.unproject((pixels + 0.5) * factor - 0.5), camera.unproject(pixels))
    np.testing.assert_allclose(error * camera.pixels_per_radian(camera.unproject(pixels)), 0, atol=1e-8)
    assert scaled.size == (round(camera.size[0] * factor), round(camera.size[1] * factor))
    assert (scaled.aspect, scaled.half_fov) == (camera.aspect, camera.half_fov)


@every_lens
@given(data=st.data())
@law(10)
def test_scaled_there_and_back_is_the_camera(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    back = camera.scaled(4.0).scaled(0.25)
    assert back.size == camera.size
    np.testing.assert_allclose(back.values, camera.values, rtol=1e-12)


@given(camera=cameras("bakstein-pajdla"), factor=st.floats(0.1, 8))
@law()
def test_a_camera_that_sees_all_that_its_lens_images_can_be_scaled(camera: Camera, factor: float) -> None:
    """Where the slope vanishes is found anew for the scaled lens, and may differ by rounding."""
    full = dataclasses.replace(camera, half_fov=widest(camera.lens))
    assert full.scaled(factor).half_fov == full.half_fov


@every_lens
@given(data=st.data())
@law(20)
def test_cropped_camera_sees_the_rectangle(projection: str, data: st.DataObject) -> None:
    camera, seed = data.draw(cameras(projection)), data.draw(SEEDS)
    width, height = data.draw(st.integers(1, 5000)), data.draw(st.integers(1, 5000))
    left = data.draw(st.integers(1 - width, camera.size[0] - 1))
    top = data.draw(st.integers(1 - height, camera.size[1] - 1))
    rays = hard_rays(camera.half_fov, seed)
    cropped = camera.cropped(left, top, width, height)
    np.testing.assert_allclose(cropped.project(rays), camera.project(rays) - [left, top], rtol=0, atol=1e-8)
    assert cropped.size == (width, height)
    assert (cropped.lens, cropped.aspect, cropped.half_fov) == (camera.lens, camera.aspect, camera.half_fov)
    np.testing.assert_allclose(cropped.cropped(-left, -top, *camera.size).centre, camera.centre, rtol=0, atol=1e-9)


def test_a_binned_picture_is_the_scaled_one() -> None:
    """The pixel that four become lies between them."""
    camera = fisheye(1000)
    four = camera.unproject([[600, 300], [601, 300], [600, 301], [601, 301]])
    np.testing.assert_allclose(camera.scaled(0.5).project(four).mean(0), [300, 150], rtol=0, atol=1e-9)


@every_lens
@given(data=st.data())
@law(15)
def test_pixels_per_radian_is_the_smaller_singular_value(projection: str, data: st.DataObject) -> None:
    camera = dataclasses.replace(data.draw(cameras(projection)), aspect=1.0)
    rays = rays_at(np.linspace(0, min(0.999 * camera.half_fov, 3.0), 40), data.draw(SEEDS))
    on_sphere = np.linalg.svd(camera.project_with_jacobians(rays).d_pixel_d_ray, compute_uv=False)
    np.testing.assert_allclose(camera.pixels_per_radian(rays), on_sphere[:, 1], rtol=1e-6)


GOOD = fisheye(1000)
BAD: dict[str, Callable[[], Camera]] = {
    "no width": lambda: dataclasses.replace(GOOD, size=(0, 1000)),
    "half a pixel": lambda: dataclasses.replace(GOOD, size=(1000.5, 1000)),  # type: ignore[arg-type]
    "a width of NaN": lambda: dataclasses.replace(GOOD, size=(math.nan, 1000)),  # type: ignore[arg-type]
    "an endless width": lambda: dataclasses.replace(GOOD, size=(math.inf, 1000)),  # type: ignore[arg-type]
    "a picture too large": lambda: dataclasses.replace(GOOD, size=(1000, 1 << 21)),
    "a centre of NaN": lambda: dataclasses.replace(GOOD, centre=(math.nan, 0.0)),
    "a centre far off": lambda: dataclasses.replace(GOOD, centre=(0.0, -1e9)),
    "an aspect of NaN": lambda: dataclasses.replace(GOOD, aspect=math.nan),
    "an aspect of 0": lambda: dataclasses.replace(GOOD, aspect=0.0),
    "a negative aspect": lambda: dataclasses.replace(GOOD, aspect=-1.0),
    "no field of view": lambda: dataclasses.replace(GOOD, half_fov=0.0),
    "a field of view of NaN": lambda: dataclasses.replace(GOOD, half_fov=math.nan),
    "a field of view in degrees": lambda: dataclasses.replace(GOOD, half_fov=95.0),
    "a lens that falls before the rim": lambda: dataclasses.replace(GOOD, lens=BaksteinPajdla(1e-6, 2.5, 300.0, 1.0)),
    "a rim at infinity": lambda: Camera(Perspective(300.0), (640, 480), (320.0, 240.0), half_fov=math.pi / 2),
    "scaled by 0": lambda: GOOD.scaled(0.0),
    "scaled by NaN": lambda: GOOD.scaled(math.nan),
    "a lens value of NaN": lambda: GOOD.with_values([math.nan, *GOOD.values[1:]]),
    "a height below 0": lambda: dataclasses.replace(GOOD, size=(1000, -1000)),
    "scaled by a negative factor": lambda: GOOD.scaled(-0.5),
    "scaled endlessly": lambda: GOOD.scaled(math.inf),
    "scaled to nothing": lambda: GOOD.scaled(4e-4),
    "scaled past all pictures": lambda: GOOD.scaled(2000.0),
    "a crop without rows": lambda: GOOD.cropped(0, 0, 100, 0),
    "a crop of negative width": lambda: GOOD.cropped(0, 0, -100, 100),
    "a crop beside the picture": lambda: GOOD.cropped(1000, 0, 100, 100),
    "a crop above the picture": lambda: GOOD.cropped(0, -100, 100, 100),
    "a crop from half a pixel on": lambda: GOOD.cropped(0.5, 0, 100, 100),  # type: ignore[arg-type]
    "a crop of NaN": lambda: GOOD.cropped(0, 0, math.nan, 100),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_camera_is_refused(bad: str) -> None:
    with pytest.raises(CameraError):
        BAD[bad]()
