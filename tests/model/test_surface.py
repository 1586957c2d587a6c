"""Every surface maps pixels to unit rays and back, as docs/conventions.md and docs/projections.md have it."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.model.camera import FastProjection, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator, Mosaic360, SeparableSurface
from laws import SEEDS, SURFACES, angle_between, law, rotation

WHOLE = Equirectangular((400, 200))
SEPARABLE = {name: surface for name, surface in SURFACES.items() if isinstance(surface, SeparableSurface)}
ROUND = {name: surface for name, surface in SEPARABLE.items() if surface.wraps}

every_surface = pytest.mark.parametrize("name", SURFACES)
every_separable = pytest.mark.parametrize("name", SEPARABLE)

HARD_RAYS = np.array(
    [
        *([0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [1, 1, 1], [-1, 1, -1], [1, 1, 0]),
        *([1e-13, 0, -1], [-1e-13, 0, -1], [1e-9, -5, 0], [0, -1, 1], [1e-20, -3, 1e-20], [-0.0, -0.0, -1]),
    ],
    float,
)


def some_pixels(surface: FastProjection, seed: int, count: int = 300) -> FloatArray:
    """Pixels that `project` answers: all over the picture, but on the 360 x 360 mosaic in its left eye only."""
    width, height = surface.size
    top, bottom = (0.25, 0.75) if isinstance(surface, Mosaic360) else (0.0, 1.0)
    margin = 1e-6
    low = [-0.5 + margin * width, (top + margin) * height - 0.5]
    high = [(1 - margin) * width - 0.5, (bottom - margin) * height - 0.5]
    return np.random.default_rng(seed).uniform(low, high, (count, 2))


def some_rays(seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.concatenate([HARD_RAYS, rng.normal(size=(200, 3)) * 10 ** rng.uniform(-3, 3, (200, 1))])


@every_surface
@given(seed=SEEDS)
@law(10)
def test_project_inverts_unproject(name: str, seed: int) -> None:
    surface = SURFACES[name]
    pixels = some_pixels(surface, seed)
    rays = surface.unproject(pixels)
    seen = np.isfinite(rays[:, 0])
    assert seen.mean() > 0.3  # a cross has six faces in twelve cells
    np.testing.assert_allclose(np.linalg.norm(rays[seen], axis=-1), 1, atol=1e-14)
    lengths = np.random.default_rng(seed).uniform(0.1, 10, (int(seen.sum()), 1))
    np.testing.assert_allclose(surface.project(rays[seen] * lengths), pixels[seen], rtol=0, atol=1e-8)
    small = surface.project(rays[seen], None, np.float32)
    assert small.dtype == np.float32
    np.testing.assert_allclose(small, pixels[seen], rtol=0, atol=1e-4)


@every_surface
@given(seed=SEEDS)
@law(10)
def test_unproject_inverts_project_for_rays_of_any_length(name: str, seed: int) -> None:
    surface, rays = SURFACES[name], some_rays(seed)
    pixels = surface.project(rays)
    answered = np.isfinite(pixels[:, 0])
    endless = isinstance(surface, Cylindrical | Mercator)
    assert answered.all() or (endless and np.all(rays[~answered][:, [0, 2]] == 0))
    moderate = np.abs(rays[:, 1]) < 1e5 * np.hypot(rays[:, 0], rays[:, 2]) if endless else answered
    np.testing.assert_allclose(angle_between(surface.unproject(pixels[moderate]), rays[moderate]), 0, atol=1e-13)


@given(half=st.integers(1, 16384), seed=SEEDS)
@law()
def test_a_sphere_of_any_size(half: int, seed: int) -> None:
    surface = Equirectangular((2 * half, half))
    rays = some_rays(seed)
    x, y, z = rays.T
    u = (np.arctan2(x, z) / (2 * math.pi) + 0.5) * 2 * half - 0.5
    v = (0.5 + np.arctan2(y, np.hypot(x, z)) / math.pi) * half - 0.5
    pixels = surface.project(rays)
    around = 2 * half
    np.testing.assert_allclose((pixels[:, 0] - u + half) % around - half, 0, atol=1e-9)
    np.testing.assert_allclose(pixels[:, 1], v, rtol=0, atol=1e-9)
    if half <= 4096:
        np.testing.assert_allclose(surface.project(rays, None, np.float32)[:, 1], v, rtol=0, atol=1e-3)


@every_surface
def test_window_rays_are_those_of_its_pixels(name: str) -> None:
    """Past the border too, and in float32."""
    surface = SURFACES[name]
    width, height = surface.size
    columns, rows = slice(-3, width + 5), slice(-40, height + 2)
    u, v = np.meshgrid(np.arange(-3, width + 5), np.arange(-40, height + 2))
    exact = surface.unproject(np.stack([u, v], -1))
    window = surface.window_rays(columns, rows)
    assert window.dtype == np.float64
    np.testing.assert_allclose(window, exact, rtol=0, atol=1e-15)
    small = surface.window_rays(columns, rows, np.float32)
    np.testing.assert_array_equal(small, window.astype(np.float32))


@every_surface
def test_the_same_bytes_however_a_picture_is_cut(name: str) -> None:
    surface = SURFACES[name]
    width, height = surface.size
    whole = surface.window_rays(slice(0, width), slice(0, height))
    for left, top, right, bottom in ((0, 0, 7, 3), (5, 11, 38, 12), (13, 1, width, height), (30, 20, 31, 37)):
        part = surface.window_rays(slice(left, right), slice(top, bottom))
        np.testing.assert_array_equal(part, whole[top:bottom, left:right])
        for dtype in (np.float32, np.float64):
            pixels = surface.project(whole, rotation(4), dtype)
            np.testing.assert_array_equal(surface.project(part, rotation(4), dtype), pixels[top:bottom, left:right])


@every_separable
def test_rays_are_of_columns_and_rows(name: str) -> None:
    surface = SEPARABLE[name]
    columns, rows = slice(-4, 17), slice(3, 60)
    (x, z), (horizontal, vertical) = surface.column_directions(columns).T, surface.row_profile(rows).T
    np.testing.assert_allclose(x**2 + z**2, 1, atol=1e-15)
    window = surface.window_rays(columns, rows)
    np.testing.assert_allclose(window[..., 0], horizontal[:, None] * x, rtol=0, atol=1e-16)
    np.testing.assert_allclose(window[..., 1], np.broadcast_to(vertical[:, None], window.shape[:2]), rtol=0, atol=0)
    np.testing.assert_allclose(window[..., 2], horizontal[:, None] * z, rtol=0, atol=1e-16)


@every_surface
@given(seed=SEEDS)
@law(5)
def test_a_rotation_turns_the_rays_first(name: str, seed: int) -> None:
    surface, rays, turn = SURFACES[name], some_rays(seed)[len(HARD_RAYS) :], rotation(seed)
    moved = np.abs(surface.project(rays, turn) - surface.project(rays @ turn.T))
    if name in ROUND:
        moved[:, 0] = np.minimum(moved[:, 0], surface.size[0] - moved[:, 0])
    assert np.median(moved) < 1e-10
    assert np.quantile(moved, 0.98) < 1e-8  # a ray may be at a pole, at the seam or at an edge of the cube


@every_surface
def test_rays_of_any_shape_and_type(name: str) -> None:
    surface = SURFACES[name]
    rays = np.random.default_rng(2).normal(size=(6, 7, 5, 3))
    pixels = surface.project(rays)
    assert pixels.shape == (6, 7, 5, 2)
    np.testing.assert_array_equal(surface.project(rays[2, 3, 1]), pixels[2, 3, 1])
    np.testing.assert_array_equal(surface.project(rays[::2, ::-1]), pixels[::2, ::-1])
    assert surface.project(np.zeros((0, 4, 3))).shape == (0, 4, 2)
    assert surface.unproject(pixels).shape == rays.shape
    single = rays.astype(np.float32)
    np.testing.assert_array_equal(surface.project(single), surface.project(single.astype(float)))
    assert isinstance(surface, Projection)
    assert isinstance(surface, FastProjection)


@pytest.mark.parametrize("name", ROUND)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_circle_has_one_column_at_its_seam(name: str, dtype: Any) -> None:
    """The right border is the left one: u is in [-0.5, W - 0.5) whatever the rounding."""
    surface = ROUND[name]
    width = surface.size[0]
    seam = surface.longitudes[0]
    lon = seam + np.concatenate([[0.0], 10.0 ** -np.arange(3, 18), -(10.0 ** -np.arange(3, 18))])
    for k in range(3):
        rays = np.stack([np.sin(lon), np.full_like(lon, 0.1 * k), np.cos(lon)], -1)
        u = surface.project(rays, None, dtype)[:, 0]
        assert np.all((u >= -0.5) & (u < width - 0.5))
        np.testing.assert_allclose(np.minimum(u + 0.5, width - 0.5 - u), 0, atol=1e-3 * width)


@pytest.mark.parametrize("name", [name for name in SEPARABLE if name not in ROUND])
def test_a_window_goes_on_past_its_border(name: str) -> None:
    """Half a turn to either side of its middle: whether a pixel is in the picture is the caller's question."""
    surface = SEPARABLE[name]
    width, height = surface.size
    left, right = surface.longitudes
    reach = width * math.pi / (right - left) - 1
    u = np.linspace(width / 2 - 0.5 - reach, width / 2 - 0.5 + reach, 50)
    pixels = np.stack([u, np.full_like(u, height / 3)], -1)
    np.testing.assert_allclose(surface.project(surface.unproject(pixels)), pixels, rtol=0, atol=1e-9)


