"""Where pixels of a target stand in a source: every pair of projections against their exact functions."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import positions
from fullsphere.model.camera import Camera, FastProjection, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import (
    BaksteinPajdla,
    Equidistant,
    Equisolid,
    FloatArray,
    KannalaBrandt,
    Lens,
    Orthographic,
    Perspective,
    Stereographic,
    Thoby,
)
from fullsphere.model.positions import Geometry, Positions, checked_rotation, fast
from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator
from fullsphere.model.table import RayTable, tabulate
from laws import SURFACES, fisheye, rotation

SPHERE = Equirectangular((300, 150))
OFFSET = 4
TO_FLOAT32_PX = 1e-3

LENSES: dict[str, tuple[Lens, float]] = {  # with half the field of view, degrees
    "bakstein-pajdla": (BaksteinPajdla(1350.0, 2.11, 420.0, 1.13), 97.5),
    "equidistant": (Equidistant(1.0), 97.5),
    "equisolid": (Equisolid(1.0), 97.5),
    "stereographic": (Stereographic(1.0), 97.5),
    "thoby": (Thoby(1.0), 97.5),
    "kannala-brandt": (KannalaBrandt(1.0, 0.03, -0.006, 0.002, -0.0003), 97.5),
    "perspective": (Perspective(1.0), 75.0),
    "orthographic": (Orthographic(1.0), 80.0),
    "orthographic to the rim": (Orthographic(1.0), 90.0),
    "equidistant, nearly all": (Equidistant(1.0), 175.0),
    "equisolid, nearly all": (Equisolid(1.0), 179.0),
}


def camera_of(name: str, side: int, aspect: float = 1.0) -> Camera:
    lens, half_fov_deg = LENSES[name]
    half = math.radians(half_fov_deg)
    scaled = lens.scaled(0.49 * side / float(lens.radius(half)))
    return Camera(scaled, (side, side), (side / 2 + 3.3, side / 2 - 7.9), aspect=aspect, half_fov=half)


def exact(source: Projection, target: Projection, turn: FloatArray, rows: slice, columns: slice) -> FloatArray:
    """Positions (h, w, 2) by the two projections' own functions."""
    u, v = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
    return source.project(target.unproject(np.stack([u, v], -1).astype(float)) @ turn.T)


def within(pixels: FloatArray, size: tuple[int, int], margin: float = 0.0) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        u, v = (np.abs(pixels[..., k] - (size[k] - 1) / 2) <= size[k] / 2 + margin for k in (0, 1))
    return np.asarray(u & v)


def stacked(found: Positions | None) -> FloatArray:
    assert found is not None
    return np.stack([found.u, found.v], -1).astype(float) - OFFSET


def whole(projection: Projection, halo: int = 0) -> tuple[slice, slice]:
    width, height = projection.size
    return slice(-halo, height + halo), slice(-halo, width + halo)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("target", [Equirectangular((900, 450)), Cylindrical((800, 300)), Mercator((600, 500), 3.0)])
def test_a_lens_of_4000_px_is_met_to_a_thousandth(name: str, target: FastProjection) -> None:
    """195 degrees in float32: the table of g(z) read linearly, and what takes its place where the lens is too steep."""
    camera, turn = camera_of(name, 4000, 1.02), rotation(5)
    rows, columns = whole(target)
    found = stacked(Geometry(camera, target, turn, OFFSET).positions(rows, columns))
    pixels = exact(camera, target, turn, rows, columns)
    assert np.nanmax(np.abs(found - pixels)) <= TO_FLOAT32_PX
    inside = within(pixels, camera.size)
    assert inside.sum() > 3000
    # at the rim and the border rounding decides
    u, v = np.meshgrid(np.arange(columns.stop, dtype=float), np.arange(rows.stop, dtype=float))
    theta = np.arccos(np.clip(target.unproject(np.stack([u, v], -1)) @ turn[2], -1, 1))
    clear = (np.abs(theta - camera.half_fov) > 1e-3) & (
        within(pixels, camera.size, -0.01) | ~within(pixels, camera.size, 0.01)
    )
    np.testing.assert_array_equal(np.isfinite(found[..., 0])[clear], inside[clear])
    np.testing.assert_array_equal(np.isnan(found[..., 0]), np.isnan(found[..., 1]))


