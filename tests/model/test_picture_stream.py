"""Files made of strips hold the same picture as those that are encoded whole."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.encoded_picture import Metadata
from fullsphere.model.picture_stream import STRIP_ROWS, JpegStream, PictureStream, PngStream


def picture(size: tuple[int, int], channels: int, dtype: type = np.uint8) -> NDArray[np.generic]:
    """Waves and noise, bright enough that differences wrap."""
    width, height = size
    v, u = np.mgrid[:height, :width]
    wave = 0.5 + 0.5 * np.sin(u / 7 + v / 11)[..., None] * np.cos(np.arange(channels) + v[..., None] / 5)
    noisy = np.clip(wave + np.random.default_rng(0).normal(0, 0.02, wave.shape), 0, 1)
    pixels: NDArray[np.generic] = (noisy * np.iinfo(dtype).max).astype(dtype)
    return pixels


def written(stream: PictureStream, pixels: NDArray[np.generic]) -> NDArray[np.uint8]:
    pieces = [p for y in range(0, len(pixels), STRIP_ROWS) for p in stream.strip(pixels[y : y + STRIP_ROWS])]
    return np.frombuffer(b"".join([*pieces, *stream.end()]), np.uint8)


SIZES = [(1, 1), (17, 9), (33, STRIP_ROWS), (50, STRIP_ROWS + 1), (131, 3 * STRIP_ROWS - 5)]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("level", [0, 4])
def test_a_png_of_strips_holds_every_bit(size: tuple[int, int], channels: int, dtype: type, level: int) -> None:
    pixels = picture(size, channels, dtype)
    found = cv2.imdecode(written(PngStream(size, Metadata(), level), pixels), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert found.dtype == dtype
    np.testing.assert_array_equal(found.reshape(pixels.shape), pixels)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("quality", [60, 95])
def test_a_jpeg_of_strips_is_the_same_picture_as_one_encoded_whole(
    size: tuple[int, int], channels: int, quality: int
) -> None:
    pixels = picture(size, channels)
    options = [
        cv2.IMWRITE_JPEG_QUALITY,
        quality,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    _, whole = cv2.imencode(".jpg", pixels, options)
    expected = cv2.imdecode(whole, cv2.IMREAD_UNCHANGED)
    found = cv2.imdecode(written(JpegStream(size[1], Metadata(), quality), pixels), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found, expected)


def test_a_png_is_no_larger_than_opencv_makes_it() -> None:
    pixels = picture((700, 600), 3)
    _, whole = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 4])
    assert written(PngStream((700, 600), Metadata(), 4), pixels).size < 1.05 * whole.size