@every_surface
def test_no_direction_is_nan(name: str) -> None:
    part = np.array([-math.inf, -1.0, -0.0, 0.0, 1.0, math.nan, -math.nan, math.inf])
    rays = np.stack(np.meshgrid(part, part, part), -1).reshape(-1, 3)
    nothing = ~np.isfinite(rays).all(-1) | (rays == 0).all(-1)
    for dtype in (np.float32, np.float64):
        assert np.isnan(SURFACES[name].project(rays[nothing], None, dtype)).all()
        assert np.isfinite(SURFACES[name].project(rays[~nothing & (rays[:, 2] != 0)], None, dtype)).all()
    assert np.all(np.isnan(SURFACES[name].unproject([math.nan, 1.0])))


@every_surface
@pytest.mark.parametrize("turn", [np.full((3, 3), math.nan), np.eye(2), np.diag([1, math.inf, 1])])
def test_a_rotation_that_is_none_is_refused(name: str, turn: FloatArray) -> None:
    with pytest.raises(UsageError, match="3 x 3 finite"):
        SURFACES[name].project([0.0, 0.0, 1.0], turn)


def test_the_whole_sphere() -> None:
    """The middle looks along +z, the right quarter along +x, the top row up (-y)."""
    np.testing.assert_allclose(WHOLE.project([0, 0, 1]), [199.5, 99.5])
    np.testing.assert_allclose(WHOLE.project([1, 0, 0]), [299.5, 99.5])
    np.testing.assert_allclose(WHOLE.project([0, -1, 1]), [199.5, 49.5])
    np.testing.assert_allclose(WHOLE.unproject([199.5, -0.5]), [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(WHOLE.project([[0, -1, 0], [0, 1, 0]]), [[199.5, -0.5], [199.5, 199.5]])
    assert WHOLE.project([0, 0, -1])[0] == WHOLE.project([-0.0, 0, -1])[0] == -0.5
    assert WHOLE.whole
    assert not SEPARABLE["belt"].whole  # type: ignore[attr-defined]


def test_the_sphere_goes_on_past_the_border() -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 400, 100), rng.uniform(0, 10, 100)
    inside = WHOLE.unproject(np.stack([u, v], -1))
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 400, v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u - 400, v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 200, -1 - v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 200, 400 - 1 - v], -1)), inside, atol=1e-12)


