"""Exposure and vignetting from frames of a known smooth scene."""

from collections.abc import Callable

import numpy as np
import pytest
from turning import frames_of, ring, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
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
        lambda k, light: encode(light * passed * 2.0 ** exposure_ev[k]),
    )


def check(found: Photometry, exposure_ev: FloatArray, vignetting_ev: tuple[float, float], atol: float) -> None:
    np.testing.assert_allclose(found.exposure_ev, exposure_ev - exposure_ev.mean(), atol=atol)
    assert found.exposure_ev.mean() == pytest.approx(0, abs=1e-12)
    s = np.linspace(0, 0.9, 20)
    np.testing.assert_allclose(falloff_ev(s, found.vignetting_ev), falloff_ev(s, vignetting_ev), atol=atol)


def sixteen_bits(light: FloatArray) -> Picture:
    return srgb8(light).astype(np.uint16) * np.uint16(257)


def as_light(light: FloatArray) -> Picture:
    return light.astype(np.float32)


@pytest.mark.parametrize(
    ("encode", "vignetting_ev", "atol"),
    [
        (as_light, VIGNETTING_EV, 0.005),
        (as_light, (0.0, 0.0), 0.005),
        (as_light, (0.3, -0.9), 0.005),
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
    check(estimate_photometry(frames, CAMERA), np.zeros(5), (0.0, 0.0), 1e-3)


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
    check(estimate_photometry(frames, CAMERA), np.zeros(5), (0.0, 0.0), 0.03)


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
    assert found.vignetting_ev == (0.0, 0.0)


def test_frames_without_anything_in_range_keep_the_mean() -> None:
    frames = recorded(np.array([0.0, -30.0]), (0.0, 0.0), srgb8)
    found = estimate_photometry(frames, CAMERA)
    np.testing.assert_allclose(found.exposure_ev, 0, atol=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_grey_frames_are_frames_too(dtype: type[np.generic]) -> None:
    def grey(light: FloatArray) -> Picture:
        return srgb8(light)[..., :1] if dtype is np.uint8 else light[..., :1].astype(np.float32)

    check(estimate_photometry(recorded(EXPOSURE_EV, VIGNETTING_EV, grey), CAMERA), EXPOSURE_EV, VIGNETTING_EV, 0.02)
