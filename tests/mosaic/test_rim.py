"""The image circle of a set of frames, whatever single ones of them show."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of

from fullsphere.mosaic.project import Picture
from fullsphere.mosaic.rim import common_circle

SIZE, CENTRE, RADIUS = (700, 500), (356.3, 243.8), 221.5


def disc(seed: int = 0, light: float = 200.0) -> NDArray[np.uint8]:
    """A lit circle with blotches in the dark."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    inside = np.clip(RADIUS + 0.5 - np.hypot(u - CENTRE[0], v - CENTRE[1]), 0, 1)
    coarse = np.random.default_rng(seed).uniform(0.5, 1, (10, 14)).astype(np.float32)
    blotches = cv2.resize(coarse, SIZE, interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(2 + light * inside * blotches, 0, 255)[..., None].repeat(3, -1), np.uint8)


def half_dark(seed: int, side: slice) -> NDArray[np.uint8]:
    picture = disc(seed)
    picture[:, side] = 2
    return picture


GOOD = [disc(k) for k in range(3)]
FULL = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
NOISE = np.random.default_rng(0).integers(0, 256, FULL.shape, np.uint8)
ODD = {
    "white": [FULL],
    "grey": [FULL // 3],
    "black": [FULL * 0],
    "noise": [NOISE],
    "overexposed": [np.asarray(np.minimum(disc(3) * 20.0 + 60, 255), np.uint8)],
    "more than the good ones": [FULL, FULL // 2, FULL // 3, FULL * 0],
    "full-frame": [cv2.resize(NOISE[:30, :40], SIZE, interpolation=cv2.INTER_CUBIC)],
}


def assert_found(pictures: list[Picture], tolerance_px: float = 0.3) -> None:
    circle = common_circle([frame_of(str(k), picture) for k, picture in enumerate(pictures)])
    assert circle is not None
    np.testing.assert_allclose([*circle.centre, circle.radius], [*CENTRE, RADIUS], atol=tolerance_px)


@pytest.mark.parametrize("odd", ODD.values(), ids=ODD.keys())
def test_frames_without_a_circle_do_not_hide_that_of_the_others(odd: list[Picture]) -> None:
    assert_found([*odd, *GOOD])


def test_frames_dark_at_parts_of_the_rim_make_it_up_together() -> None:
    assert_found([half_dark(0, np.s_[:330]), half_dark(1, np.s_[380:])])


def test_a_dim_frame_with_a_grey_surround_changes_nothing() -> None:
    assert_found([*GOOD, np.maximum(disc(4, light=40.0), 12)])


def test_large_pictures_are_reduced_and_the_circle_is_theirs() -> None:
    size = (2100, 1500)
    large = [cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC) for picture in GOOD]
    circle = common_circle([frame_of(str(k), picture) for k, picture in enumerate(large)])
    assert circle is not None
    expected = [3 * (CENTRE[0] + 0.5) - 0.5, 3 * (CENTRE[1] + 0.5) - 0.5, 3 * RADIUS]
    np.testing.assert_allclose([*circle.centre, circle.radius], expected, atol=1.0)


def test_ordinary_pictures_show_none() -> None:
    full_frame = ODD["full-frame"][0]
    assert common_circle([frame_of("a", full_frame), frame_of("b", full_frame[::-1]), frame_of("c", GOOD[0])]) is None
    assert common_circle([frame_of("a", FULL), frame_of("b", FULL * 0)]) is None
    assert common_circle([]) is None
