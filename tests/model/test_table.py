"""A tabulated camera is the camera, within the error it states."""

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fullsphere.model import kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import ResourceError, UsageError
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

ROUNDING_PX = 1e-10  # 4e-13 of the edge of a picture
FLOAT32_PX = 1e-3

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


def widest_named(name: str) -> Camera:
    """A lens as wide as it is used, 195 degrees if it can, its image circle in a frame of 4000 x 4000."""
    lens, _ = LENSES_AND_HALF_FOVS[name]
    half_fov = math.radians({"perspective": 75, "brown": 55, "orthographic": 90}.get(name, 97.5))
    lens = lens.scaled(2000 / float(lens.radius(half_fov)))
    return Camera(lens, (4000, 4000), (1999.5, 1999.5), half_fov=half_fov)


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


def largest_errors_px(table: RayTable, seed: int, count: int = 2000) -> tuple[float, float]:
    """Of project, and of unproject, against the exact camera, over its whole domain."""
    camera, rays = table.camera, rays_within(table.camera, seed, count)
    pixels = pixels_within(camera, seed, count)
    forward = np.linalg.norm(table.project(rays) - camera.project(rays), axis=-1)
    exact = camera.unproject(pixels)
    inverse = angle_between(table.unproject(pixels), exact) * camera.pixels_per_radian(exact)
    return float(forward.max()), float(inverse.max())


@every_lens
@pytest.mark.parametrize("tolerance_px", [1e-3, 1e-6, 1e-8])
def test_table_is_the_camera_within_its_stated_error(name: str, tolerance_px: float) -> None:
    table = tabulate(typical(name), tolerance_px)
    assert table.error_px <= tolerance_px
    assert max(largest_errors_px(table, 0)) <= 1.01 * table.error_px + ROUNDING_PX
    assert isinstance(table, Projection)
    assert table.size == table.camera.size


@every_lens
def test_195_degrees_on_4000_px_within_1e_8_px_and_in_float32_within_1e_3_px(name: str) -> None:
    table = tabulate(widest_named(name))
    assert table.error_px <= 1e-8
    assert max(largest_errors_px(table, 5, count=20_000)) <= 1.01e-8
    odd = name != "scaramuzza"  # whose even powers are why more cells are needed
    assert table.forward.shape[0] <= (2048 if odd else 65536)
    assert table.inverse_s.shape[0] <= 2048
    assert table.float32_error_px <= FLOAT32_PX


@every_lens
def test_float32_is_the_camera_within_its_stated_error(name: str) -> None:
    camera = widest_named(name)
    table, turn = tabulate(camera), rotation(3)
    rays = (rays_within(camera, 7, 20_000) @ turn).astype(np.float32)
    pixels = table.project(rays, turn, np.float32)
    assert pixels.dtype == np.dtype(np.float32)
    forward = np.linalg.norm(pixels - camera.project(rays @ turn.T), axis=-1)
    given = pixels_within(camera, 7, 20_000).astype(np.float32)
    back = table.unproject(given, np.float32)
    assert back.dtype == np.dtype(np.float32)
    inverse = np.linalg.norm(camera.project(back) - given, axis=-1)
    assert max(np.nanmax(forward), np.nanmax(inverse)) <= 1.3 * table.float32_error_px
    assert np.isfinite(forward).mean() > 0.999
    assert np.isfinite(inverse).mean() > 0.999


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


@every_lens
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_rim_belongs_to_the_picture(name: str, dtype: type) -> None:
    """As it does for the exact camera, rounding or not."""
    camera, turn = widest_named(name), rotation(4)
    table = tabulate(camera, 1e-3)
    rim = rays_at(np.full(200, camera.half_fov), 0)
    assert np.isfinite(camera.project(rim)).all()
    assert np.isfinite(table.project(rim.astype(dtype), dtype=dtype)).all()
    assert np.isfinite(table.project((rim @ turn).astype(dtype), turn, dtype)).all()
    assert np.isfinite(table.unproject(camera.project(rim))).all()


def test_arrays_of_any_kind_are_taken() -> None:
    table = tabulate(fisheye(1000), 1e-3)
    rays = rays_within(table.camera, 2, 20)
    pixels = table.project(rays)
    assert table.project(np.empty((0, 3))).shape == (0, 2)
    assert table.unproject(np.empty((4, 0, 2))).shape == (4, 0, 3)
    frozen, swapped, wide = rays.copy(), rays.astype(rays.dtype.newbyteorder()), np.repeat(rays, 2, 0)[::2]
    frozen.flags.writeable = False
    for other in (frozen, swapped, wide, rays.tolist(), np.asfortranarray(rays)):
        np.testing.assert_array_equal(table.project(other), pixels)
    assert table.project([0, 0, 1]).tolist() == list(table.camera.centre)


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


