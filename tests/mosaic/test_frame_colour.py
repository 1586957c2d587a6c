"""Frames in colour spaces of their own: what they are composed in, and what is said of them."""

import dataclasses
import functools
from pathlib import Path

import cv2
import numpy as np
import pytest
from icc_profiles import ADOBE, P3, SRGB, SRGB_CURVE, assembled, gamma, parametric, profile
from turning import frames_of, ring

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.icc import SRGB as PLAIN
from fullsphere.model.icc import profile_of
from fullsphere.model.images import open_panorama, picture_profile
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.frame_colour import colour_notes, common_profile, in_profile
from fullsphere.mosaic.frames import open_frames
from fullsphere.mosaic.overview import overviews
from fullsphere.mosaic.photometry import estimate_photometry
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from fullsphere.mosaic.store import load_mosaic, save_mosaic
from laws import fisheye, smooth_light

ADOBE_ICC, P3_ICC = profile(ADOBE, gamma(2.19921875)), profile(P3, parametric(3, SRGB_CURVE))
SRGB_ICC, TABLES_ICC = profile(SRGB, parametric(3, SRGB_CURVE)), assembled({b"A2B0": bytes(64)})
GREY_ICC = profile((), gamma(2.2), space=b"GRAY")


def frame(icc: bytes | None, name: str = "a") -> Frame:
    own = functools.partial(profile_of, icc)
    return Frame(name, name, (4, 4), lambda: np.empty(0), profile=None if icc is None else own)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([None, None], None),
        ([ADOBE_ICC, ADOBE_ICC], ADOBE_ICC),
        ([SRGB_ICC, SRGB_ICC], SRGB_ICC),
        ([TABLES_ICC, TABLES_ICC], TABLES_ICC),
        ([ADOBE_ICC, P3_ICC], None),
        ([SRGB_ICC, None], None),
        ([GREY_ICC, GREY_ICC], None),
        ([], None),
    ],
)
def test_frames_are_composed_in_their_own_colour_space_if_they_have_one(
    given: list[bytes | None], expected: bytes | None
) -> None:
    assert common_profile([frame(icc) for icc in given]).icc == profile_of(expected).icc


@pytest.mark.parametrize(("dtype", "near"), [(np.uint8, 0.02), (np.uint16, 2e-4)])
@pytest.mark.parametrize("icc", [ADOBE_ICC, P3_ICC])
def test_colours_of_another_space_are_brought_into_srgb(icc: bytes, dtype: type, near: float) -> None:
    own, top = profile_of(icc), np.iinfo(dtype).max
    inside = np.random.default_rng(0).uniform(0.1, 0.6, (300, 20, 3)).astype(np.float32)
    light = inside @ np.linalg.inv(own.srgb_from_own).T.astype(np.float32)
    alpha: Picture = np.where(np.arange(300)[:, None] < 5, top, np.zeros((1, 20), int)).astype(dtype)
    found = in_profile(np.dstack([encoded_from_linear(light, dtype, own), alpha]), own, PLAIN)
    assert found.dtype == np.uint16
    np.testing.assert_allclose(found[..., :3] / 65535, encoded_from_linear(inside, np.uint16) / 65535, atol=near)
    assert (found[:5, :, 3] == 65535).all()
    assert (found[5:, :, 3] == 0).all()


def test_codes_that_mean_the_same_and_light_stay_as_they_are() -> None:
    codes = np.random.default_rng(1).integers(0, 255, (4, 4, 3), dtype=np.uint8)
    assert in_profile(codes, profile_of(SRGB_ICC), PLAIN) is codes
    assert in_profile(codes, profile_of(TABLES_ICC), PLAIN) is codes
    assert in_profile(codes, profile_of(ADOBE_ICC), profile_of(ADOBE_ICC)) is codes
    light = codes.astype(np.float32)
    assert in_profile(light, profile_of(ADOBE_ICC), PLAIN) is light
    clipped = np.full((2, 2, 3), 255, np.uint8)
    assert (in_profile(clipped, profile_of(ADOBE_ICC), PLAIN) == 65535).all()


def test_what_a_person_should_know_is_said() -> None:
    assert colour_notes([frame(None), frame(SRGB_ICC)]) == ()
    assert colour_notes([frame(ADOBE_ICC), frame(ADOBE_ICC)]) == ()
    (mixed,) = colour_notes([frame(None), frame(ADOBE_ICC)])
    assert "several colour profiles" in mixed
    (tables,) = colour_notes([frame(TABLES_ICC, name) for name in "abcde"])
    assert tables.startswith("a, b, c and 2 more: the colour profile is made of tables")


CAMERA = fisheye(200)


def coloured(rays: FloatArray) -> FloatArray:
    light: FloatArray = 0.5 * smooth_light(rays) * np.array([1.0, 0.8, 0.6])
    return light


def mosaic_in(icc: list[bytes], camera: Camera = CAMERA) -> Mosaic:
    """Frames of one scene, whose light is given in the primaries of sRGB, each in a space of its own."""

    def recorded(k: int, light: FloatArray) -> Picture:
        own = profile_of(icc[k])
        return encoded_from_linear((light @ np.linalg.inv(own.srgb_from_own).T).astype(np.float32), np.uint8, own)

    frames = frames_of(coloured, camera, ring(len(icc)), recorded)
    own = [dataclasses.replace(f, profile=functools.partial(profile_of, i)) for f, i in zip(frames, icc, strict=True)]
    return Mosaic((camera,), tuple(own), ())


@pytest.mark.parametrize("icc", [[ADOBE_ICC] * 4, [ADOBE_ICC, P3_ICC, b"", SRGB_ICC]])
def test_frames_show_the_same_light_whatever_they_are_written_in(icc: list[bytes]) -> None:
    mosaic = mosaic_in(icc)
    sphere = Equirectangular((256, 128))
    truth = coloured(sphere.window_rays(slice(0, 256), slice(0, 128)))
    to_srgb = common_profile(mosaic.frames).srgb_from_own
    for seen in overviews(mosaic, sphere):
        np.testing.assert_allclose((seen.light @ to_srgb.T)[seen.seen], truth[seen.seen], atol=0.01)
    found = estimate_photometry(mosaic.frames, CAMERA)
    assert np.abs(found.exposure_ev).max() < 0.005
    assert np.array_equal(found.white_balance, np.ones((4, 3)))


def test_profiles_are_read_from_the_files_of_frames(tmp_path: Path) -> None:
    for name, icc in (("a", ADOBE_ICC), ("b", None)):
        with open_panorama(tmp_path / f"{name}.png", (40, 20), 3, np.uint8, {}, False, icc) as writer:
            writer.write_rows(0, np.full((20, 40, 3), ord(name), np.uint8))
    cv2.imwrite(str(tmp_path / "c.png"), np.zeros((20, 40, 3), np.uint8))
    paths = [tmp_path / f"{name}.png" for name in "abc"]
    frames = open_frames(paths)
    assert frames[0].profile is not None
    assert frames[0].profile() is profile_of(ADOBE_ICC)
    assert frames[1].profile is frames[2].profile is None
    assert [picture_profile(path).icc for path in paths] == [ADOBE_ICC, b"", b""]
    save_mosaic(tmp_path / "mosaic.json", Mosaic((CAMERA,), tuple(f.left_out("for a test") for f in frames), ()))
    read = load_mosaic(tmp_path / "mosaic.json").frames
    assert [f.profile().icc for f in read if f.profile] == [ADOBE_ICC, b"", b""]