def test_a_window_is_cut_out_of_the_sphere() -> None:
    """Columns 100 to 249 and rows 20 to 119 of the whole one."""
    step = 2 * math.pi / 400
    window = Equirectangular((150, 100), (-100 * step, 50 * step), (-20 * step, 80 * step))
    whole = WHOLE.window_rays(slice(100, 250), slice(20, 120))
    np.testing.assert_allclose(window.window_rays(slice(0, 150), slice(0, 100)), whole, rtol=0, atol=1e-14)


def test_rows_of_cylinder_and_mercator() -> None:
    """tan(lat) and asinh(tan(lat)) of the limits are the borders; square pixels are those of a turn's length."""
    for surface, height_of in ((Cylindrical, math.tan), (Mercator, lambda lat: math.atanh(math.sin(lat)))):
        limited = surface((300, 200), 2.0, (-0.3, 1.1))
        bottom, top = (np.array([0.0, -math.sin(lat), math.cos(lat)]) for lat in (-0.3, 1.1))
        np.testing.assert_allclose(limited.project([top, bottom])[:, 1], [-0.5, 199.5], atol=1e-10)
        np.testing.assert_allclose(limited.heights, (height_of(-0.3), height_of(1.1)))
        square = surface((300, 200), 2.0)
        np.testing.assert_allclose(square.heights, (-200 / 300, 200 / 300))
        ray = square.unproject([149.5, 99.5 - 75])  # 75 pixels of 2/300 radians: half a unit over the horizon
        assert height_of(math.atan2(-ray[1], ray[2])) == pytest.approx(0.5)
        assert np.all(np.isnan(square.project([0, 1, 0])))


