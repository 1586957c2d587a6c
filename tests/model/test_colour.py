"""The sRGB curve through tables: exact for every code, and that of the standard."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear, linear_from_encoded


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_every_code_comes_back_as_itself(dtype: type, channels: int) -> None:
    codes: NDArray[Any] = np.arange(np.iinfo(dtype).max + 1, dtype=dtype)
    picture = np.stack([np.roll(codes, 7 * k) for k in range(channels)], -1)[None]
    assert np.array_equal(encoded_from_linear(linear_from_encoded(picture), dtype), picture)


def test_the_curve_is_that_of_the_standard() -> None:
    # IEC 61966-2-1, computed with 30 digits
    codes = np.array([[[0, 10, 11], [64, 128, 255]]], np.uint8)
    expected = [0, 0.00303526984, 0.00334653576, 0.0512694584, 0.2158605001, 1]
    assert np.allclose(linear_from_encoded(codes).ravel(), expected, rtol=3e-7)


@pytest.mark.parametrize(("dtype", "within"), [(np.uint8, 0.507), (np.uint16, 0.61)])
def test_codes_are_the_nearest_but_for_the_width_of_an_index(dtype: type, within: float) -> None:
    linear = np.random.default_rng(1).random(100_000).astype(np.float32) ** 3
    exact = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.astype(float) ** (1 / 2.4) - 0.055)
    error = encoded_from_linear(linear[:, None], dtype)[:, 0] - exact * np.iinfo(dtype).max
    assert np.abs(error).max() <= within


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_is_beyond_the_range_is_clipped_and_nan_is_black(dtype: type) -> None:
    linear = np.array([[-1, -np.inf, np.nan], [1.5, np.inf, 1e30]], np.float32)
    top = np.iinfo(dtype).max
    assert encoded_from_linear(linear, dtype).tolist() == [[0, 0, 0], [top, top, top]]


def test_alpha_does_not_go_through_the_curve() -> None:
    pixels = np.full((2, 2, 4), 128, np.uint8)
    linear = linear_from_encoded(pixels)
    assert linear[0, 0, 3] == pytest.approx(128 / 255)
    assert linear[0, 0, 0] == pytest.approx(0.2158605, rel=1e-5)
    linear[0, 0, 3] = np.nan
    assert encoded_from_linear(linear, np.uint8)[0, 0, 3] == 0


def test_floats_are_linear_already() -> None:
    pixels = np.array([[[-0.5, np.inf, 2.0]]], np.float16)
    linear = linear_from_encoded(pixels)
    assert linear.dtype == np.float32
    assert np.array_equal(linear, pixels.astype(np.float32))
    assert np.array_equal(encoded_from_linear(linear, np.float32), linear)


def test_views_that_are_not_contiguous_are_read_right() -> None:
    linear = np.random.default_rng(2).random((40, 30, 3)).astype(np.float32)
    view = linear[::2, ::-1]
    assert np.array_equal(encoded_from_linear(view, np.uint16), encoded_from_linear(view.copy(), np.uint16))


@pytest.mark.parametrize("dtype", [np.int16, np.uint32, np.float64])
def test_other_types_are_refused(dtype: type) -> None:
    with pytest.raises(TypeError, match="uint8, uint16 and float32"):
        encoded_from_linear(np.zeros((1, 1, 3), np.float32), dtype)
