"""Reading between pixels: exact on them, linear between them, nothing outside, and for pictures of any width."""

from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.sampling import INTERPOLATIONS, Interpolation, sample, smoothed

every_interpolation = pytest.mark.parametrize("interpolation", get_args(Interpolation))


def grid(width: int, height: int) -> NDArray[np.float32]:
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)


@every_interpolation
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [(), (1,), (3,), (4,)])
def test_on_the_pixels_is_the_picture(
    interpolation: Interpolation, dtype: type[Any], channels: tuple[int, ...]
) -> None:
    image = np.random.default_rng(0).integers(0, 255, (20, 30, *channels)).astype(dtype)
    values = sample(image, grid(30, 20), interpolation)
    assert values.dtype == dtype
    np.testing.assert_array_equal(values, image)


@pytest.mark.parametrize(("interpolation", "off_px"), [("linear", 0.0), ("cubic", 0.049)])
def test_a_ramp_is_read_as_a_ramp(interpolation: Interpolation, off_px: float) -> None:
    """To the 1/32 px in which OpenCV steps; its cubic (a = -0.75) bends a ramp by up to (2t^3 - 3t^2 + t)/2 more."""
    ramp = (3 * grid(40, 30)[..., 0] + 5 * grid(40, 30)[..., 1]).astype(np.float32)
    at = np.random.default_rng(0).uniform(2, 27, (10, 10, 2)).astype(np.float32)
    expected = 3 * at[..., 0] + 5 * at[..., 1]
    np.testing.assert_allclose(sample(ramp, at, interpolation), expected, rtol=0, atol=8 * (1 / 64 + off_px))


@every_interpolation
def test_nan_is_zero_and_past_the_border_the_nearest_pixel_answers(interpolation: Interpolation) -> None:
    image = np.full((5, 6, 3), 200, np.uint8)
    at = np.array([[[np.nan, np.nan], [-3.0, 2.0], [7.5, 9.0], [2.0, 2.0]]], np.float32)
    np.testing.assert_array_equal(sample(image, at, interpolation)[0, :, 0], [0, 200, 200, 200])
    assert np.isnan(at[0, 0]).all()  # what was given is left alone


@every_interpolation
def test_a_picture_wider_than_opencv_takes(interpolation: Interpolation) -> None:
    wide = np.random.default_rng(0).integers(0, 255, (6, 33000, 3)).astype(np.uint8)
    at = np.random.default_rng(1).uniform([32600, 0], [33000, 6], (8, 9, 2)).astype(np.float32)
    at[0, 0] = np.nan
    part, part_at = np.ascontiguousarray(wide[:, 32500:]), at - np.array([32500, 0], np.float32)
    np.testing.assert_array_equal(sample(wide, at, interpolation), sample(part, part_at, interpolation))
    tall = np.ascontiguousarray(np.swapaxes(wide, 0, 1))
    np.testing.assert_array_equal(
        sample(tall, np.ascontiguousarray(at[..., ::-1]), "nearest"), sample(wide, at, "nearest")
    )


def test_a_wide_picture_asked_for_nothing() -> None:
    wide = np.ones((2, 40000), np.float32)
    np.testing.assert_array_equal(sample(wide, np.full((3, 4, 2), np.nan, np.float32), "linear"), np.zeros((3, 4)))


def test_smoothing_takes_detail_and_leaves_the_rest() -> None:
    rng = np.random.default_rng(0)
    noise, flat = rng.random((60, 60, 1)).astype(np.float32), np.full((60, 60), 77, np.uint8)
    assert smoothed(noise, 1.0) is noise
    assert smoothed(noise, 0.2) is noise
    assert smoothed(noise, 4.0).shape == noise.shape
    assert smoothed(noise, 4.0).std() < 0.25 * noise.std()
    assert smoothed(noise, 4.0).mean() == pytest.approx(noise.mean(), abs=0.02)
    np.testing.assert_array_equal(smoothed(flat, 3.0), flat)
    assert set(INTERPOLATIONS) == set(get_args(Interpolation))
