"""Exposure, white balance and vignetting from frames of a known smooth scene."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from turning import frames_of, ring, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.photometry import Photometry, estimate_photometry
from fullsphere.mosaic.project import Frame, Picture
from laws import fisheye, smooth_light

CAMERA = fisheye(300)
ROTATIONS = ring(5)
EXPOSURE_EV = np.array([0.4, -0.5, 0.1, 0.6, -0.6])
VIGNETTING_EV = (-0.7, -0.5)


def falloff_ev(s: FloatArray, vignetting: tuple[float, float]) -> FloatArray:
    return vignetting[0] * s + vignetting[1] * s**2


def recorded(
    exposure_ev: FloatArray,
    vignetting_ev: tuple[float, float],
    encode: Callable[[FloatArray], Picture],
    scene_gain: float = 0.5,
    camera: Camera = CAMERA,
    tint: FloatArray | None = None,
) -> list[Frame]:
    """Frames as a camera with these exposures and this falloff records the smooth scene."""
    v, u = np.mgrid[: camera.size[1], : camera.size[0]].astype(float)
    rays = np.nan_to_num(camera.unproject(np.stack([u, v], -1)))
    s = (np.arccos(np.clip(rays[..., 2], -1, 1)) / camera.half_fov) ** 2
    passed = np.exp2(falloff_ev(s, vignetting_ev))[..., None]
    return frames_of(
        lambda rays: scene_gain * smooth_light(rays),
        camera,
        ROTATIONS[: len(exposure_ev)],
        lambda k, light: encode(light * passed * 2.0 ** exposure_ev[k] * (1 if tint is None else tint[k])),
    )


def check(found: Photometry, exposure_ev: FloatArray, vignetting_ev: tuple[float, float], atol: float) -> None:
    np.testing.assert_allclose(found.exposure_ev, exposure_ev - exposure_ev.mean(), atol=atol)
    assert found.exposure_ev.mean() == pytest.approx(0, abs=1e-12)
    s = np.linspace(0, 0.9, 20)
    for pair in found.vignetting_ev:
        np.testing.assert_allclose(falloff_ev(s, pair), falloff_ev(s, vignetting_ev), atol=atol)


def sixteen_bits(light: FloatArray) -> Picture:
    return srgb8(light).astype(np.uint16) * np.uint16(257)


def as_light(light: FloatArray) -> Picture:
    return light.astype(np.float32)


@pytest.mark.parametrize(
    ("encode", "vignetting_ev", "atol"),
    [
        (as_light, VIGNETTING_EV, 0.005),
        (as_light, (0.0, 0.0), 0.005),
        (as_light, (-0.05, -1.9), 0.005),
        (srgb8, VIGNETTING_EV, 0.02),
        (sixteen_bits, VIGNETTING_EV, 0.02),
    ],
)
def test_exposures_and_vignetting_come_back(
    encode: Callable[[FloatArray], Picture], vignetting_ev: tuple[float, float], atol: float
) -> None:
    found = estimate_photometry(recorded(EXPOSURE_EV, vignetting_ev, encode), CAMERA)
    check(found, EXPOSURE_EV, vignetting_ev, atol)


def test_equal_frames_without_falloff_need_no_correction() -> None:
    frames = recorded(np.zeros(5), (0.0, 0.0), as_light)
    found = estimate_photometry(frames, CAMERA)
    check(found, np.zeros(5), (0.0, 0.0), 1e-3)
    assert np.array_equal(found.white_balance, np.ones((5, 3)))


def test_clipped_and_black_pixels_do_not_pull() -> None:
    """A scene of which the long exposures clip a third: the same answer as from what is in range."""
    exposure = np.array([1.3, -0.7, 0.0, 1.0, -1.6])
    frames = recorded(exposure, VIGNETTING_EV, srgb8, scene_gain=0.9)
    assert np.mean(frames[0].load()[100:200, 100:200] == 255) > 0.2
    check(estimate_photometry(frames, CAMERA), exposure, VIGNETTING_EV, 0.03)


def test_a_thing_that_moved_does_not_pull() -> None:
    def with_thing(k: int, light: FloatArray) -> Picture:
        light = light.copy()
        if k == 2:
            light[110:190, 170:230] = 0.9
        return light.astype(np.float32)

    frames = frames_of(lambda rays: 0.5 * smooth_light(rays), CAMERA, ROTATIONS, with_thing)
    check(estimate_photometry(frames, CAMERA), np.zeros(5), (0.0, 0.0), 0.01)


def test_what_a_mask_hides_does_not_pull() -> None:
    """Alpha is empty over half of one frame, and far brighter there."""

    def masked(k: int, light: FloatArray) -> Picture:
        hidden = np.zeros(light.shape[:2], bool)
        hidden[:170] = k == 1
        return np.dstack([np.where(hidden[..., None], 4 * light, light), ~hidden]).astype(np.float32)

    frames = frames_of(lambda rays: 0.5 * smooth_light(rays), CAMERA, ROTATIONS, masked)
    check(estimate_photometry(frames, CAMERA), np.zeros(5), (0.0, 0.0), 0.005)


def test_a_single_frame_is_the_reference() -> None:
    found = estimate_photometry(recorded(np.array([0.7]), VIGNETTING_EV, srgb8), CAMERA)
    assert found.exposure_ev.tolist() == [0]
    assert np.array_equal(found.white_balance, np.ones((1, 3)))
    assert found.vignetting_ev == ((0.0, 0.0),)


def test_frames_without_anything_in_range_keep_the_mean() -> None:
    frames = recorded(np.array([0.0, -30.0]), (0.0, 0.0), srgb8)
    found = estimate_photometry(frames, CAMERA)
    np.testing.assert_allclose(found.exposure_ev, 0, atol=1e-9)
    assert np.array_equal(found.white_balance, np.ones((2, 3)))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_grey_frames_are_frames_too(dtype: type[np.generic]) -> None:
    def grey(light: FloatArray) -> Picture:
        return srgb8(light)[..., :1] if dtype is np.uint8 else light[..., :1].astype(np.float32)

    check(estimate_photometry(recorded(EXPOSURE_EV, VIGNETTING_EV, grey), CAMERA), EXPOSURE_EV, VIGNETTING_EV, 0.02)


TINT = np.array([[1.2, 1, 0.85], [0.9, 1, 1.15], [1.0, 1, 1.0], [1.1, 1, 0.9], [0.8, 1, 1.2]])


@pytest.mark.parametrize(("encode", "rtol"), [(as_light, 0.001), (srgb8, 0.005)])
def test_white_balances_come_back(encode: Callable[[FloatArray], Picture], rtol: float) -> None:
    found = estimate_photometry(recorded(EXPOSURE_EV, VIGNETTING_EV, encode, tint=TINT), CAMERA)
    check(found, EXPOSURE_EV, VIGNETTING_EV, 0.01)
    np.testing.assert_allclose(found.white_balance, TINT / np.exp(np.log(TINT).mean(0)), rtol=rtol)
    assert np.array_equal(found.white_balance[:, 1], np.ones(5))


def test_a_tint_of_noise_is_none() -> None:
    noise = 1 + 0.003 * np.random.default_rng(0).uniform(-1, 1, (5, 3))
    found = estimate_photometry(recorded(EXPOSURE_EV, VIGNETTING_EV, as_light, tint=noise), CAMERA)
    assert np.array_equal(found.white_balance, np.ones((5, 3)))


def test_a_frame_under_a_filter_is_not_tinted_without_end() -> None:
    tint = np.ones((5, 3))
    tint[2] = 8, 1, 0.1
    found = estimate_photometry(recorded(np.zeros(5), (0.0, 0.0), as_light, tint=tint), CAMERA).white_balance
    assert np.log2(found).min() == pytest.approx(-1) and np.log2(found).max() == pytest.approx(1)


def told(frames: list[Frame], exposure_ev: FloatArray, by: float = 7.0) -> list[Frame]:
    return [dataclasses.replace(f, told_ev=float(ev) + by) for f, ev in zip(frames, exposure_ev, strict=True)]


def test_what_the_camera_noted_counts_only_where_nothing_overlaps() -> None:
    """Two frames of the ring overlap; the third looks away from both, or is told apart from the truth."""
    wrong = EXPOSURE_EV + np.array([0.2, -0.2, 0.0, 0.3, -0.1])
    frames = told(recorded(EXPOSURE_EV, VIGNETTING_EV, as_light), wrong)
    check(estimate_photometry(frames, CAMERA), EXPOSURE_EV, VIGNETTING_EV, 0.005)
    narrow = dataclasses.replace(CAMERA, half_fov=0.5)
    apart = told(recorded(EXPOSURE_EV, (0.0, 0.0), as_light, camera=narrow), wrong)
    found = estimate_photometry(apart, narrow)
    np.testing.assert_allclose(found.exposure_ev, wrong - wrong.mean(), atol=0.002)
    assert found.vignetting_ev == ((0.0, 0.0),)
    without = [*apart[:-1], dataclasses.replace(apart[-1], told_ev=None)]
    np.testing.assert_allclose(estimate_photometry(without, narrow).exposure_ev, 0, atol=1e-9)


def test_a_frame_that_is_all_clipped_has_the_exposure_that_was_noted() -> None:
    exposure = np.array([0.0, 0.1, 0.2, -0.3, 20.0])
    found = estimate_photometry(told(recorded(exposure, (0.0, 0.0), srgb8), exposure), CAMERA).exposure_ev
    np.testing.assert_allclose(found - found[0], exposure, atol=0.02)


def test_each_camera_has_its_own_vignetting() -> None:
    frames = recorded(EXPOSURE_EV, VIGNETTING_EV, as_light)
    clear = recorded(EXPOSURE_EV, (0.0, 0.0), as_light)
    mixed = [dataclasses.replace(f, camera=1) if k % 2 else clear[k] for k, f in enumerate(frames)]
    found = estimate_photometry(mixed, (CAMERA, CAMERA))
    s = np.linspace(0, 0.9, 20)
    for pair, true in zip(found.vignetting_ev, ((0.0, 0.0), VIGNETTING_EV), strict=True):
        np.testing.assert_allclose(falloff_ev(s, pair), falloff_ev(s, true), atol=0.005)


def test_vignetting_never_brightens_outwards() -> None:
    """A lens that gets brighter towards its rim is none: the falloff that is nearest to it is no falloff."""
    found = estimate_photometry(recorded(np.zeros(5), (0.5, 0.3), as_light), CAMERA)
    assert found.vignetting_ev == ((0.0, 0.0),)


def test_pixels_that_are_no_numbers_do_not_count() -> None:
    def spoilt(k: int, light: FloatArray) -> Picture:
        picture: Picture = (2.0 ** EXPOSURE_EV[k] * light * 1e-4).astype(np.float32)
        picture[100:120, 100:200] = (np.nan, np.inf, -np.inf, -1.0, 0.0)[k]
        return picture

    frames = frames_of(lambda rays: 0.5 * smooth_light(rays), CAMERA, ROTATIONS, spoilt)
    check(estimate_photometry(frames, CAMERA), EXPOSURE_EV, (0.0, 0.0), 0.01)


def test_photometry_is_the_same_for_any_number_of_threads() -> None:
    frames = recorded(EXPOSURE_EV, VIGNETTING_EV, srgb8)
    with thread_pool(2) as executor:
        both = estimate_photometry(frames, CAMERA), estimate_photometry(frames, CAMERA, executor)
    assert np.array_equal(both[0].exposure_ev, both[1].exposure_ev)
    assert both[0].vignetting_ev == both[1].vignetting_ev


def test_a_red_flare_over_a_part_of_a_frame_does_not_tint_it() -> None:
    def flared(k: int, light: FloatArray) -> Picture:
        light = light.repeat(3, -1)[..., :3].copy()
        if k == 1:
            light[:, :110] += np.array([0.3, 0.05, 0.02])
        return light.astype(np.float32)

    frames = frames_of(lambda rays: 0.5 * smooth_light(rays), CAMERA, ROTATIONS, flared)
    found = estimate_photometry(frames, CAMERA)
    assert np.abs(found.white_balance - 1).max() < 0.01
    np.testing.assert_allclose(found.exposure_ev, 0, atol=0.01)