@pytest.mark.parametrize("name", ["bakstein-pajdla", "equisolid", "perspective", "orthographic"])
@pytest.mark.parametrize("side", [8193, 40000])
def test_long_sides_are_reckoned_in_float64(name: str, side: int) -> None:
    camera, turn = camera_of(name, side), rotation(6)
    geometry = Geometry(camera, SPHERE, turn, OFFSET)
    found = geometry.positions(*whole(SPHERE))
    assert found is not None
    assert found.u.dtype == found.v.dtype == np.float64
    assert np.nanmax(np.abs(stacked(found) - exact(camera, SPHERE, turn, *whole(SPHERE)))) <= TO_FLOAT32_PX


def test_a_side_of_8192_px_is_the_longest_in_float32() -> None:
    camera = camera_of("equidistant", 8192)
    found = Geometry(camera, SPHERE, np.eye(3), OFFSET).positions(*whole(SPHERE))
    assert found is not None
    assert found.u.dtype == np.float32
    assert np.nanmax(np.abs(stacked(found) - exact(camera, SPHERE, np.eye(3), *whole(SPHERE)))) <= 2 * TO_FLOAT32_PX


@pytest.mark.parametrize("name", LENSES)
def test_the_short_way_is_the_long_way(name: str) -> None:
    """Straight from separable rays to the lens, or by rays and its table: the same positions."""
    camera, turn = camera_of(name, 2000), rotation(7)
    rows, columns = whole(SPHERE, 1)
    short = stacked(Geometry(camera, SPHERE, turn, OFFSET).positions(rows, columns))
    long = stacked(Geometry(camera, OnlyPoints(SPHERE), turn, OFFSET).positions(rows, columns))
    assert np.nanmax(np.abs(short - long)) <= TO_FLOAT32_PX
    assert np.mean(np.isnan(short) != np.isnan(long)) < 1e-3


class OnlyPoints:
    """A projection of a user's own: size, project and unproject, and nothing else."""

    def __init__(self, projection: Projection) -> None:
        self._projection, self.size = projection, projection.size

    def project(self, rays: ArrayLike) -> FloatArray:
        return self._projection.project(rays)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        return self._projection.unproject(pixels)


