"""Range from two eyes whose disparities are known: a picture whose rows are shifted, and its holes."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.mosaic.red_cyan import red_cyan
from fullsphere.mosaic.stereo_range import filled_ranges, range_of, stereo_range

WIDTH, HEIGHT = 256, 128


def pattern(seed: int = 2) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def shifted(disparity: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two eyes of one thing all around: the left one sees it further to the right."""
    eye = pattern()
    return eye, np.roll(eye, -disparity, axis=1)


@pytest.mark.parametrize("disparity", [3, 9, 14])
def test_range_follows_from_the_disparity_all_round(disparity: int) -> None:
    for found in stereo_range(*shifted(disparity)):
        known = np.isfinite(found.rho)
        assert known.mean() > 0.95
        assert known[:, [0, -1]].mean() > 0.9  # it goes round
        expected = 1 / math.sin(math.pi * disparity / WIDTH)
        assert np.median(found.rho[known]) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("full", [257, 1 / 255.0])
def test_other_samples_give_the_same(full: float) -> None:
    left, right = shifted(7)
    kind = np.uint16 if full > 1 else np.float32
    plain, other = (
        stereo_range(left, right)[0],
        stereo_range((left * np.float64(full)).astype(kind), (right * np.float64(full)).astype(kind))[0],
    )
    both = np.isfinite(plain.disparity) & np.isfinite(other.disparity)
    assert both.mean() > 0.9
    np.testing.assert_allclose(other.disparity[both], plain.disparity[both], atol=0.3)


def test_behind_a_near_thing_is_what_is_beside_it_far_away() -> None:
    left, right = shifted(3)
    patch = pattern(5)[40:90, 100:150]
    left[40:90, 100:150] = patch
    right[40:90, 100 - 12 : 150 - 12] = patch
    known = stereo_range(left, right)[0].disparity
    assert np.isnan(known[50:80, 93:99]).mean() > 0.7  # the left eye sees it past the thing, the right one does not
    filled = filled_ranges(left, right)[0]
    assert np.isfinite(filled).all()
    assert np.median(filled[50:80, 93:98]) == pytest.approx(
        float(range_of(np.full((1, WIDTH), 3.0, np.float32))[0, 0]), rel=0.05
    )
    assert np.median(filled[50:80, 105:145]) == pytest.approx(1 / math.sin(math.pi * 12 / WIDTH), rel=0.03)


def test_a_blank_room_is_not_known_and_taken_for_far() -> None:
    blank = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    blank[:, :4] = pattern()[:, :4]
    filled = filled_ranges(blank, blank)[0]
    assert np.isfinite(filled).all()
    assert filled[20:-20, 100:200].min() > 100


def test_an_anaglyph_is_red_to_the_left() -> None:
    left, right = shifted(4)
    both = red_cyan(left, right)
    np.testing.assert_array_equal(both[..., 0], left[..., 0])
    np.testing.assert_array_equal(both[..., 1:], right[..., 1:])
