"""The synthetic worlds are what they say they are: everything else is measured against them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import BaksteinPajdla
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic import world_kernels
from fullsphere.mosaic.worlds import (
    Panel,
    PanelScene,
    environment,
    furnished_room,
    panorama,
    photograph,
    turn,
)


@pytest.fixture(scope="module")
def room() -> PanelScene:
    return furnished_room(seed=1, texel_mm=8.0)


@pytest.fixture(scope="module")
def around(room: PanelScene) -> PanelScene:
    return environment(room, face_px=256)


def wide_camera(side: int) -> Camera:
    half = math.radians(91.5)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    lens = lens.scaled(0.48 * side / float(lens.radius(half)))
    return Camera(lens, (side, side), (side / 2 + 2.3, side / 2 - 1.7), half_fov=half)


TURNED = Rotation.from_euler("YXZ", [40, 15, -8], degrees=True).inv().as_matrix()


def decode(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    x = picture / 255.0
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


class Uniform:
    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        return np.where(np.isnan(rays), 0.0, 0.2).astype(np.float32)


class Smooth:
    """Light that changes slowly, so that a pixel's mean is its centre's value."""

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        rays = np.asarray(rays)
        light: NDArray[np.float32] = np.nan_to_num(0.4 + 0.3 * rays * rays[..., [1, 2, 0]]).astype(np.float32)
        light[np.isnan(rays)] = 0
        return light


def test_rendering_is_deterministic_whatever_the_threads(around: PanelScene) -> None:
    camera = wide_camera(700)
    first = photograph(around, camera, TURNED, noise=0.01, seed=3)
    with thread_pool(2) as pool:
        assert np.array_equal(first, photograph(around, camera, TURNED, noise=0.01, seed=3, executor=pool))
    assert not np.array_equal(first, photograph(around, camera, TURNED, noise=0.01, seed=4))
    again = environment(furnished_room(seed=1, texel_mm=8.0), face_px=256)
    assert all(np.array_equal(a.texture, b.texture) for a, b in zip(around.panels, again.panels, strict=True))


def test_frame_agrees_with_radiance_through_the_exact_camera() -> None:
    camera = wide_camera(300)
    frame = photograph(Smooth(), camera, TURNED)
    rays = camera.unproject(np.stack(np.meshgrid(np.arange(300), np.arange(300)), -1))
    inside = rays[..., 2] > math.cos(math.radians(90.5))
    expected = encoded_from_linear(Smooth().radiance(rays @ TURNED), np.uint8).astype(int)
    assert np.abs(frame.astype(int) - expected)[inside].max() <= 1


def test_room_frame_agrees_with_radiance_at_one_sample_a_pixel(around: PanelScene) -> None:
    camera = wide_camera(200)
    frame = photograph(around, camera, TURNED, supersampling=1)
    rays = camera.unproject(np.stack(np.meshgrid(np.arange(200), np.arange(200)), -1))
    inside = np.isfinite(rays).all(-1)
    expected = encoded_from_linear(around.radiance(rays @ TURNED), np.uint8).astype(int)
    difference = np.abs(frame.astype(int) - expected)[inside]
    assert np.percentile(difference, 99.9) <= 1  # a ray on a face's edge may meet either


def test_picture_is_black_outside_the_field_of_view(around: PanelScene) -> None:
    camera = wide_camera(200)
    frame = photograph(around, camera, TURNED, noise=0.02)
    u, v = np.meshgrid(np.arange(200), np.arange(200))
    r = np.hypot(u - camera.centre[0], v - camera.centre[1])
    rim = float(camera.lens.radius(camera.half_fov))
    assert not frame[r > rim + 1].any()
    assert frame[r < rim - 1].any(axis=-1).all()


def test_one_ev_doubles_linear_light() -> None:
    camera = wide_camera(64)
    one, two = (decode(photograph(Uniform(), camera, np.eye(3), exposure_ev=ev)[32, 32]) for ev in (0.0, 1.0))
    np.testing.assert_allclose(two / one, 2.0, rtol=0.02)


def test_vignetting_is_as_stated() -> None:
    camera = wide_camera(200)
    frame = decode(photograph(Uniform(), camera, np.eye(3), vignetting=(-0.3, -0.1)))
    for theta in np.radians([0.0, 30.0, 60.0, 85.0]):
        u, v = np.rint(camera.project([math.sin(theta), 0, math.cos(theta)])).astype(int)
        ray = camera.unproject([u, v])
        s = (math.acos(ray[2]) / camera.half_fov) ** 2
        np.testing.assert_allclose(frame[v, u], 0.2 * (1 - 0.3 * s - 0.1 * s * s), rtol=0.02)


def test_panorama_agrees_with_radiance_at_known_rays() -> None:
    sphere = panorama(Smooth(), 512)
    assert sphere.shape == (256, 512, 3) and sphere.dtype == np.float32
    for ray, column, row in (
        ([0, 0, 1], 255.5, 127.5),
        ([1, 0, 0], 383.5, 127.5),
        ([-1, 0, 0], 127.5, 127.5),
        ([0, -(0.5**0.5), 0.5**0.5], 255.5, 63.5),
    ):
        x, y = int(column), int(row)
        np.testing.assert_allclose(
            sphere[y : y + 2, x : x + 2].mean((0, 1)), Smooth().radiance(np.array(ray)), atol=2e-4
        )


def test_room_has_light_in_all_directions(room: PanelScene) -> None:
    rays = np.random.default_rng(0).standard_normal((20_000, 3))
    light = room.radiance(rays)
    assert light.dtype == np.float32
    assert light.min() > 0.0099 and light.max() < 1.001
    assert room.radiance([np.nan, 0, 1]).tolist() == [0, 0, 0]
    assert room.radiance(np.zeros((0, 3))).shape == (0, 3)


def test_environment_is_the_room(room: PanelScene, around: PanelScene) -> None:
    light, seen = panorama(room, 256, supersampling=4), panorama(around, 256, supersampling=4)
    assert np.mean(np.abs(light - seen)) < 0.01


def test_panels_have_parallax_and_hide_each_other() -> None:
    def square(depth: float, half: float, colour: Any) -> Panel:
        texture = np.full((4, 4, 3), colour, np.float32)
        return Panel(np.array([-half, -half, depth]), np.array([2 * half, 0, 0]), np.array([0, 2 * half, 0]), texture)

    scene = PanelScene((square(2.0, 5.0, 0.3), square(1.0, 0.1, 0.9)))
    rays = np.array([[0, 0, 1.0], [0.5, 0, 1.0], [0, 0, -1.0]])
    assert scene.radiance(rays)[:, 0].tolist() == pytest.approx([0.9, 0.3, 0.02])
    assert scene.seen_from([0.5, 0, 0]).radiance(rays)[:, 0].tolist() == pytest.approx([0.3, 0.3, 0.02])


def test_kernel_agrees_with_its_numpy_twin(room: PanelScene) -> None:
    rays = np.random.default_rng(5).standard_normal((500, 3))
    atlas = room._atlas
    got = np.zeros((2, 500), np.float32)
    world_kernels.meet_panels(rays, atlas.texel_from_ray, atlas.sizes, atlas.corners, -1.0, -1.0, got[0], got[1])
    along = np.einsum("mij,nj->nmi", atlas.texel_from_ray, rays)
    with np.errstate(divide="ignore", invalid="ignore"):
        texel = along[..., :2] / along[..., 2:]
    met = (along[..., 2] > 0) & (texel >= -0.5).all(-1) & (texel <= atlas.sizes - 0.5).all(-1)
    nearest = np.where(met, along[..., 2], 0).argmax(1)
    expected = np.take_along_axis(texel, nearest[:, None, None], 1)[:, 0] + atlas.corners[nearest]
    np.testing.assert_allclose(got.T, expected, rtol=1e-6, atol=1e-3)


def test_turn_is_a_full_turn_of_rotations() -> None:
    shots = turn(8, pitch_deg=20, jitter_deg=2, exposure_ev=0.5, seed=4)
    assert len(shots) == 8 and shots[0].exposure_ev == 0 and len({s.seed for s in shots}) == 8
    for i, shot in enumerate(shots):
        r = shot.camera_from_world
        np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(r) == pytest.approx(1)
        x, y, z = r.T @ [0, 0, 1]
        assert (math.degrees(math.atan2(x, z)) - 45 * i + 180) % 360 - 180 == pytest.approx(0, abs=8)
        assert math.degrees(math.asin(-y)) == pytest.approx(20 * (-1) ** i, abs=8)
        assert abs(shot.exposure_ev) <= 0.5
    with pytest.raises(UsageError):
        turn(0)