@pytest.mark.parametrize("lens", [Orthographic(1500.0), Brown(1800.0, -0.29, 0.11, -0.02), Thoby(600.0)])
def test_a_lens_is_tabulated_to_where_it_stops_growing(lens: Lens) -> None:
    """There theta runs away like a root of r: the inverse counts by a root."""
    camera = Camera(lens, (4000, 3000), (2000.0, 1500.0), half_fov=lens.theta_max)
    table = tabulate(camera)
    assert table.inverse_variable == kernels.FROM_RIM
    assert max(largest_errors_px(table, 8)) <= 1.01e-8


def test_even_powers_of_theta_count_by_the_root_from_the_axis() -> None:
    table = tabulate(widest_named("scaramuzza"))
    assert table.inverse_variable == kernels.FROM_AXIS
    assert table.inverse_s.shape[0] <= 1024


NEARLY_ALL_ROUND = pytest.mark.parametrize(
    ("lens", "half_fov_deg"),
    [
        (Equidistant(600.0), 180.0),
        (Equisolid(1000.0), 180.0),
        (Stereographic(50.0), 175.0),
        (KannalaBrandt(600.0, 0.002, 0.0, 0.0, 0.0), 179.0),
        (Equidistant(600.0), 120.001),
    ],
)


@NEARLY_ALL_ROUND
def test_lenses_that_see_nearly_all_round(lens: Lens, half_fov_deg: float) -> None:
    """Towards 180 degrees r/sin(theta) runs away: the forward table holds another function."""
    camera = Camera(lens, (4000, 3000), (2000.0, 1500.0), half_fov=math.radians(half_fov_deg))
    table = tabulate(camera)
    assert table.forward_variable == kernels.HALF_ANGLE
    assert max(largest_errors_px(table, 9)) <= 1.01e-8
    assert np.isfinite(table.project(rays_within(camera, 9))).all()
    assert np.isnan(table.project([0.0, 0.0, -1.0])).all()
    assert np.isnan(table.project(np.array([0, 0, -1], np.float32), dtype=np.float32)).all()
    if half_fov_deg < 179.9:
        beyond = rays_at(np.linspace(camera.half_fov + 1e-6, math.pi, 50), 0)
        assert np.isnan(table.project(beyond)).all()


def test_what_cannot_be_tabulated_is_refused_with_what_was_reached() -> None:
    camera = Camera(Stereographic(1.0), (4000, 3000), (2000.0, 1500.0), half_fov=math.radians(179.9))
    with pytest.raises(ResourceError, match=r"reach .* px"):
        tabulate(camera, 1e-9)


@pytest.mark.parametrize("tolerance_px", [0.0, -1.0, math.nan])
def test_a_tolerance_that_nothing_meets_is_refused(tolerance_px: float) -> None:
    with pytest.raises(UsageError, match="tolerance"):
        tabulate(fisheye(1000), tolerance_px)


WHOLE_SPHERE = Camera(Equidistant(150.0), (1000, 1000), (499.5, 501.5), half_fov=math.pi)


