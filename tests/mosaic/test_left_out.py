"""Frames that cannot be placed are told apart by what is wrong with them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, orientation

from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.copies import copies
from fullsphere.mosaic.features import find_features
from fullsphere.mosaic.left_out import why_left_out
from fullsphere.mosaic.links import Evidence, gather_evidence
from fullsphere.mosaic.matching import match_features
from fullsphere.mosaic.mirrored import flipped
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.unusable import what_is_wrong
from fullsphere.mosaic.worlds import PanelScene, furnished_room, photograph
from laws import fisheye

CAMERA = fisheye(480)


@pytest.fixture(scope="module")
def room() -> PanelScene:
    return furnished_room(texel_mm=9.0)


def shot(
    room: PanelScene, yaw_deg: float, place: Sequence[float] = (0, 0, 0), seed: int = 0, ev: float = 0.0
) -> Picture:
    turned, scene = orientation(yaw_deg), room.seen_from(place)
    return photograph(scene, CAMERA, turned, exposure_ev=ev, noise=0.003, seed=seed, supersampling=1)


@pytest.fixture(scope="module")
def good(room: PanelScene) -> list[Picture]:
    return [shot(room, yaw, seed=k) for k, yaw in enumerate((0, 60, 125))]


def looked_at(pictures: Sequence[Picture]) -> tuple[list[Frame], Evidence]:
    frames = [frame_of(f"frame {k}", picture) for k, picture in enumerate(pictures)]
    features = {k: find_features(picture, None, 1200) for k, picture in enumerate(pictures)}
    with thread_pool(2) as pool:
        return frames, gather_evidence(features, pool, lambda items, **_: items)


def reason(good: list[Picture], odd: Picture, *more: Picture) -> str:
    """Why the frame after the good ones is left out."""
    frames, evidence = looked_at([*good, odd, *more])
    links = evidence.links([CAMERA], 4.0)
    return why_left_out(len(good), frames, evidence, [CAMERA], links, range(len(good)))


def noise(seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (480, 480, 3), np.uint8)


@pytest.mark.parametrize(
    ("level", "words"), [(90, "blank"), (255, "overexposed"), (0, "black")], ids=["grey", "white", "black"]
)
def test_a_plain_picture(level: int, words: str) -> None:
    picture = np.full((480, 480, 3), level, np.uint8)
    assert words in what_is_wrong(picture)
    assert words in what_is_wrong(picture.astype(np.uint16) * 257)


def test_a_plain_circle_in_black_is_blank() -> None:
    inside = CAMERA.size[0]
    picture = np.zeros((inside, inside, 3), np.uint8)
    mask = np.zeros((inside, inside), np.uint8)
    cv2.circle(mask, (240, 240), 200, 255, -1)
    picture[mask > 0] = 120
    assert "blank" in what_is_wrong(picture, mask)


def test_noise_is_told_from_a_scene(good: list[Picture]) -> None:
    assert "noise" in what_is_wrong(noise())
    ok, data = cv2.imencode(".jpg", noise(), [cv2.IMWRITE_JPEG_QUALITY, 80])
    assert ok
    assert "noise" in what_is_wrong(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR)))
    dim = np.clip(30 + 3 * np.random.default_rng(1).standard_normal((480, 480, 3)), 0, 255).astype(np.uint8)
    assert "noise" in what_is_wrong(dim)
    for picture in good:
        assert what_is_wrong(picture) == ""
        assert what_is_wrong((picture / np.float32(255)) ** 2) == ""
        grainy = picture + np.random.default_rng(2).normal(0, 25, picture.shape)
        assert what_is_wrong(np.clip(grainy, 0, 255).astype(np.uint8)) == ""


def test_nothing_to_use_is_said() -> None:
    assert "no pixel" in what_is_wrong(noise(), np.zeros((480, 480), np.uint8))


def test_flipped_keypoints_are_those_of_the_flipped_picture(good: list[Picture]) -> None:
    picture = good[0]
    of_mirror = find_features(np.ascontiguousarray(picture[:, ::-1]), None, 1200)
    by_hand = flipped(find_features(picture, None, 1200), picture.shape[1])
    matches = match_features(by_hand, of_mirror)
    off = np.linalg.norm(by_hand.pixels[matches.first] - of_mirror.pixels[matches.second], axis=1)
    assert len(off) > 0.6 * len(of_mirror)
    assert np.mean(off < 0.5) > 0.95


def test_flipping_twice_changes_nothing(good: list[Picture]) -> None:
    features = find_features(good[0], None, 300)
    again = flipped(flipped(features, 480), 480)
    np.testing.assert_array_equal(again.descriptors, features.descriptors)
    np.testing.assert_allclose(again.pixels, features.pixels, atol=1e-9)


def test_a_mirrored_frame_is_named(room: PanelScene, good: list[Picture]) -> None:
    said = reason(good, np.ascontiguousarray(shot(room, 90, seed=9)[:, ::-1]))
    assert "is mirrored" in said
    assert "flip" in said


def test_a_frame_of_another_room_is_not_called_mirrored(good: list[Picture]) -> None:
    other = furnished_room(seed=5, texel_mm=9.0)
    assert "another place" in reason(good, shot(other, 30))


def test_a_frame_from_another_corner_of_the_room(room: PanelScene, good: list[Picture]) -> None:
    said = reason(good, shot(room, 40, (0.8, 0.1, 0.5)))
    assert "taken from another place" in said


def test_frames_that_hang_together_elsewhere(good: list[Picture]) -> None:
    other = furnished_room(seed=5, texel_mm=9.0)
    said = reason(good, shot(other, 0), shot(other, 50))
    assert "hangs together with frame 4 only" in said


def test_a_plain_frame_is_named_first(good: list[Picture]) -> None:
    assert reason(good, np.full((480, 480, 3), 90, np.uint8)) == "is blank: all its pixels are alike"


@pytest.mark.parametrize("quality", [90, 15])
def test_a_copy_saved_anew_is_found(good: list[Picture], quality: int) -> None:
    ok, data = cv2.imencode(".jpg", good[1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert ok
    frames, evidence = looked_at([*good, np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))])
    assert copies(frames, evidence) == {3: 1}


def test_of_three_copies_two_are_left_out(good: list[Picture]) -> None:
    frames, evidence = looked_at([good[0], good[0].copy(), good[1], good[0].copy()])
    assert copies(frames, evidence) == {1: 0, 3: 0}


def test_what_is_no_copy(room: PanelScene, good: list[Picture]) -> None:
    brighter, a_little_aside = shot(room, 0, seed=4, ev=0.3), shot(room, 0.6, seed=5)
    with_somebody = good[2].copy()
    with_somebody[200:260, 100:140] = good[2][100:160, 300:340]
    frames, evidence = looked_at([*good, brighter, a_little_aside, with_somebody])
    assert copies(frames, evidence) == {}
    other_size = [frames[0], dataclasses.replace(frames[0], id="other", size=(481, 480))]
    features = {0: evidence.features[0], 1: evidence.features[0]}
    assert copies(other_size, gather_evidence(features, None, lambda items, **_: items)) == {}
