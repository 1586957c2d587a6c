"""Between the codes that files hold and linear light: the curve of their colour space, through tables.

Integer samples are codes, of sRGB where nothing else is said; floating-point samples are linear light already.  Light
is in the primaries of its colour space.  A fourth channel is alpha, which is linear in every file; it is scaled to 0..1
and back without the curve.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fullsphere.model.icc import SRGB, Profile, srgb_curve

_BITS_OF_INDEX = {8: 18, 16: 22}
# Linear light is looked up by its integer index.  The curve is steepest at black, 12.92 codes a code: these widths put
# an index within 0.007 (8 bit) and 0.1 (16 bit) of a code of the true value, so that every code comes back as itself.
# The curves of other colour spaces, which may be infinitely steep there, are looked up by the root of the light.

_CHUNK = 1 << 20  # samples handled at once: the index array stays in the cache

Pixels = NDArray[Any]


def linear_from_encoded(pixels: Pixels, profile: Profile = SRGB) -> NDArray[np.float32]:
    """Samples (..., c) of a file as linear light, float32, 1.0 = white.

    Parameters
    ----------
    pixels
        uint8 or uint16 codes, or floats, which are linear light already and come back as float32.
        With c = 4 the last channel is alpha: 0..1, without the curve.
    profile
        The colour space of codes.

    Raises
    ------
    TypeError
        For samples of another type.
    """
    if pixels.dtype.kind == "f":
        return pixels.astype(np.float32, copy=False)
    linear = decoding_table(pixels.dtype, profile)[pixels]
    if _has_alpha(pixels):
        linear[..., 3] = pixels[..., 3] / np.float32(np.iinfo(pixels.dtype).max)
    return linear


def decoding_table(dtype: DTypeLike, profile: Profile = SRGB) -> NDArray[np.float32]:
    """The light (n,) that each code of an integer type stands for; (0,) for floats, which are light.

    Raises
    ------
    TypeError
        For samples of another type.
    """
    kind = np.dtype(dtype)
    if kind.kind == "f":
        return np.empty(0, np.float32)
    return _decoding_table(_bits(kind), SRGB if profile.curve is srgb_curve else profile)


def encoded_from_linear(linear: NDArray[np.floating[Any]], dtype: DTypeLike, profile: Profile = SRGB) -> Pixels:
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
    own = profile.curve is not srgb_curve
    table = _encoding_table_over_roots(_bits(kind), profile) if own else _encoding_table(_bits(kind))
    encoded = _looked_up(linear, table, by_root=own)
    if _has_alpha(linear):
        top = float(np.iinfo(kind).max)
        encoded[..., 3] = np.fmin(np.fmax(linear[..., 3], 0), 1) * top + 0.5
    return encoded


def largest_channel(values: NDArray[np.floating[Any]]) -> NDArray[Any]:
    """The largest of three channels (..., 3): `max(-1)`, which goes from number to number, in a tenth of its time."""
    return np.asarray(np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2]))


def _looked_up(linear: NDArray[np.floating[Any]], table: Pixels, by_root: bool) -> Pixels:
    flat = np.ascontiguousarray(linear, np.float32).reshape(-1)
    encoded = np.empty(flat.shape, table.dtype)
    last = np.float32(table.size - 1)
    for start in range(0, flat.size, _CHUNK):
        part = flat[start : start + _CHUNK]
        index = np.fmax(part, np.float32(0))  # fmax, not maximum: it answers 0 for NaN
        np.minimum(index, np.float32(1), out=index)
        if by_root:
            np.sqrt(index, out=index)
        index *= last
        index += np.float32(0.5)
        np.take(table, index.astype(np.int32), out=encoded[start : start + _CHUNK], mode="clip")
    return encoded.reshape(linear.shape)


@lru_cache(maxsize=16)
def _decoding_table(bits: int, profile: Profile) -> NDArray[np.float32]:
    return profile.curve(np.arange(1 << bits) / ((1 << bits) - 1)).astype(np.float32)


@cache
def _encoding_table(bits: int) -> Pixels:
    linear = np.arange(1 << _BITS_OF_INDEX[bits]) / ((1 << _BITS_OF_INDEX[bits]) - 1)
    code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.floor(code * ((1 << bits) - 1) + 0.5).astype(f"uint{bits}")


@lru_cache(maxsize=4)
def _encoding_table_over_roots(bits: int, profile: Profile) -> Pixels:
    top = (1 << bits) - 1
    grid = np.linspace(0, 1, 1 << 16)
    linear = np.linspace(0, 1, 1 << _BITS_OF_INDEX[bits]) ** 2
    codes = np.interp(linear, np.maximum.accumulate(profile.curve(grid)), grid) * top
    return np.floor(codes + 0.5).astype(f"uint{bits}")


def _bits(dtype: np.dtype[Any]) -> int:
    if dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise TypeError(f"samples of type {dtype}: only uint8, uint16 and float32 are pixels")
    return 8 * dtype.itemsize


def _has_alpha(pixels: Pixels) -> bool:
    return pixels.ndim > 0 and pixels.shape[-1] == 4