@pytest.mark.parametrize("name", SURFACES)
def test_every_surface_as_a_source(name: str) -> None:
    source, turn = SURFACES[name], rotation(8)
    target = fisheye(120, 95)
    found = Geometry(source, target, turn, OFFSET).positions(*whole(target))
    if found is None:
        pytest.fail("nothing of the surface is seen")
    pixels = exact(source, target, turn, *whole(target))
    inside = within(pixels, source.size)
    both = inside & np.isfinite(stacked(found)[..., 0])
    assert both.sum() >= 0.999 * inside.sum() > 0
    assert np.isfinite(found.u).sum() <= inside.sum() * 1.001 + 1
    off = np.abs(stacked(found) - pixels)[both]
    off[:, 0] = np.minimum(off[:, 0], np.abs(off[:, 0] - source.size[0]))  # at a seam rounding decides on which side
    assert np.quantile(off.max(-1), 0.999) <= 1e-4
    assert np.mean(off.max(-1) > TO_FLOAT32_PX) <= 1e-3  # edges between the faces of a cube


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("source", [fisheye(500, 97, 0.97), SPHERE], ids=["fisheye", "sphere"])
def test_every_surface_as_a_target(name: str, source: Projection) -> None:
    target, turn = SURFACES[name], rotation(9)
    found = stacked(Geometry(source, target, turn, OFFSET).positions(*whole(target)))
    pixels = exact(source, target, turn, *whole(target))
    both = np.isfinite(found[..., 0]) & within(pixels, source.size)
    assert both.sum() > 200
    off = np.abs(found - pixels)[both]
    off[:, 0] = np.minimum(off[:, 0], np.abs(off[:, 0] - source.size[0]))
    assert off.max() <= TO_FLOAT32_PX
    assert np.mean(np.isfinite(found[..., 0]) != within(pixels, source.size)) < 2e-3


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (fisheye(500), Equirectangular((700, 350))),
        (SPHERE, fisheye(300)),
        (SURFACES["cube 3x2"], SURFACES["360x360"]),
        (fisheye(300), SURFACES["cube cross"]),
        (fisheye(9000), SURFACES["mercator"]),
    ],
    ids=["fisheye to sphere", "sphere to fisheye", "cube to 360x360", "fisheye to cube", "large fisheye to mercator"],
)
def test_rectangles_are_parts_of_the_whole(source: Projection, target: Projection) -> None:
    """Bit for bit, with a pixel around them too, wherever they begin and however wide they are."""
    geometry = Geometry(source, target, rotation(3), OFFSET)
    rows, columns = whole(target, 1)
    all_of_it = geometry.positions(rows, columns)
    assert all_of_it is not None
    rng = np.random.default_rng(0)
    for _ in range(25):
        top, bottom = np.sort(rng.choice(np.arange(-1, target.size[1] + 2), 2, replace=False))
        left, right = np.sort(rng.choice(np.arange(-1, target.size[0] + 2), 2, replace=False))
        part = geometry.positions(slice(int(top), int(bottom)), slice(int(left), int(right)))
        here = (slice(top + 1, bottom + 1), slice(left + 1, right + 1))
        if part is None:
            assert np.isnan(all_of_it.u[here]).all()
            continue
        np.testing.assert_array_equal(part.u, all_of_it.u[here])
        np.testing.assert_array_equal(part.v, all_of_it.v[here])


