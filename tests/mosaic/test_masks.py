"""What masks keep out of a panorama and of the exposures."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, frames_of, orientation, ring, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.compose import compose
from fullsphere.mosaic.masks import used
from fullsphere.mosaic.photometry import estimate_photometry
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from laws import fisheye, smooth_light, smooth_panorama

CAMERA = fisheye(300)
ROTATIONS = np.array([*ring(4), orientation(0, 90), orientation(0, -90)])
SURFACE = Equirectangular((300, 150))


def disc_mask(camera: Camera = CAMERA) -> NDArray[np.uint8]:
    """Black over a thing that stands in the picture, below the middle."""
    v, u = np.ogrid[: camera.size[1], : camera.size[0]]
    return np.where(np.hypot(u - 150, v - 200) < 25, 0, 255).astype(np.uint8)


def covered(frame: Frame, mask: NDArray[np.uint8], level: float) -> Frame:
    """The frame with a grey thing over what the mask leaves out."""
    picture = frame.load().copy()
    picture[mask == 0] = level
    return dataclasses.replace(frame, load=lambda: picture)


def masked(frame: Frame, mask: NDArray[np.uint8]) -> Frame:
    return dataclasses.replace(frame, mask=lambda: mask)


def panorama(frames: list[Frame]) -> NDArray[Any]:
    bands = compose(Mosaic((CAMERA,), tuple(frames), ()), SURFACE, np.float32)
    return np.concatenate([band.rows for band in bands])


def test_a_thing_that_is_masked_in_every_frame_is_not_in_the_panorama() -> None:
    mask = disc_mask()
    soiled = [covered(frame, mask, 0.9) for frame in frames_of(smooth_light, CAMERA, ROTATIONS)]
    with_things, without = panorama(soiled), panorama([masked(frame, mask) for frame in soiled])
    truth = smooth_panorama(300)
    assert np.abs(with_things[..., :3] - truth).max() > 0.02  # little: seams go round it
    np.testing.assert_array_equal(without[..., 3], 1)
    np.testing.assert_allclose(without[..., :3], truth, atol=6e-3)


def test_what_no_frame_may_show_is_not_covered() -> None:
    mask = np.zeros((300, 300), np.uint8)
    mask[:150] = 255
    frame = frames_of(smooth_light, CAMERA, ROTATIONS[:1])[0]
    whole, half = (panorama([f])[..., 3] > 0 for f in (frame, masked(frame, mask)))
    assert not (half & ~whole).any()
    assert half[:70].sum() == whole[:70].sum() and not half[80:].any()


def test_exposures_do_not_see_what_is_masked() -> None:
    """A thing that looks the same in all frames says that all exposures are equal; they are not."""
    exposures = np.array([0.5, -0.5, 0.0, 0.3, -0.3, 0.0])
    mask = np.where(disc_mask() == 0, 0, 255).astype(np.uint8)
    mask[120:, 60:240] = 0
    frames = frames_of(
        lambda rays: 0.3 * smooth_light(rays),
        CAMERA,
        ROTATIONS,
        lambda k, light: (light * 2.0 ** exposures[k]).astype(np.float32),
    )
    soiled = [covered(frame, mask, 0.1 + 0.1 * k) for k, frame in enumerate(frames)]
    seen = estimate_photometry(soiled, CAMERA).exposure_ev
    kept = estimate_photometry([masked(frame, mask) for frame in soiled], (CAMERA,)).exposure_ev
    assert np.abs(seen - exposures).max() > 0.05
    np.testing.assert_allclose(kept, exposures, atol=0.01)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_what_does_not_count_is_transparent(channels: int, kind: type[Any]) -> None:
    picture: Picture = srgb8(np.random.default_rng(0).random((6, 8, channels))).astype(kind)
    mask = np.zeros((6, 8), np.uint8)
    mask[2:, 1:] = 255
    frame = frame_of("f", picture)
    assert used(frame) is picture
    result = used(masked(frame, mask))
    assert result.shape == (6, 8, 4) and result.dtype == kind
    np.testing.assert_array_equal(result[..., :3], np.broadcast_to(picture[..., :3], (6, 8, 3)))
    opaque = 1 if kind is np.float32 else np.iinfo(kind).max
    alpha = picture[..., 3] if channels == 4 else opaque
    np.testing.assert_array_equal(result[..., 3], np.where(mask > 0, alpha, 0))


def test_cameras_of_a_rig_each_show_their_frames() -> None:
    """Two lenses of unlike scale and centre back to back make the same panorama as two alike."""
    other = dataclasses.replace(CAMERA.scaled(1.3), centre=(200.0, 190.0))
    turns = [orientation(0), orientation(180)]
    light = frames_of(smooth_light, CAMERA, np.array(turns[:1]))[0]
    back = dataclasses.replace(frames_of(smooth_light, other, np.array(turns[1:]))[0], id="back", camera=1)
    bands = compose(Mosaic((CAMERA, other), (light, back), ()), SURFACE, np.float32)
    result: NDArray[Any] = np.concatenate([band.rows for band in bands])
    np.testing.assert_array_equal(result[..., 3], 1)
    np.testing.assert_allclose(result[..., :3], smooth_panorama(300), atol=6e-3)
    exposures = estimate_photometry([light, back], (CAMERA, other)).exposure_ev
    np.testing.assert_allclose(exposures, 0, atol=0.01)
