"""Cut a known panorama into frames, compose them, and demand the panorama back."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, frames_of, orientation, ring, srgb8

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.compose import compose, plan
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from fullsphere.mosaic.shares import Shares
from laws import fisheye, pixel_rays, smooth_light, smooth_panorama

CAMERA = fisheye(500)
ROTATIONS = np.array([*ring(4), orientation(0, 90), orientation(0, -90)])
SURFACE = Equirectangular((800, 400))
TRUTH = smooth_panorama(800)
PLANS: list[tuple[Mosaic, Shares]] = []
NARROW = Camera(Perspective(400.0), (500, 400), (249.5, 199.5), half_fov=math.radians(45))


def plan_of(mosaic: Mosaic) -> Shares:
    """What is planned for a mosaic, once for all the tests that ask."""
    for known, shares in PLANS:
        if known is mosaic:
            return shares
    PLANS.append((mosaic, plan(mosaic)))
    return PLANS[-1][1]


def whole(
    mosaic: Mosaic, surface: Projection = SURFACE, dtype: Any = np.float32, threads: int = 0, tile_px: int = 512
) -> NDArray[Any]:
    if threads == 0:
        bands = compose(mosaic, surface, dtype, shares=plan_of(mosaic), tile_px=tile_px)
        return np.concatenate([band.rows for band in bands])
    with thread_pool(threads) as pool:
        return np.concatenate([band.rows for band in compose(mosaic, surface, dtype, pool, tile_px=tile_px)])


def mosaic_of(frames: list[Frame], camera: Camera = CAMERA) -> Mosaic:
    return Mosaic((camera,), tuple(frames), ())


@pytest.fixture(scope="module")
def smooth() -> Mosaic:
    return mosaic_of(frames_of(smooth_light, CAMERA, ROTATIONS))


def test_cut_up_and_reassembled_it_is_the_original(smooth: Mosaic) -> None:
    """The frames are cut out of a fine panorama by `remap`."""
    fine, source = smooth_panorama(1600), Equirectangular((1600, 800))
    frames = [
        frame_of(str(k), remap(fine, source, CAMERA, rotation)[0], rotation) for k, rotation in enumerate(ROTATIONS)
    ]
    result = whole(mosaic_of(frames))
    assert result.shape == (400, 800, 4)
    np.testing.assert_array_equal(result[..., 3], 1)
    np.testing.assert_allclose(result[..., :3], TRUTH, atol=2e-3)
    np.testing.assert_allclose(result, whole(smooth), atol=2e-3)


def test_codes_come_back_to_one_code() -> None:
    frames = frames_of(smooth_light, CAMERA, ROTATIONS, lambda k, light: srgb8(light))
    result = whole(mosaic_of(frames), dtype=np.uint8)
    assert result.dtype == np.uint8
    assert set(np.unique(result[..., 3])) == {255}
    assert np.abs(result[..., :3].astype(int) - srgb8(TRUTH)).max() <= 1


def test_sixteen_bits_and_eight_bits_are_the_same_picture(smooth: Mosaic) -> None:
    eight, sixteen = whole(smooth, dtype=np.uint8), whole(smooth, dtype=np.uint16)
    assert sixteen.dtype == np.uint16
    assert np.abs(sixteen / 257.0 - eight).max() <= 0.51


@pytest.mark.parametrize("width", [1100, 512, 100, 30])
def test_bands_partition_the_picture_from_top_to_bottom(smooth: Mosaic, width: int) -> None:
    top = 0
    for band in compose(smooth, Equirectangular((width, width // 2)), shares=plan_of(smooth)):
        assert band.top == top
        assert band.rows.shape[1:] == (width, 4)
        assert len(band.rows) > 0
        top += len(band.rows)
    assert top == width // 2


def test_bytes_do_not_depend_on_threads(smooth: Mosaic) -> None:
    surface = Equirectangular((1100, 550))  # six tiles
    alone = whole(smooth, surface, np.uint8)
    for threads in (1, 2, 5):
        np.testing.assert_array_equal(whole(smooth, surface, np.uint8, threads), alone)


@pytest.mark.parametrize("tile_px", [100, 512, 2048])
def test_bytes_do_not_depend_on_tiles(smooth: Mosaic, tile_px: int) -> None:
    surface = Equirectangular((1100, 550))
    np.testing.assert_array_equal(whole(smooth, surface, tile_px=tile_px), whole(smooth, surface, tile_px=64))


def test_any_surface_shows_the_same_sphere(smooth: Mosaic) -> None:
    for surface in (CubeMap(150), fisheye(300)):
        result = whole(smooth, surface)
        rays = pixel_rays(surface)
        looks = np.isfinite(rays[..., 0])
        np.testing.assert_array_equal(result[..., 3], looks)
        np.testing.assert_allclose(result[looks][:, :3], smooth_light(rays[looks]), atol=4e-3)


def test_the_same_on_every_sphere_size(smooth: Mosaic) -> None:
    """A pixel of a coarse panorama is the mean of those of a fine one that it covers."""
    coarse, fine = whole(smooth, Equirectangular((200, 100))), whole(smooth)
    np.testing.assert_allclose(coarse[..., :3], fine[..., :3].reshape(100, 4, 200, 4, 3).mean((1, 3)), atol=4e-3)


@pytest.mark.parametrize("width", [800, 300, 120])
def test_a_constant_scene_stays_constant_to_its_rim(width: int) -> None:
    """One frame alone, so that nothing hides its rim; black beyond it."""
    frames = frames_of(lambda rays: np.full((len(rays), 3), 0.5), CAMERA, ROTATIONS[:1])
    result = whole(mosaic_of(frames), Equirectangular((width, width // 2)))
    covered = result[..., 3] > 0
    assert covered.mean() == pytest.approx((1 - math.cos(CAMERA.half_fov)) / 2, abs=0.15)
    np.testing.assert_allclose(result[covered][:, :3], 0.5, atol=1e-3)
    np.testing.assert_array_equal(result[~covered], 0)


def test_alpha_is_what_some_frame_saw() -> None:
    surface = Equirectangular((600, 300))
    result = whole(mosaic_of(frames_of(smooth_light, NARROW, ROTATIONS[:2]), NARROW), surface)
    rays = pixel_rays(surface)
    seen, surely = np.zeros((300, 600), bool), np.zeros((300, 600), bool)
    for rotation in ROTATIONS[:2]:
        u, v = np.moveaxis(NARROW.project(rays @ rotation.T), -1, 0)
        with np.errstate(invalid="ignore"):
            seen |= (np.abs(u - 249.5) <= 250) & (np.abs(v - 199.5) <= 200)
            surely |= (u > 2) & (u < 497) & (v > 2) & (v < 397)
    surely &= ~_near_rim(rays)
    assert surely.mean() > 0.1
    assert np.all(result[..., 3][surely] == 1)
    assert np.all(result[..., 3][~seen] == 0)
    np.testing.assert_allclose(result[surely][:, :3], smooth_light(rays)[surely], atol=2e-3)


def _near_rim(rays: FloatArray) -> NDArray[np.bool_]:
    limit = math.cos(NARROW.half_fov - math.radians(1))
    return np.asarray(np.max([rays @ r[2] for r in ROTATIONS[:2]], axis=0) < limit)


def test_exposure_and_vignetting_are_taken_out() -> None:
    exposures, (w1, w2) = [0.5, -0.5, 0.25, 0.0, -1.0, 1.0], (-0.6, -0.3)
    s = (np.arccos(np.clip(np.nan_to_num(pixel_rays(CAMERA)[..., 2]), -1, 1)) / CAMERA.half_fov) ** 2

    def record(k: int, light: FloatArray) -> Picture:
        return (light * np.exp2(exposures[k] + w1 * s + w2 * s**2)[..., None]).astype(np.float32)

    frames = [
        dataclasses.replace(frame, exposure_ev=ev)
        for frame, ev in zip(frames_of(smooth_light, CAMERA, ROTATIONS, record), exposures, strict=True)
    ]
    result = whole(dataclasses.replace(mosaic_of(frames), vignetting_ev=((w1, w2),)))
    np.testing.assert_allclose(result[..., :3], TRUTH, atol=3e-3)


def test_frames_left_out_are_not_in_the_picture(smooth: Mosaic) -> None:
    def never() -> Picture:
        raise AssertionError("a frame that is left out was opened")

    stranger = Frame("stranger", "stranger", CAMERA.size, never).left_out("shows another place")
    np.testing.assert_array_equal(whole(mosaic_of([stranger, *smooth.frames])), whole(smooth))


def test_nothing_of_what_a_mask_hides_comes_in() -> None:
    """Where alpha is empty a frame may hold anything: others fill in, and no fringe shows round it."""
    hidden = np.zeros(CAMERA.size[::-1], bool)
    hidden[150:350, 200:320] = True

    def masked(k: int, light: FloatArray) -> Picture:
        alpha = np.where(hidden, 0.0, 1.0)[..., None]
        return np.concatenate([np.where(hidden[..., None], 50.0, light), alpha], -1).astype(np.float32)

    mosaic = mosaic_of(frames_of(smooth_light, CAMERA, ROTATIONS, masked))
    for width in (800, 300):
        result = whole(mosaic, Equirectangular((width, width // 2)))
        covered = result[..., 3] > 0
        assert covered.mean() > 0.95
        truth = smooth_panorama(width)
        np.testing.assert_allclose(result[covered][:, :3], truth[covered], atol=4e-3)


def test_grey_frames_give_a_grey_panorama() -> None:
    frames = frames_of(lambda rays: smooth_light(rays, 1), CAMERA, ROTATIONS)
    result = whole(mosaic_of(frames))
    np.testing.assert_array_equal(result[..., 0], result[..., 1])
    np.testing.assert_allclose(result[..., 0], TRUTH[..., 0], atol=2e-3)


def test_clipped_light_gives_way_to_light_in_range() -> None:
    """A light recorded as 1.0 by a long exposure and in range by a short one is as bright as the short one says."""
    twice = ROTATIONS[[0, 0]]
    frames = frames_of(lambda rays: 2 * smooth_light(rays), CAMERA, twice, lambda k, light: srgb8(light / (1 + 3 * k)))
    frames = [dataclasses.replace(frame, exposure_ev=-2.0 * k) for k, frame in enumerate(frames)]
    result = whole(mosaic_of(frames))
    clipped = (result[..., 3] > 0) & (2 * TRUTH.max(-1) > 1.1)
    assert clipped.mean() > 0.05
    truth = 2 * TRUTH[clipped]
    assert np.all(np.abs(result[clipped][:, :3] - truth) < 0.15 * np.maximum(truth - 1, 0) + 0.02)


def test_one_frame_alone_is_itself() -> None:
    """To the last bit what `remap` makes of it, where nothing is averaged."""
    (frame,) = frames_of(smooth_light, CAMERA, ROTATIONS[:1])
    fine = Equirectangular((1600, 800))
    result = whole(mosaic_of([frame]), fine)
    expected, weight = remap(frame.load(), CAMERA, fine, ROTATIONS[0].T, "lanczos3")
    covered = result[..., 3] > 0
    assert (covered & (weight == 0)).sum() == 0
    np.testing.assert_allclose(result[covered][:, :3], np.maximum(expected[covered], 0), rtol=1e-6, atol=1e-7)


def brightened(k: int, light: FloatArray) -> Picture:
    """As recorded with exposures that nothing tells of, a fifth apart in the end."""
    return (light * (1 + 0.04 * k)).astype(np.float32)


def test_what_is_left_of_exposures_makes_no_step() -> None:
    """Grey frames of up to a fifth more light than each other: no edge of more than a hundredth between pixels."""
    frames = frames_of(lambda rays: np.full((len(rays), 3), 0.3), CAMERA, ROTATIONS, brightened)
    result = whole(mosaic_of(frames))
    light = result[..., 0] / 0.3
    assert light.min() > 0.99
    assert light.max() < 1.21
    assert np.ptp(light) > 0.05
    across = np.abs(np.diff(light, axis=1, append=light[:, :1]))[40:-40]
    down = np.abs(np.diff(light, axis=0))
    assert max(across.max(), down.max()) < 0.01


@pytest.mark.parametrize("pitch", [90, -90, 0])
def test_neither_pole_nor_the_360_degree_edge_shows(pitch: float) -> None:
    """Seen by an ordinary camera, brightness is as smooth there as anywhere."""
    frames = frames_of(lambda rays: np.full((len(rays), 3), 0.3), CAMERA, ROTATIONS, brightened)
    view = Camera(Perspective(150.0), (200, 200), (99.5, 99.5), half_fov=math.radians(60))
    turn = orientation(180 if pitch == 0 else 0, pitch)
    panorama = whole(mosaic_of(frames), Equirectangular((1600, 800)))
    seen, _ = remap(np.ascontiguousarray(panorama[..., :3]), Equirectangular((1600, 800)), view, turn)
    light = seen[..., 0] / 0.3
    assert max(np.abs(np.diff(light, axis=axis)).max() for axis in (0, 1)) < 0.01


def test_without_a_plan_one_is_made(smooth: Mosaic) -> None:
    bands = compose(smooth, SURFACE, np.float32)
    np.testing.assert_array_equal(np.concatenate([band.rows for band in bands]), whole(smooth))


def test_brighter_by_as_much_as_is_asked_for(smooth: Mosaic) -> None:
    result = np.concatenate(
        [band.rows for band in compose(smooth, SURFACE, np.float32, shares=plan_of(smooth), exposure_ev=-1.0)]
    )
    np.testing.assert_allclose(2 * result[..., :3], whole(smooth)[..., :3], rtol=1e-6)


def test_feathered_frames_are_the_scene_too(smooth: Mosaic) -> None:
    bands = compose(smooth, SURFACE, np.float32, shares=plan(smooth, blend="feather"))
    result = np.concatenate([band.rows for band in bands])
    np.testing.assert_array_equal(result[..., 3], 1)
    np.testing.assert_allclose(result[..., :3], TRUTH, atol=2e-3)


def test_feathered_frames_are_mixed_where_both_see() -> None:
    """Two frames of one direction, one half as bright: what comes out is in the middle."""
    twice = frames_of(
        smooth_light, CAMERA, ROTATIONS[[0, 0]], lambda k, light: (light * (1 - 0.5 * k)).astype(np.float32)
    )
    mosaic = mosaic_of(twice)
    bands = compose(mosaic, SURFACE, np.float32, shares=plan(mosaic, blend="feather"))
    result = np.concatenate([band.rows for band in bands])
    seen = result[..., 3] > 0
    off = np.abs(result[seen][:, :3] - 0.75 * TRUTH[seen]).max(-1) > 3e-3
    assert off.mean() < 1e-4  # but for pixels of the very rim, which one of them fills


def test_a_clipped_lamp_is_white_in_the_panorama() -> None:
    """All that an overexposed frame tells of a lamp is that it is brighter than its own white."""
    codes = np.full((500, 500, 3), 120, np.uint8)
    codes[230:270, 230:270] = 255
    frame = dataclasses.replace(frame_of("bright", codes, ROTATIONS[0]), exposure_ev=0.7)
    result = whole(mosaic_of([frame]), dtype=np.uint8)
    assert result[200, 400].tolist() == [255, 255, 255, 255]
    assert (result[150, 400, :3] < 120).all()
