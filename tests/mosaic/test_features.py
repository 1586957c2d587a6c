"""Keypoints: how many, where, how exact; the same whatever the light and the depth of the pixels."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.mosaic.features import Features, find_features, localisation_px
from fullsphere.mosaic.matching import match_features

SIZE = 420


@pytest.fixture(scope="module")
def light() -> NDArray[np.float32]:
    """Linear light (h, w, 3) with texture of every size, from 0 to 1."""
    rng = np.random.default_rng(0)
    total = np.zeros((SIZE, SIZE, 3), np.float32)
    for cells in (12, 30, 70, 160, 400):
        total += (
            cv2.resize(rng.random((cells, cells, 3), np.float32), (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
            / cells**0.5
        )
    total = np.clip((total - total.min()) / (total.max() - total.min()), 0, 1)
    return np.asarray(total**2.2, np.float32)


def coded(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.round(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def same_place(a: Features, b: Features) -> tuple[int, int]:
    """How many matches there are, and how many of them are at one place."""
    found = match_features(a, b)
    off = np.linalg.norm(a.pixels[found.first] - b.pixels[found.second], axis=1)
    return len(off), int((off < 1).sum())


def test_all_that_is_known_of_a_keypoint(light: NDArray[np.float32]) -> None:
    features = find_features(coded(light), None, 500)
    assert 300 < len(features) <= 500
    assert features.pixels.min() >= -0.5
    assert features.pixels.max() <= SIZE - 0.5
    np.testing.assert_allclose(np.linalg.norm(features.descriptors.astype(float), axis=1), 1, atol=2e-3)
    assert len(features.sigma_px) == len(features.response) == len(features)
    assert features.sigma_px.min() > 0.05
    assert features.response.min() > 0


@pytest.mark.parametrize("most", [100, 400, 1500])
def test_about_as_many_as_asked_for_all_over_the_picture(light: NDArray[np.float32], most: int) -> None:
    features = find_features(coded(light), None, most)
    assert 0.6 * most < len(features) <= most
    quarter = (features.pixels // (SIZE / 2)).astype(int) @ [1, 2]
    assert np.bincount(quarter, minlength=4).min() > 0.15 * len(features)


def test_a_reduced_picture_shifts_no_keypoint(light: NDArray[np.float32]) -> None:
    """Sizes that the factor does not divide: what is found lies where it is at full size, to a twentieth of a pixel."""
    picture = coded(light)[:413, :401]
    whole, reduced = find_features(picture, None, 3000), find_features(picture, None, 150)
    found = match_features(whole, reduced)
    shift = whole.pixels[found.first] - reduced.pixels[found.second]
    good = np.linalg.norm(shift, axis=1) < 1.5
    assert good.sum() > 60
    assert np.abs(np.median(shift[good], axis=0)).max() < 0.05
    left = found.first[good][whole.pixels[found.first[good], 0] < 200]
    right = found.first[good][whole.pixels[found.first[good], 0] > 200]
    for side in (left, right):
        at = np.isin(found.first, side) & good
        assert np.abs(np.median(shift[at], axis=0)).max() < 0.1


def test_keypoints_keep_inside_the_mask(light: NDArray[np.float32]) -> None:
    allowed = np.zeros((SIZE, SIZE), np.uint8)
    cv2.circle(allowed, (230, 190), 120, 255, -1)
    features = find_features(coded(light), allowed, 300)
    assert len(features) > 100
    assert np.linalg.norm(features.pixels - [230, 190], axis=1).max() < 122
    assert len(find_features(coded(light), np.zeros_like(allowed), 300)) == 0


@pytest.mark.parametrize("share", [0.4, 0.12, 0.05])
def test_dark_frames_match_bright_ones(light: NDArray[np.float32], share: float) -> None:
    bright = find_features(coded(light), None, 600)
    dark = find_features(np.round(coded(light) * share).astype(np.uint8), None, 600)
    count, right = same_place(bright, dark)
    assert right > 60
    assert right > 0.9 * count


@pytest.mark.parametrize("stops", [-4, -2, 1])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_linear_pictures_match_coded_ones_at_any_exposure(
    light: NDArray[np.float32], dtype: type[np.uint16] | type[np.float32], stops: int
) -> None:
    exposed = light * np.float32(2.0**stops)
    picture = np.round(65535 * np.clip(exposed, 0, 1)).astype(np.uint16) if dtype == np.uint16 else exposed
    count, right = same_place(find_features(coded(light), None, 600), find_features(picture, None, 600))
    assert right > 100
    assert right > 0.75 * count


def test_values_that_are_no_light_do_no_harm(light: NDArray[np.float32]) -> None:
    spoilt = light.copy()
    spoilt[:20, :20] = np.nan
    spoilt[30:40, :20] = np.inf
    spoilt[50:60, :20] = -5
    count, right = same_place(find_features(light, None, 400), find_features(spoilt, None, 400))
    assert right > 200
    assert right > 0.9 * count


@pytest.mark.parametrize("value", [0, 7, 255])
def test_a_blank_picture_has_no_keypoints(value: int) -> None:
    assert len(find_features(np.full((200, 300, 3), value, np.uint8), None, 500)) == 0


def test_localisation_error_is_as_said(light: NDArray[np.float32]) -> None:
    """The picture moved by a part of a pixel: matches are off by what `sigma_px` says, small and large ones alike."""
    big = cv2.resize(light, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    moved = [cv2.resize(np.roll(big, step, 1), (SIZE, SIZE), interpolation=cv2.INTER_AREA) for step in (0, 1)]
    rng = np.random.default_rng(0)
    noisy = [np.clip(coded(one) + rng.normal(0, 2, one.shape), 0, 255).round().astype(np.uint8) for one in moved]
    a, b = (find_features(one, None, 2000) for one in noisy)
    found = match_features(a, b)
    off = b.pixels[found.second] - a.pixels[found.first] - [1 / 3, 0]
    sigma = np.hypot(a.sigma_px[found.first], b.sigma_px[found.second])
    good = np.linalg.norm(off, axis=1) < 2
    small, large = good & (sigma < np.median(sigma)), good & (sigma >= np.median(sigma))
    for some in (small, large):
        ratio = np.median(np.linalg.norm(off[some], axis=1) / sigma[some]) / 1.177
        assert 0.2 < ratio < 2  # noise of other pictures differs, its order of magnitude does not
    size = np.array([2.0, 20.0])
    for conformal in (False, True):
        assert np.diff(localisation_px(size, conformal)) > 0
    assert np.all(localisation_px(size, True) < localisation_px(size, False))


def test_chosen_features_keep_what_is_known(light: NDArray[np.float32]) -> None:
    features = find_features(coded(light), None, 200)
    some = features.where(np.array([5, 2, 9]))
    np.testing.assert_array_equal(some.sigma_px, features.sigma_px[[5, 2, 9]])
    np.testing.assert_array_equal(some.pixels, features.pixels[[5, 2, 9]])
    bare = Features(features.pixels, features.descriptors).where(np.array([1]))
    assert len(bare) == 1
    assert bare.sigma_px.size == 0


def test_keypoints_and_descriptors_are_as_many() -> None:
    with pytest.raises(ValueError, match="3 keypoints and 2 descriptors"):
        Features(np.zeros((3, 2)), np.zeros((2, 128), np.float32))
