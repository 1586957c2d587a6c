"""How bright a panorama is to be."""

import dataclasses

import numpy as np
import pytest
from turning import frames_of, ring, srgb8

from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.frame_light import gain_of
from fullsphere.mosaic.overview import overviews
from fullsphere.mosaic.project import Mosaic, Picture
from fullsphere.mosaic.reference import Exposure, compensated, parse_exposure, reference_ev
from laws import fisheye, smooth_light

CAMERA = fisheye(200)
SPHERE = Equirectangular((256, 128))
EXPOSURE_EV = (0.0, -2.0, 0.0, 0.0)


def with_lamp(rays: FloatArray) -> FloatArray:
    """A smooth scene, and a lamp of 3 within 15 degrees of the world's z axis, 1.7 % of the sphere."""
    light: FloatArray = np.where(rays[..., 2:] > np.cos(np.deg2rad(15)), 3.0, 0.4 * smooth_light(rays))
    return light


def mosaic_of(exposure_ev: tuple[float, ...] = EXPOSURE_EV, light: bool = False) -> Mosaic:
    def recorded(k: int, seen: FloatArray) -> Picture:
        return (seen * 2.0 ** exposure_ev[k]).astype(np.float32) if light else srgb8(seen * 2.0 ** exposure_ev[k])

    frames = frames_of(with_lamp, CAMERA, ring(4), recorded)
    told = [dataclasses.replace(frame, exposure_ev=exposure_ev[k]) for k, frame in enumerate(frames)]
    return Mosaic((CAMERA,), tuple(told), (), vignetting_ev=((0.0, 0.0),))


def found_ev(mosaic: Mosaic, exposure: Exposure) -> float:
    ready = compensated(mosaic, exposure)
    return reference_ev(ready, exposure, overviews(ready, SPHERE))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("auto", Exposure()),
        ("none", Exposure("none")),
        ("frame 3", Exposure("frame", "3")),
        ("frame:a b.jpg", Exposure("frame", "a b.jpg")),
        ("frame=2", Exposure("frame", "2")),
    ],
)
def test_exposures_are_told_in_words(text: str, expected: Exposure) -> None:
    assert parse_exposure(text) == expected


@pytest.mark.parametrize("text", ["", "Auto", "frame", "frame ", "3", "framed 3", "none 1"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is none of auto, none"):
        parse_exposure(text)


def test_highlights_that_a_frame_recorded_are_kept() -> None:
    """The lamp is clipped in the frames at the mean exposure, and 0.75 in the one two stops darker."""
    seen = overviews(mosaic_of(), SPHERE)
    assert found_ev(mosaic_of(), Exposure()) == pytest.approx(-np.log2(3), abs=0.03)
    assert reference_ev(mosaic_of(), Exposure("frame", "1"), seen) == 0
    assert reference_ev(mosaic_of(), Exposure("none"), seen) == 0


def test_highlights_that_no_frame_recorded_are_lost_anyway() -> None:
    assert found_ev(mosaic_of((0.0,) * 4), Exposure()) == 0
    assert reference_ev(Mosaic((CAMERA,), (), ()), Exposure(), []) == 0


def test_a_scene_below_white_is_left_as_it_is() -> None:
    assert found_ev(mosaic_of((-2.0,) * 4), Exposure()) < -1
    dim = dataclasses.replace(
        mosaic_of((-2.0,) * 4),
        frames=tuple(dataclasses.replace(f, exposure_ev=0.0) for f in mosaic_of((-2.0,) * 4).frames),
    )
    assert found_ev(dim, Exposure()) == 0


def test_light_is_never_clipped_and_never_made_darker_without_end() -> None:
    bright = mosaic_of((0.0, -2.0, 1.0, 0.0), light=True)
    assert found_ev(bright, Exposure()) == pytest.approx(-np.log2(3), abs=0.03)
    far = dataclasses.replace(
        bright, frames=tuple(dataclasses.replace(f, exposure_ev=f.exposure_ev - 5) for f in bright.frames)
    )
    assert found_ev(far, Exposure()) == -2.0


def tinted() -> Mosaic:
    mosaic = mosaic_of()
    frames = [dataclasses.replace(f, white_balance=(1.2, 1.0, 0.5 + 0.125 * k)) for k, f in enumerate(mosaic.frames)]
    frames[3] = frames[3].left_out("shows nothing")
    return dataclasses.replace(mosaic, frames=tuple(frames), vignetting_ev=((-0.5, -0.25),))


@pytest.mark.parametrize("by", ["2", tinted().frames[1].id])
def test_one_frame_keeps_its_brightness_and_colours(by: str) -> None:
    mosaic = compensated(tinted(), Exposure("frame", by))
    kept, other = mosaic.frames[1], mosaic.frames[0]
    assert (kept.exposure_ev, kept.white_balance) == (0.0, (1.0, 1.0, 1.0))
    assert (other.exposure_ev, other.white_balance) == (2.0, (1.0, 1.0, 0.5 / 0.625))
    assert mosaic.vignetting_ev == tinted().vignetting_ev


def test_without_compensation_light_is_what_frames_recorded() -> None:
    mosaic = compensated(tinted(), Exposure("none"))
    for frame in mosaic.frames:
        gain = gain_of(mosaic, frame)
        assert np.array_equal(gain.factors, np.ones(3))
        assert np.array_equal(gain.over_z, np.ones(len(gain.over_z)))


@pytest.mark.parametrize(
    ("name", "message"),
    [("9", "there is no such frame; the mosaic has 4"), ("0", "no such frame"), ("4", "is left out, it shows nothing")],
)
def test_a_frame_that_has_no_place_cannot_be_the_reference(name: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        compensated(tinted(), Exposure("frame", name))