@pytest.mark.parametrize("camera", [fisheye(1000), WHOLE_SPHERE], ids=["fisheye", "whole sphere"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_what_is_no_direction_is_nan(dtype: type, camera: Camera) -> None:
    table = tabulate(camera, 1e-3)
    nothing = [
        [0, 0, 0], [0, 0, 2], [0, 0, 0.99], [0, 0, math.inf], [math.inf, 0, 0], [-math.inf, math.inf, 1],
        [math.nan, 0, 1], [0, math.nan, 1], [0, 0, math.nan], [1e30, 1e30, 1e30],
    ]  # fmt: skip
    given: NDArray[Any] = np.array(nothing * 9, dtype)  # enough of them for a vector
    assert np.isnan(table.project(given, dtype=dtype)).all()
    assert np.isnan(table.project(given, rotation(1), dtype)).all()
    nowhere: NDArray[Any] = np.array(
        [[math.nan, 5], [5, math.nan], [math.inf, 0], [0, -math.inf], [1e30, 1e30]] * 17, dtype
    )
    assert np.isnan(table.unproject(nowhere, dtype)).all()
    good: NDArray[Any] = np.array([[0, 0, 1], *nothing, [0, 0, 1]], dtype)
    assert np.isfinite(table.project(good, dtype=dtype)[[0, -1]]).all()


@pytest.mark.parametrize("camera", [fisheye(1000), WHOLE_SPHERE], ids=["fisheye", "whole sphere"])
@pytest.mark.parametrize("single", [False, True])
@given(start=st.integers(0, 40), count=st.integers(1, 150))
@law(20)
def test_bits_do_not_depend_on_how_arrays_are_split(single: bool, camera: Camera, start: int, count: int) -> None:
    """A vector's worth of rays, the rest of a row, one alone: nothing is re-associated or fused."""
    dtype, table, turn = np.float32 if single else np.float64, tabulate(camera, 1e-6), rotation(2)
    rays = (rays_at(np.random.default_rng(1).uniform(0, 1.1 * table.camera.half_fov, 200), 1) @ turn).astype(dtype)
    part = slice(start, start + count)
    pixels = table.project(rays, turn, dtype)
    np.testing.assert_array_equal(table.project(rays[part], turn, dtype), pixels[part])
    np.testing.assert_array_equal(table.project(rays[start], turn, dtype), pixels[start])
    given = np.random.default_rng(2).uniform(0, 1000, (200, 2)).astype(dtype)
    back = table.unproject(given, dtype)
    np.testing.assert_array_equal(table.unproject(given[part], dtype), back[part])
    np.testing.assert_array_equal(table.unproject(given[start], dtype), back[start])
    window = table.window_rays(slice(400, 600), slice(7, 9), dtype)
    np.testing.assert_array_equal(table.window_rays(slice(400 + start, 402 + start), slice(8, 9), dtype)[0],
                                  window[1, start : start + 2])  # fmt: skip


@pytest.mark.parametrize("name", ["bakstein-pajdla", "scaramuzza", "brown"])
def test_window_rays_are_those_of_the_pixels(name: str) -> None:
    table = tabulate(typical(name))
    columns, rows = slice(-3000, 7000), slice(1480, 1500)
    window = table.window_rays(columns, rows)
    u, v = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
    one_by_one = table.unproject(np.stack([u, v], -1))
    np.testing.assert_allclose(window, one_by_one, rtol=0, atol=1e-12)
    assert 0 < np.isnan(window[..., 0]).mean() < 1
    single = table.window_rays(columns, rows, np.float32)
    assert single.dtype == np.dtype(np.float32)
    np.testing.assert_allclose(single, one_by_one, rtol=0, atol=1e-6)
    assert table.window_rays(slice(5, 5), slice(0, 3)).shape == (3, 0, 3)


def test_what_is_no_array_of_rays_or_pixels_is_refused() -> None:
    table = tabulate(fisheye(1000), 1e-3)
    with pytest.raises(UsageError, match="ends in 3 values"):
        table.project(np.zeros((3, 2)))
    with pytest.raises(UsageError, match="ends in 2 values"):
        table.unproject(5.0)
    with pytest.raises(UsageError, match="float32 or float64"):
        table.project([0, 0, 1], dtype=np.uint8)
    with pytest.raises(UsageError, match=r"\(3, 3\)"):
        table.project([0, 0, 1], [0, 0, 1])


@pytest.mark.parametrize("kernel", [kernels.project_rays, kernels.project_rays_half_angle])
def test_no_kernel_fuses_a_product_and_a_sum(kernel: Any) -> None:
    """Else the bits of a vector and of the rest of a row could differ."""
    rays, pixels, turn = np.zeros(30), np.zeros(20), np.eye(3).reshape(-1)
    pieces = np.ones(16)
    fresh = numba.njit(kernel.py_func, error_model="numpy", pipeline_class=kernels._ArraysApart)
    fresh(rays, turn, pieces, -0.1, -0.1, 0.0, 0.0, 1.0, pixels)
    (assembly,) = fresh.inspect_asm().values()
    assert "mul" in assembly
    assert "fmadd" not in assembly
    assert "fmla" not in assembly


def test_project_kernel_against_its_twin() -> None:
    table, turn = tabulate(fisheye(1000, aspect=0.97), 1e-3), rotation(11)
    rays = rays_at(np.random.default_rng(0).uniform(0, math.pi, 501), 4)
    rays[7] *= 1.01
    z_min, camera = math.cos(table.camera.half_fov), table.camera
    pixels = np.empty((501, 2))
    kernels.project_rays(
        rays.reshape(-1), turn.reshape(-1), table.forward.reshape(-1), z_min, z_min - 1e-12,
        *camera.centre, camera.aspect, pixels.reshape(-1),
    )  # fmt: skip
    x, y, z = (rays @ turn.T).T
    g = _cubic(table.forward, (z - z_min) / (1 - z_min))
    twin = np.stack([camera.centre[0] + g * x, camera.centre[1] + camera.aspect * g * y], -1)
    twin[(z < z_min - 1e-12) | (abs((rays**2).sum(-1) - 1) > 1e-5)] = np.nan
    np.testing.assert_allclose(pixels, twin, rtol=0, atol=1e-9)
    assert 0 < np.isnan(pixels[:, 0]).sum() < 501


def test_half_angle_kernel_against_its_twin() -> None:
    turn, centre, aspect, w_min = rotation(11), (480.0, 510.0), 0.97, 0.1
    rays = rays_at(np.random.default_rng(0).uniform(0, math.pi, 501), 4)
    rays[7] *= 1.01
    pieces = np.random.default_rng(1).uniform(-1, 1, (64, 4))
    pixels = np.empty((501, 2))
    kernels.project_rays_half_angle(
        rays.reshape(-1), turn.reshape(-1), pieces.reshape(-1), w_min, w_min, *centre, aspect, pixels.reshape(-1)
    )
    x, y, z = (rays @ turn.T).T
    w = np.cos(np.arctan2(np.hypot(x, y), z) / 2)
    h = _cubic(pieces, np.maximum(w - w_min, 0) / (1 - w_min))
    twin = np.stack([centre[0] + h * x / w, centre[1] + aspect * h * y / w], -1)
    twin[(w < w_min) | (abs((rays**2).sum(-1) - 1) > 1e-5)] = np.nan
    np.testing.assert_allclose(pixels, twin, rtol=0, atol=1e-9)
    assert 0 < np.isnan(pixels[:, 0]).sum() < 501


@pytest.mark.parametrize("variable", [kernels.PLAIN, kernels.FROM_AXIS, kernels.FROM_RIM])
def test_unproject_kernels_against_their_twin(variable: int) -> None:
    rng = np.random.default_rng(0)
    pieces_s, pieces_c = rng.uniform(-1, 1, (2, 64, 4))
    q_max, q_limit, aspect, centre = 450.0**2, 451.0**2, 0.97, np.array([480.0, 510.0])
    u, v = np.meshgrid(np.arange(3, 1003, 7.0), np.arange(-20, 1000, 11.0))
    pixels = np.stack([u, v], -1)
    rays, by_grid = np.empty((2, *u.shape, 3))
    tables = pieces_s.reshape(-1), pieces_c.reshape(-1), variable, q_max, q_limit
    kernels.unproject_pixels(pixels.reshape(-1), *tables, centre[0], centre[1], aspect, rays.reshape(-1))
    kernels.unproject_grid(u[0] - centre[0], (v[:, 0] - centre[1]) / aspect, *tables, by_grid)
    x, y = u - centre[0], (v - centre[1]) / aspect
    q = x**2 + y**2
    share = q / q_max
    at = {
        kernels.PLAIN: share,
        kernels.FROM_AXIS: np.sqrt(share),
        kernels.FROM_RIM: 1 - np.sqrt(np.clip(1 - share, 0, 1)),
    }
    s, c = _cubic(pieces_s, at[variable]), _cubic(pieces_c, at[variable])
    twin = np.stack([s * x, s * y, c], -1)
    twin[q > q_limit] = np.nan
    np.testing.assert_allclose(rays, twin, rtol=0, atol=1e-8)
    np.testing.assert_allclose(by_grid, twin, rtol=0, atol=1e-8)
    assert 0 < np.isnan(rays[..., 0]).mean() < 1


def _cubic(pieces: FloatArray, at: FloatArray) -> FloatArray:
    """The piecewise cubic at positions from 0 on, by powers."""
    cells = len(pieces)
    cell = np.clip(np.floor(at * cells).astype(int), 0, cells - 1)
    t = at * cells - cell
    return np.asarray(sum(pieces[cell, k] * t**k for k in range(4)))