def test_the_mosaic_holds_each_direction_twice() -> None:
    """Left eye in the middle, towards alpha + 90; right eye above and below, towards alpha - 90."""
    mosaic = Mosaic360((360, 360))
    rng = np.random.default_rng(1)
    alpha, psi = np.radians(rng.uniform(0, 360, 100)), np.radians(rng.uniform(-180, 180, 100))
    pixels = np.stack([np.degrees(alpha) - 0.5, 180 - np.degrees(psi) - 0.5], -1)
    right, up = np.stack([np.cos(alpha), 0 * alpha, -np.sin(alpha)], -1), np.array([0.0, -1.0, 0.0])
    rays = np.cos(psi)[:, None] * right + np.sin(psi)[:, None] * up
    np.testing.assert_allclose(mosaic.unproject(pixels), rays, atol=1e-14)
    answered = mosaic.project(rays)
    left = np.abs(psi) < math.pi / 2
    np.testing.assert_allclose(answered[left], pixels[left], atol=1e-10)
    half_a_turn_away = (pixels[:, 0] + 180.5) % 360 - 0.5
    np.testing.assert_allclose(answered[~left][:, 0], half_a_turn_away[~left], atol=1e-9)
    assert np.all((answered[:, 1] >= 89.5) & (answered[:, 1] <= 269.5))
    np.testing.assert_allclose(mosaic.unproject(answered), rays, atol=1e-13)
    for past in (np.array([360, 0]), np.array([0, -360])):  # it goes round past every border
        np.testing.assert_allclose(mosaic.unproject(pixels + past), rays, atol=1e-12)


@pytest.mark.parametrize("size", [(400, 199), (0, 0), (-4, -2), (1 << 21, 1 << 20), (200, 400)])
def test_a_size_that_is_no_whole_sphere_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(UsageError, match="twice as wide"):
        Equirectangular(size)


@pytest.mark.parametrize(
    ("longitudes", "latitudes", "words"),
    [
        ((1.0, 1.0), (-1.0, 1.0), "run to the right"),
        ((2.0, 1.0), (-1.0, 1.0), "run to the right"),
        ((-4.0, 4.0), (-1.0, 1.0), "at most 360"),
        ((0.0, math.nan), (-1.0, 1.0), "run to the right"),
        ((100.0, 101.0), (-1.0, 1.0), "run to the right"),
        ((0.0, 1.0), (1.0, -1.0), "run upwards"),
        ((0.0, 1.0), (-1.6, 1.0), "from -90 to 90"),
        ((0.0, 1.0), (-1.0, math.inf), "run upwards"),
    ],
)
def test_a_window_that_is_none_is_refused(
    longitudes: tuple[float, float], latitudes: tuple[float, float], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        Equirectangular((100, 100), longitudes, latitudes)


@pytest.mark.parametrize("surface", [Cylindrical, Mercator])
def test_a_cylinder_that_is_none_is_refused(surface: type[Cylindrical | Mercator]) -> None:
    for hfov in (0.0, -1.0, 7.0, math.nan, math.inf):
        with pytest.raises(UsageError, match="horizontal field of view"):
            surface((100, 100), hfov)
    for latitudes in ((-math.pi / 2, 0.0), (0.5, 0.5), (0.0, math.nan)):
        with pytest.raises(UsageError, match="run upwards"):
            surface((100, 100), 1.0, latitudes)


def test_a_size_is_whole_numbers() -> None:
    assert repr(Mosaic360((np.int64(8), 4.0)).size) == "(8, 4)"  # type: ignore[arg-type]


@every_separable
@pytest.mark.parametrize("size", [(0, 10), (10, -1), (1 << 21, 10), (10.5, 10), (math.nan, 10)])
def test_a_picture_without_pixels_is_refused(name: str, size: tuple[int, int]) -> None:
    with pytest.raises(UsageError, match="wide as high" if name == "sphere" else "a side is a whole number"):
        dataclasses.replace(SEPARABLE[name], size=size)  # type: ignore[type-var]
