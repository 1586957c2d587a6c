"""A tabulated camera is the camera, within the error it states."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.model import kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import ResourceError
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
from fullsphere.model.table import RayTable, tabulate
from laws import PROJECTIONS, angle_between, cameras, fisheye, law, rays_at, rotation

ROUNDING_PX = 1e-8

LENSES_AND_HALF_FOVS: dict[str, tuple[Lens, float]] = {
    "perspective": (Perspective(1000.0), 55),
    "stereographic": (Stereographic(400.0), 120),
    "equidistant": (Equidistant(600.0), 110),
    "equisolid": (Equisolid(600.0), 110),
    "orthographic": (Orthographic(1500.0), 80),
    "scaled-stereographic": (ScaledStereographic(900.0, 1.9), 100),
    "bakstein-pajdla": (BaksteinPajdla(1350.0, 2.11, 420.0, 1.13), 100),
    "thoby": (Thoby(600.0), 110),
    "kannala-brandt": (KannalaBrandt(1000.0, -0.031, 0.0043, -0.0005, 0.0001), 97.5),
    "brown": (Brown(1800.0, -0.29, 0.11, -0.02), 40),
    "scaramuzza": (Scaramuzza(1400.0, -2e-4, 3e-8, -2e-11), 100),
    "ucm": (UnifiedCamera(900.0, 0.62), 105),
    "eucm": (EnhancedUnifiedCamera(800.0, 0.6, 1.1), 105),
    "double-sphere": (DoubleSphere(700.0, -0.2, 0.58), 105),
}
every_lens = pytest.mark.parametrize("name", LENSES_AND_HALF_FOVS)


def typical(name: str) -> Camera:
    lens, half_fov_deg = LENSES_AND_HALF_FOVS[name]
    return Camera(lens, (4000, 3000), (2010.5, 1490.25), aspect=1.04, half_fov=math.radians(half_fov_deg))


def rays_within(camera: Camera, seed: int, count: int = 2000) -> FloatArray:
    theta = np.random.default_rng(seed).uniform(0, camera.half_fov * (1 - 1e-9), count)
    hard = np.array([0.0, 1e-12, 1e-9, 1e-4, math.pi / 2])
    return rays_at(np.concatenate([theta, hard[hard < camera.half_fov]]), seed)


def pixels_within(camera: Camera, seed: int, count: int = 2000) -> FloatArray:
    rng = np.random.default_rng(seed)
    r = float(camera.lens.radius(camera.half_fov)) * (1 - 1e-9) * np.sqrt(rng.random(count))
    r[:3] = [0.0, 1e-9, 1.0]
    phi = rng.uniform(-math.pi, math.pi, count)
    return np.stack([camera.centre[0] + r * np.cos(phi), camera.centre[1] + camera.aspect * r * np.sin(phi)], -1)


def largest_errors_px(table: RayTable, seed: int) -> tuple[float, float]:
    """Of project, and of unproject, against the exact camera, over its whole domain."""
    camera, rays = table.camera, rays_within(table.camera, seed)
    pixels = pixels_within(camera, seed)
    forward = np.linalg.norm(table.project(rays) - camera.project(rays), axis=-1)
    exact = camera.unproject(pixels)
    inverse = angle_between(table.unproject(pixels), exact) * camera.pixels_per_radian(exact)
    return float(forward.max()), float(inverse.max())


@every_lens
@pytest.mark.parametrize("tolerance_px", [1e-3, 1e-6])
def test_table_is_the_camera_within_its_stated_error(name: str, tolerance_px: float) -> None:
    table = tabulate(typical(name), tolerance_px)
    assert table.error_px <= tolerance_px
    assert max(largest_errors_px(table, 0)) <= 1.1 * table.error_px + ROUNDING_PX
    assert isinstance(table, Projection)
    assert table.size == table.camera.size


@pytest.mark.parametrize("projection", PROJECTIONS)
@given(data=st.data())
@law(8)
def test_any_camera_is_tabulated_within_the_stated_error_or_refused(projection: str, data: st.DataObject) -> None:
    camera = data.draw(cameras(projection))
    try:
        table = tabulate(camera, 1e-3)
    except ResourceError:
        assert camera.half_fov > 0.5 * camera.lens.theta_max  # only near the end of the lens's domain
        return
    assert table.error_px <= 1e-3
    assert max(largest_errors_px(table, 1)) <= 1.2 * table.error_px + ROUNDING_PX


@every_lens
def test_unproject_gives_unit_rays(name: str) -> None:
    camera = typical(name)
    table = tabulate(camera)
    per_radian = float(camera.lens.slope(np.linspace(0, camera.half_fov, 99)).min())
    length = np.linalg.norm(table.unproject(pixels_within(camera, 3)), axis=-1)
    np.testing.assert_allclose(length, 1, atol=10 * table.error_px / per_radian + 1e-12)


@every_lens
def test_outside_is_nan(name: str) -> None:
    camera = typical(name)
    table = tabulate(camera, 1e-3)
    beyond = rays_at(np.linspace(camera.half_fov + 1e-6, math.pi, 200), 0)
    assert np.all(np.isnan(table.project(beyond)))
    assert np.all(np.isnan(table.project(beyond, dtype=np.float32)))
    phi = np.linspace(0, 6, 100)
    r = float(camera.lens.radius(camera.half_fov)) * (1 + 1e-9)
    past = np.stack([camera.centre[0] + r * np.cos(phi), camera.centre[1] + camera.aspect * r * np.sin(phi)], -1)
    assert np.all(np.isnan(table.unproject(past)))
    for nowhere in ([math.nan, 0, 1], [0, 0, math.nan]):
        assert np.all(np.isnan(table.project(nowhere)[0]))
    assert np.all(np.isnan(table.unproject([math.nan, 5.0])))


def test_rotation_is_the_same_as_turning_first() -> None:
    table, turn = tabulate(fisheye(1000)), rotation(5)
    rays = rays_within(table.camera, 1) @ turn  # camera rays as seen from a turned frame
    np.testing.assert_allclose(table.project(rays, turn), table.project(rays @ turn.T), rtol=0, atol=1e-9)
    assert np.isfinite(table.project(rays, turn)).all()


def test_shape_and_type_are_what_was_asked_for() -> None:
    table = tabulate(fisheye(1000), 1e-3)
    rays = rays_within(table.camera, 2, count=12)[:12].reshape(3, 4, 3)
    fine, coarse = table.project(rays), table.project(rays, dtype=np.float32)
    assert fine.dtype == np.dtype(np.float64)
    assert coarse.dtype == np.dtype(np.float32)
    assert fine.shape == coarse.shape == (3, 4, 2)
    np.testing.assert_array_equal(coarse, fine.astype(np.float32))
    assert table.unproject(fine).shape == (3, 4, 3)
    assert table.project(rays[0, 0]).shape == (2,)
    strided = np.asfortranarray(rays)
    np.testing.assert_array_equal(table.project(strided), fine)


def test_refines_until_the_tolerance_is_met() -> None:
    camera = typical("orthographic")
    coarse, fine = tabulate(camera, 1e-3), tabulate(camera, 1e-8)
    assert fine.error_px <= 1e-8 < coarse.error_px <= 1e-3
    assert fine.inverse_s.shape[0] > coarse.inverse_s.shape[0]
    assert fine.inverse_c.shape == fine.inverse_s.shape


@pytest.mark.parametrize(
    ("lens", "half_fov_deg"), [(Orthographic(1500.0), 90.0), (Equidistant(600.0), 180.0), (Stereographic(50.0), 179.0)]
)
def test_what_cannot_be_tabulated_is_refused_with_what_was_reached(lens: Lens, half_fov_deg: float) -> None:
    camera = Camera(lens, (4000, 3000), (2000.0, 1500.0), half_fov=math.radians(half_fov_deg))
    with pytest.raises(ResourceError, match=r"reach .* px"):
        tabulate(camera)


def test_project_kernel_against_its_twin() -> None:
    table, turn = tabulate(fisheye(1000, aspect=0.97), 1e-3), rotation(11)
    rays = rays_at(np.random.default_rng(0).uniform(0, math.pi, 500), 4)
    z_min, camera = math.cos(table.camera.half_fov), table.camera
    pixels = np.empty((500, 2))
    kernels.project_rays(rays, turn, table.forward, z_min, *camera.centre, camera.aspect, pixels)
    x, y, z = (rays @ turn.T).T
    g = _cubic(table.forward, (z - z_min) / (1 - z_min))
    twin = np.stack([camera.centre[0] + g * x, camera.centre[1] + camera.aspect * g * y], -1)
    twin[z < z_min] = np.nan
    np.testing.assert_allclose(pixels, twin, rtol=0, atol=1e-9)
    assert 0 < np.isnan(pixels[:, 0]).sum() < 500


def test_unproject_kernel_against_its_twin() -> None:
    table = tabulate(fisheye(1000, aspect=0.97), 1e-3)
    pixels = np.random.default_rng(0).uniform(0, 1000, (500, 2))
    camera, rays = table.camera, np.empty((500, 3))
    q_max = float(camera.lens.radius(camera.half_fov)) ** 2
    kernels.unproject_pixels(pixels, table.inverse_s, table.inverse_c, q_max, *camera.centre, camera.aspect, rays)
    x, y = pixels[:, 0] - camera.centre[0], (pixels[:, 1] - camera.centre[1]) / camera.aspect
    q = x**2 + y**2
    s, c = _cubic(table.inverse_s, q / q_max), _cubic(table.inverse_c, q / q_max)
    twin = np.stack([s * x, s * y, c], -1)
    twin[q > q_max] = np.nan
    np.testing.assert_allclose(rays, twin, rtol=0, atol=1e-13)
    assert 0 < np.isnan(rays[:, 0]).sum() < 500


def _cubic(pieces: FloatArray, at: FloatArray) -> FloatArray:
    """The piecewise cubic at positions in [0, 1], by powers."""
    cells = len(pieces)
    cell = np.clip(np.floor(at * cells).astype(int), 0, cells - 1)
    t = at * cells - cell
    return np.asarray(sum(pieces[cell, k] * t**k for k in range(4)))