@pytest.mark.parametrize(
    "target", [SPHERE, OnlyPoints(SPHERE), SURFACES["cube strip"]], ids=["short", "points", "cube"]
)
def test_nothing_seen_is_none(target: Projection) -> None:
    narrow = Camera(Equidistant(100.0), (40, 40), (19.5, 19.5), half_fov=math.radians(10))
    geometry = Geometry(narrow, target, np.diag([-1.0, 1.0, -1.0]), OFFSET)
    middle = slice(target.size[0] // 2 - 5, target.size[0] // 2 + 5)
    assert geometry.positions(slice(0, 10), middle) is None
    assert geometry.positions(*whole(target)) is not None


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("surface", ["sphere", "window", "belt", "cylinder", "part of mercator", "360x360"])
@pytest.mark.parametrize("side", [100, 1000])
def test_no_step_is_larger_than_the_bound(name: str, surface: str, side: int) -> None:
    """Where it is small nobody looks for footprints."""
    camera, target = camera_of(name, side, 1.3), SURFACES[surface]
    geometry = Geometry(camera, target, rotation(side), OFFSET)
    found = stacked(geometry.positions(*whole(target, 1)))
    steps = [np.linalg.norm(np.diff(found, axis=axis), axis=-1) for axis in (0, 1)]
    assert max(float(np.nanmax(step)) for step in steps) <= geometry.largest_step
    assert Geometry(target, camera, np.eye(3), OFFSET).largest_step == math.inf


@pytest.mark.parametrize("name", ["equisolid", "equidistant", "thoby"])
@pytest.mark.parametrize("short_of_pi", [1e-2, 1e-4, 0.0])
def test_a_field_of_view_of_the_whole_sphere(name: str, short_of_pi: float) -> None:
    """Where r/sin(theta) has no bound another way is taken."""
    lens = LENSES[name][0]
    half = min(math.pi, lens.theta_max) - short_of_pi
    camera = Camera(lens.scaled(480 / float(lens.radius(half))), (1000, 1000), (499.5, 499.5), half_fov=half)
    found = stacked(Geometry(camera, SPHERE, rotation(2), OFFSET).positions(*whole(SPHERE)))
    pixels = exact(camera, SPHERE, rotation(2), *whole(SPHERE))
    assert np.nanmax(np.abs(found - pixels)) <= TO_FLOAT32_PX
    assert np.mean(np.isfinite(found[..., 0]) != within(pixels, camera.size)) < 1e-3


def test_steep_lenses_leave_the_short_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pair table says itself that it is not exact enough; then the result is that of the cubic tables."""
    camera = camera_of("stereographic", 4000)
    short = stacked(Geometry(camera, SPHERE, rotation(1), OFFSET).positions(*whole(SPHERE)))
    monkeypatch.setattr(positions, "_MOST_CELLS", 1)
    geometry = Geometry(camera, SPHERE, rotation(1), OFFSET)
    long = stacked(geometry.positions(*whole(SPHERE)))
    assert np.nanmax(np.abs(short - long)) <= TO_FLOAT32_PX
    assert (short != long)[np.isfinite(short)].any()


def test_a_table_stands_for_its_camera() -> None:
    camera = camera_of("bakstein-pajdla", 700)
    for target in (SPHERE, fisheye(200)):
        by_camera, by_table = (
            Geometry(source, target, rotation(4), OFFSET).positions(*whole(target))
            for source in (camera, tabulate(camera, 1e-6))
        )
        assert by_camera is not None
        assert by_table is not None
        np.testing.assert_array_equal(by_camera.u, by_table.u)
        np.testing.assert_array_equal(by_camera.v, by_table.v)


def test_the_axis_itself_has_a_position() -> None:
    """sin(theta) is zero there, and behind the camera; the mean of four pixels of the panorama looks along it."""
    camera = Camera(Equidistant(100.0), (630, 630), (314.5, 314.5), half_fov=math.radians(179))
    odd = Equirectangular((301, 151), (-1.505, 1.505), (-0.755, 0.755))
    found = stacked(Geometry(camera, odd, np.eye(3), OFFSET).positions(*whole(odd)))
    np.testing.assert_allclose(found[75, 150], [314.5, 314.5], rtol=0, atol=1e-4)
    behind = stacked(Geometry(camera, odd, np.diag([-1.0, 1.0, -1.0]), OFFSET).positions(*whole(odd)))
    assert np.isnan(behind[75, 150]).all()


def test_a_projection_of_a_users_own_is_asked_as_the_fast_ones_are() -> None:
    own = fast(OnlyPoints(SPHERE))
    rays = own.window_rays(slice(-1, 5), slice(2, 4))
    np.testing.assert_allclose(rays, SPHERE.window_rays(slice(-1, 5), slice(2, 4)), rtol=0, atol=1e-15)
    turned = own.project(rays, rotation(1), np.float32)
    assert turned.dtype == np.float32
    np.testing.assert_allclose(turned, SPHERE.project(rays @ rotation(1).T), rtol=0, atol=1e-3)
    assert isinstance(fast(fisheye(100)), RayTable)
    assert fast(SPHERE) is SPHERE


@pytest.mark.parametrize(
    "turn",
    [
        np.full((3, 3), np.nan),
        np.diag([1.0, 1.0, np.inf]),
        np.diag([1.0, 1.0, -1.0]),
        -np.eye(3),
        2 * np.eye(3),
        np.zeros((3, 3)),
        np.eye(4),
        np.eye(2),
        np.zeros(3),
        [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    ],
)
def test_what_is_no_rotation_is_refused(turn: Any) -> None:
    with pytest.raises(UsageError, match="rotation"):
        Geometry(SPHERE, SPHERE, turn, 0)


def test_a_rotation_may_be_rounded_and_in_any_order() -> None:
    turn = np.asfortranarray(rotation(0).astype(np.float32))
    checked = checked_rotation(turn)
    assert checked.flags.c_contiguous
    np.testing.assert_array_equal(checked, turn)
