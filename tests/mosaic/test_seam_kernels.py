"""The loops of the seams against slow twins."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.max_flow import grid_neighbours, minimum_cut
from fullsphere.mosaic.seam_kernels import best_frame, code_at, deviations, expansion, fill_nearest, middle

ALONG, ACROSS, LOSS, SHORT = 7, np.array([3, 6, 6, 3, 0], np.int32), 10.0, 2
AREA = np.array([1.0, 2.0, 3.0, 2.0, 1.0])


def energy(
    owner: NDArray[np.int16], features: NDArray[np.int16], quality: NDArray[np.float32], penalty: NDArray[np.float32]
) -> int:
    """What owners cost, told pixel by pixel and edge by edge."""

    def difference(a: int, b: int, y: int, x: int) -> int:
        return int(np.abs(features[a, y, x].astype(int) - features[b, y, x]).sum())

    height, width = owner.shape
    total = 0
    for y, x in np.ndindex(height, width):
        k = owner[y, x]
        total += int(np.int32(AREA[y] * (LOSS * (1 - quality[k, y, x]) + penalty[k, y, x])))
        for yy, xx, length in ((y, (x + 1) % width, ALONG), (y + 1, x, int(ACROSS[y]))):
            if yy < height and owner[yy, xx] != k:
                a, b = int(k), int(owner[yy, xx])
                if yy == y and y in (0, height - 1):
                    return 1 << 30  # a pole in two hands
                total += length * (difference(a, b, y, x) + difference(a, b, yy, xx) + SHORT)
    return total


@pytest.mark.parametrize("seed", range(12))
def test_an_expansion_finds_the_best_of_all_choices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames, height, width = 3, 5, 4
    features = rng.integers(-20, 20, (frames, height, width, 5)).astype(np.int16)
    quality = rng.uniform(0.1, 1, (frames, height, width)).astype(np.float32)
    penalty = (rng.uniform(0, 300, (frames, height, width)) * (rng.random((frames, height, width)) < 0.5)).astype(
        np.float32
    )
    owner = rng.integers(0, frames, (height, width)).astype(np.int16)
    owner[0], owner[-1] = 1, 2
    free = rng.random((height, width)) < 0.5
    free[0], free[-1] = True, False
    free &= owner != 0
    pixels, neighbours = grid_neighbours(free)
    graph = expansion(
        owner, 0, pixels, neighbours, features, quality, penalty, AREA, ALONG, ACROSS, np.float64(LOSS), SHORT
    )
    expanded = owner.copy()
    expanded.reshape(-1)[pixels[minimum_cut(*graph, neighbours).sink]] = 0

    inside = pixels[pixels >= width]
    best = 1 << 30
    for pole in (False, True):
        for taken in itertools.product((False, True), repeat=len(inside)):
            tried = owner.copy()
            tried.reshape(-1)[inside[np.array(taken, bool)]] = 0
            if pole:
                tried[0] = 0
            best = min(best, energy(tried, features, quality, penalty))
    assert energy(expanded, features, quality, penalty) == best


def test_the_nearest_owner_is_that_of_the_nearest_pixel() -> None:
    rng = np.random.default_rng(0)
    width, height = 48, 24
    rays = Equirectangular((width, height)).window_rays(slice(0, width), slice(0, height))
    lat, turn = np.arcsin(-rays[:, 0, 1]), np.cos(np.arange(width) * (2 * np.pi / width))
    for share in (0.002, 0.02, 0.3):
        owner = np.where(rng.random((height, width)) < share, rng.integers(0, 5, (height, width)), -1).astype(np.int16)
        owner[7, 3] = 2
        owned = owner >= 0
        near = rays.reshape(-1, 3) @ rays[owned].T
        filled = owner.copy()
        fill_nearest(filled, np.sin(lat), np.cos(lat), turn)
        of_filled = np.where(filled.reshape(-1, 1) == owner[owned], near, -2).max(1)
        assert (of_filled > near.max(1) - 0.01).all()  # handing on may miss the nearest by a little
        assert np.mean(of_filled > near.max(1) - 1e-9) > 0.98
        np.testing.assert_array_equal(filled[owned], owner[owned])
    nobody = np.full((height, width), -1, np.int16)
    fill_nearest(nobody, np.sin(lat), np.cos(lat), turn)
    assert (nobody == -1).all()


def test_the_middle_is_the_median_of_who_sees() -> None:
    rng = np.random.default_rng(1)
    light = rng.integers(-500, 500, (6, 8, 10, 3)).astype(np.int16)
    quality = (rng.random((6, 8, 10)) * (rng.random((6, 8, 10)) < 0.6)).astype(np.float32)
    result, count = middle(light, quality)
    np.testing.assert_array_equal(count, (quality > 0).sum(0))
    values = np.where(quality[..., None] > 0, light.astype(float), np.nan)
    seen = count > 0
    np.testing.assert_array_equal(result[seen], np.floor(np.nanmedian(values[:, seen], axis=0)))


def test_deviations_are_what_no_small_shift_explains() -> None:
    rng = np.random.default_rng(2)
    light = rng.integers(-50, 50, (4, 6, 7, 3)).astype(np.int16)
    low, high = light - rng.integers(0, 20, light.shape).astype(np.int16), light + np.int16(9)
    quality = (rng.random((4, 6, 7)) < 0.7).astype(np.float32)
    mid, count = middle(light, quality)
    single, any_two = deviations(light, low, high, quality, mid, mid - np.int16(5), mid + np.int16(5), count)

    def outside(value: NDArray[np.int16], least: NDArray[np.int16], most: NDArray[np.int16]) -> int:
        return int(np.maximum(np.maximum(value - most, least - value), 0).sum())

    for y, x in np.ndindex(6, 7):
        who = np.flatnonzero(quality[:, y, x])
        expected = np.zeros(4, int)
        if len(who) > 2:
            m = mid[y, x]
            for k in who:
                own = light[k, y, x], low[k, y, x], high[k, y, x]
                expected[k] = max(outside(own[0], m - 5, m + 5), outside(m, *own[1:]))
        np.testing.assert_array_equal(single[:, y, x], expected)
        if len(who) == 2:
            a, b = who
            one = outside(light[a, y, x], low[b, y, x], high[b, y, x])
            assert any_two[y, x] == max(one, outside(light[b, y, x], low[a, y, x], high[a, y, x]))
        else:
            assert any_two[y, x] == expected.max()


def test_codes_are_logarithms_and_slopes_of_their_mean() -> None:
    rng = np.random.default_rng(3)
    light = rng.uniform(0, 2, (8, 12, 3)).astype(np.float32)
    quality = (rng.random((8, 12)) < 0.9).astype(np.float32)
    features = np.full((8, 12, 5), 99, np.int16)
    code_at(light, quality, np.ones((8, 12), bool), np.float32(0.5), np.float32(64), features)
    seen = quality > 0
    code = 64 * np.log2(light / 2 + 0.125)
    np.testing.assert_allclose(features[seen][:, :3], code[seen], atol=0.51)
    grey = code.mean(-1)
    across = np.roll(grey, -1, 1) - np.roll(grey, 1, 1)
    known = seen & np.roll(seen, 1, 1) & np.roll(seen, -1, 1)
    np.testing.assert_allclose(features[1:-1, :, 3][known[1:-1]], across[1:-1][known[1:-1]], atol=0.51)
    down = grey[2:] - grey[:-2]
    known = seen[1:-1] & seen[2:] & seen[:-2]
    np.testing.assert_allclose(features[1:-1, :, 4][known], down[known], atol=0.51)
    assert (features[~seen] == 99).all()
    assert not features[[0, -1]][seen[[0, -1]]][:, 3:].any()


def test_the_best_frame_fills_only_what_is_free() -> None:
    quality = np.array([[[0.1, 0.5, 0.0]], [[0.4, 0.5, 0.0]]], np.float32)
    owner = np.array([[-1, -1, -1]], np.int16)
    best_frame(quality, owner)
    assert owner.tolist() == [[1, 0, -1]]
    owner = np.array([[0, 1, 1]], np.int16)
    best_frame(quality, owner)
    assert owner.tolist() == [[0, 1, 1]]
