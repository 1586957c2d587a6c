"""Frames on the working sphere show the scene's light where they see it, and say how well."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from turning import frames_of, orientation, ring, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.overview import RIM, overviews, working_sphere
from fullsphere.mosaic.overview_kernels import reduced_light, shown_on_sphere
from fullsphere.mosaic.project import Mosaic, Picture
from laws import fisheye, pixel_rays, smooth_light, smooth_panorama

CAMERA = fisheye(500)
NARROW = Camera(Perspective(400.0), (500, 400), (249.5, 199.5), half_fov=math.radians(45))
SPHERE = Equirectangular((256, 128))
TRUTH = smooth_panorama(256)
RAYS = pixel_rays(SPHERE)


@pytest.mark.parametrize("camera", [CAMERA, NARROW], ids=["fisheye", "ordinary"])
def test_light_is_the_scene_where_the_camera_sees_it(camera: Camera) -> None:
    rotations = np.array([*ring(3), orientation(20, 90)])
    frames = frames_of(smooth_light, camera, rotations, lambda k, light: srgb8(light))
    for overview, rotation in zip(overviews(Mosaic((camera,), tuple(frames), ()), SPHERE), rotations, strict=True):
        seen = np.isfinite(camera.project(RAYS @ rotation.T)[..., 0])
        seen &= RAYS @ rotation[2] > math.cos(camera.half_fov - RIM)
        u, v = np.moveaxis(camera.project(RAYS @ rotation.T), -1, 0)
        with np.errstate(invalid="ignore"):
            seen &= np.abs(u - camera.size[0] / 2 + 0.5) <= camera.size[0] / 2
            seen &= np.abs(v - camera.size[1] / 2 + 0.5) <= camera.size[1] / 2
        assert (overview.seen & ~seen).sum() <= 0.003 * seen.sum()
        assert (~overview.seen & seen).sum() <= 0.02 * seen.sum()
        np.testing.assert_allclose(overview.light[overview.seen], TRUTH[overview.seen], atol=0.02)
        assert not overview.light[~overview.seen].any()
        assert overview.quality.max() <= 1


def test_exposure_and_vignetting_are_taken_out() -> None:
    s = (np.arccos(np.clip(np.nan_to_num(pixel_rays(CAMERA)[..., 2]), -1, 1)) / CAMERA.half_fov) ** 2

    def record(k: int, light: FloatArray) -> Picture:
        return (light * np.exp2(0.7 * k - 0.5 * s - 0.2 * s**2)[..., None]).astype(np.float32)

    frames = [
        dataclasses.replace(frame, exposure_ev=0.7 * k)
        for k, frame in enumerate(frames_of(smooth_light, CAMERA, ring(2), record))
    ]
    for overview in overviews(Mosaic((CAMERA,), tuple(frames), (), vignetting_ev=((-0.5, -0.2),)), SPHERE):
        np.testing.assert_allclose(overview.light[overview.seen], TRUTH[overview.seen], atol=0.02)


def test_quality_falls_towards_the_rim_and_where_light_is_clipped() -> None:
    frames = frames_of(lambda rays: 1.6 * smooth_light(rays), CAMERA, ring(1), lambda k, light: srgb8(light))
    (overview,) = overviews(Mosaic((CAMERA,), tuple(frames), ()), SPHERE)
    plain = overviews(Mosaic((CAMERA,), tuple(frames_of(smooth_light, CAMERA, ring(1))), ()), SPHERE)[0]
    theta = np.arccos(RAYS[..., 2])
    middle = plain.quality[theta < 0.2].mean()
    assert middle > 1.5 * plain.quality[(theta > 1.2) & plain.seen].mean()
    clipped = (1.6 * TRUTH.max(-1) > 1.1) & overview.seen & (theta < 1.4)
    dim = (1.6 * TRUTH.max(-1) < 0.9) & overview.seen & (theta < 1.4)
    assert (overview.quality / np.maximum(plain.quality, 1e-9))[clipped].max() < 0.3
    np.testing.assert_allclose((overview.quality / np.maximum(plain.quality, 1e-9))[dim], 1, rtol=0.05)


def test_what_a_mask_hides_is_not_seen() -> None:
    hidden = np.zeros(CAMERA.size[::-1], bool)
    hidden[150:350, 200:320] = True

    def masked(k: int, light: FloatArray) -> Picture:
        return np.concatenate([np.where(hidden[..., None], 50.0, light), ~hidden[..., None]], -1).astype(np.float32)

    frames = frames_of(smooth_light, CAMERA, ring(1), masked)
    (overview,) = overviews(Mosaic((CAMERA,), tuple(frames), ()), SPHERE)
    at = np.nan_to_num(CAMERA.project(RAYS), nan=-1).round().astype(int)
    behind = (at >= 0).all(-1) & hidden[np.clip(at[..., 1], 0, 499), np.clip(at[..., 0], 0, 499)]
    assert behind.sum() > 100
    assert (overview.seen & behind).sum() < 0.12 * behind.sum()  # but for its border
    assert overview.light.max() < 2


def test_the_sphere_is_no_finer_than_frames_are_and_smaller_for_many() -> None:
    frame = frames_of(smooth_light, CAMERA, ring(1))[0]

    def width(side: int, count: int = 1) -> int:
        return working_sphere(Mosaic((fisheye(side),), count * (frame,), ())).size[0]

    widths = [width(2000, count) for count in (1, 8, 40, 120, 400)]
    assert widths == sorted(widths, reverse=True)
    assert widths[0] == 1024
    assert widths[-1] == 256
    assert [width(side) for side in (50, 100, 200, 400)] == [256, 256, 512, 1024]
    finest_counts = Mosaic((fisheye(100), fisheye(400)), (frame, dataclasses.replace(frame, camera=1)), ())
    assert working_sphere(finest_counts).size == (1024, 512)


def test_threads_change_nothing() -> None:
    mosaic = Mosaic((CAMERA,), tuple(frames_of(smooth_light, CAMERA, ring(3))), ())
    with thread_pool(3) as pool:
        together = overviews(mosaic, SPHERE, pool)
    for one, other in zip(overviews(mosaic, SPHERE), together, strict=True):
        np.testing.assert_array_equal(one.light, other.light)
        np.testing.assert_array_equal(one.quality, other.quality)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_the_kernel_against_its_twin(dtype: type) -> None:
    rng = np.random.default_rng(3)
    whole = np.iinfo(dtype).max if dtype != np.float32 else 1
    codes: NDArray[Any] = (rng.random((13, 17, 4)) * whole).astype(dtype)
    codes[..., 3] = rng.random((13, 17)) > 0.3
    table = rng.random(whole + 1).astype(np.float32) if dtype != np.float32 else np.empty(0, np.float32)
    light, seen, clipped = np.empty((4, 5, 3), np.float32), np.empty((4, 5), np.float32), np.empty((4, 5), np.float32)
    disc = np.array([7.0, 6.0, 1.3, 36.0])
    reduced_light(codes, table, 0.9 * whole, disc, 3, light, seen, clipped)
    v, u = np.mgrid[:13, :17]
    counts = np.array((u - 7) ** 2 + ((v - 6) / 1.3) ** 2 <= 36)
    counts &= codes[..., 3] > 0
    values = codes[..., :3] if dtype == np.float32 else table[codes[..., :3]]
    for j, i in np.ndindex(4, 5):
        cell = np.s_[3 * j : 3 * j + 3, 3 * i : 3 * i + 3]
        assert seen[j, i] == pytest.approx(counts[cell].mean())
        if counts[cell].any():
            np.testing.assert_allclose(light[j, i], values[cell][counts[cell]].mean(0), rtol=1e-5)
            bright = np.array((codes[cell][..., :3] >= 0.9 * whole).any(-1))[counts[cell]]
            assert clipped[j, i] == pytest.approx(bright.mean())


def test_a_frame_on_the_sphere_is_what_its_slow_twin_shows() -> None:
    rng = np.random.default_rng(4)
    (high, wide), factor, rim, z_min = (30, 40), 3, 1.4, math.cos(1.5)
    small, clipped = rng.random((high, wide, 4)).astype(np.float32), rng.random((high, wide)).astype(np.float32)
    u, v = rng.uniform(-2, 3 * wide + 1, (60, 70)), rng.uniform(-2, 3 * high + 1, (60, 70))
    u[rng.random(u.shape) < 0.2] = np.nan
    z = rng.uniform(-1, 1, u.shape)
    factors, over_z = np.array([1.1, 1.0, 0.9], np.float32), rng.uniform(1, 2, 9).astype(np.float32)
    density = rng.uniform(50, 80, 7)
    light, quality = np.zeros((*u.shape, 3), np.float32), np.zeros(u.shape, np.float32)
    size = np.array([3.0 * wide, 3.0 * high])
    shown_on_sphere(
        u, v, z, small, clipped, factor, size, factors, over_z, z_min, rim, density, 90.0, 0.3, 0.1, light, quality
    )

    at = [np.clip((np.nan_to_num(x) + 0.5) / factor - 0.5, 0, n - 1) for x, n in ((u, wide), (v, high))]
    values = map_coordinates_of(np.dstack([small, clipped]).astype(float), at[1], at[0])
    seen = np.isfinite(u) & (z > math.cos(rim)) & (values[..., 3] > 0.5)
    gain = np.interp(z, np.linspace(z_min, 1, 9), over_z)[..., None] * factors
    theta = np.arccos(z)
    scale = np.interp(theta, np.linspace(0, rim, 7), density)
    border = np.minimum(np.minimum(u, size[0] - 1 - u), np.minimum(v, size[1] - 1 - v)) / scale
    inwards = np.maximum(np.minimum(rim - theta, border), 0)
    worth = scale / 90 * inwards / (inwards + 0.3) * (1 - 0.9 * values[..., 4])
    assert seen.sum() > 500
    np.testing.assert_allclose(light[seen], (values[..., :3] / values[..., 3:4] * gain)[seen], rtol=1e-5)
    np.testing.assert_allclose(quality[seen], np.clip(worth, 1e-3, 1)[seen], rtol=1e-5)
    assert not light[~seen].any()
    assert not quality[~seen].any()


def map_coordinates_of(picture: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """A picture (h, w, c) between its pixels."""
    layers = [ndimage.map_coordinates(picture[..., c], [rows, columns], order=1) for c in range(picture.shape[2])]
    return np.stack(layers, -1)
