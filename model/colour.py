"""Between the codes that files hold and linear light: the sRGB curve of IEC 61966-2-1, through tables.

Integer samples are sRGB codes, floating-point samples are linear light already.  A fourth channel is alpha, which is
linear in every file; it is scaled to 0..1 and back without the curve.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_BITS_OF_INDEX = {8: 18, 16: 22}
# Linear light is looked up by its integer index.  The curve is steepest at black, 12.92 codes a code: these widths put
# an index within 0.007 (8 bit) and 0.1 (16 bit) of a code of the true value, so that every code comes back as itself.

_CHUNK = 1 << 20  # samples handled at once: the index array stays in the cache

Pixels = NDArray[Any]


def linear_from_encoded(pixels: Pixels) -> NDArray[np.float32]:
    """Samples (..., c) of a file as linear light, float32, 1.0 = white.

    Parameters
    ----------
    pixels
        uint8 or uint16 sRGB codes, or floats, which are linear light already and come back as float32.
        With c = 4 the last channel is alpha: 0..1, without the curve.

    Raises
    ------
    TypeError
        For samples of another type.
    """
    if pixels.dtype.kind == "f":
        return pixels.astype(np.float32, copy=False)
    linear = _decoding_table(_bits(pixels.dtype))[pixels]
    if _has_alpha(pixels):
        linear[..., 3] = pixels[..., 3] / np.float32(np.iinfo(pixels.dtype).max)
    return linear


def encoded_from_linear(linear: NDArray[np.floating[Any]], dtype: DTypeLike) -> Pixels:
    """Linear light (..., c) as samples of a file: the inverse of `linear_from_encoded`.

    Codes are rounded, what is beyond 0..1 is clipped and NaN becomes 0; float32 is returned as it is.

    Raises
    ------
    TypeError
        For a `dtype` other than uint8, uint16 and float32.
    """
    kind = np.dtype(dtype)
    if kind == np.float32:
        return linear.astype(np.float32, copy=False)
    encoded = _looked_up(linear, _encoding_table(_bits(kind)))
    if _has_alpha(linear):
        top = float(np.iinfo(kind).max)
        encoded[..., 3] = np.fmin(np.fmax(linear[..., 3], 0), 1) * top + 0.5
    return encoded


def _looked_up(linear: NDArray[np.floating[Any]], table: Pixels) -> Pixels:
    flat = np.ascontiguousarray(linear, np.float32).reshape(-1)
    encoded = np.empty(flat.shape, table.dtype)
    last = np.float32(table.size - 1)
    for start in range(0, flat.size, _CHUNK):
        part = flat[start : start + _CHUNK]
        index = np.fmax(part, np.float32(0))  # fmax, not maximum: it answers 0 for NaN
        np.minimum(index, np.float32(1), out=index)
        index *= last
        index += np.float32(0.5)
        np.take(table, index.astype(np.int32), out=encoded[start : start + _CHUNK], mode="clip")
    return encoded.reshape(linear.shape)


@cache
def _decoding_table(bits: int) -> NDArray[np.float32]:
    code = np.arange(1 << bits) / ((1 << bits) - 1)
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4).astype(np.float32)


@cache
def _encoding_table(bits: int) -> Pixels:
    linear = np.arange(1 << _BITS_OF_INDEX[bits]) / ((1 << _BITS_OF_INDEX[bits]) - 1)
    code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.floor(code * ((1 << bits) - 1) + 0.5).astype(f"uint{bits}")


def _bits(dtype: np.dtype[Any]) -> int:
    if dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise TypeError(f"samples of type {dtype}: only uint8, uint16 and float32 are pixels")
    return 8 * dtype.itemsize


def _has_alpha(pixels: Pixels) -> bool:
    return pixels.ndim > 0 and pixels.shape[-1] == 4
