"""The tone curve of a camera's own pictures, from brackets whose exposures it noted: what their light is in truth.

Cameras do not write the curve of their colour profile but one with more contrast.  The light X that made a picture is
taken as X = L 2^g, L the light that its codes stand for by their profile, and g, the response, linear between knots at
even steps of the sRGB code of L.  Two pictures of one thing, d EV apart, then say

    log2 L2 + g(L2) - log2 L1 - g(L1) = d

for every value that both show (after Debevec and Malik, SIGGRAPH 1997, who solve for the scene as well).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray

KNOTS = 11
"""Values of a response: at 0, 0.1, ... 1 of the sRGB code."""

_GREY = 0.18  # light that stays as it is
_DARK = 0.002  # of light: below it values are noise
_SURE = 0.05  # from here on noise has no say: darker values count less
_APART_EV = 1.5  # further from what was noted a value is of something else
_VALUES = 20_000  # of a pair
_FEWEST = 500
_SMOOTH = 0.01  # weight of the second differences of g beside that of all values
_ROUNDS, _HUBER_EV = 10, 0.1
_BINS = 8
_UNEVEN_EV = 0.24  # between dark and bright parts: ratios that differ by less are those of pictures without a curve
_OFF_EV = 0.35  # so are those that are off by less from what was noted


class Pair(NamedTuple):
    """Light (n,) of the same values in two pictures by their profile, and how many EV apart the camera took them."""

    dark: FloatArray
    bright: FloatArray
    noted_ev: float


def responded(light: NDArray[Any], response_ev: Sequence[float]) -> NDArray[np.float32]:
    """What light (...) by the profile is in truth; as it is for an empty response."""
    if not len(response_ev):
        return np.asarray(light, np.float32)
    gain = np.interp(_code(np.asarray(light, float)), np.linspace(0, 1, KNOTS), response_ev)
    return np.asarray(light * np.exp2(gain), np.float32)


def rises(response_ev: Sequence[float]) -> bool:
    """Whether brighter codes stand for more light."""
    return bool((np.diff(responded(_light(np.linspace(0, 1, 256)), response_ev)) > 0).all())


def fit_response(pairs: Sequence[Pair]) -> tuple[float, ...]:
    """The response of the camera that took the pictures; empty where they obey their profile, or do not tell.

    Pictures obey it if ratios are the same at all levels of brightness, and about what the camera noted: by a little
    exposures are off without a curve.
    """
    usable = [_usable(pair) for pair in pairs]
    usable = [pair for pair in usable if pair.dark.size >= _FEWEST]
    if not usable or not any(_is_uneven(pair) for pair in usable):
        return ()
    rows = np.concatenate([_hats(pair.bright) - _hats(pair.dark) for pair in usable])
    wanted = np.concatenate([pair.noted_ev - np.log2(pair.bright / pair.dark) for pair in usable])
    sure = np.concatenate([np.minimum(np.sqrt(pair.dark * pair.bright) / _SURE, 1) for pair in usable])
    bends = np.diff(np.eye(KNOTS), 2, axis=0) * (_SMOOTH * sure.sum()) ** 0.5
    grey = _hats(np.array([_GREY])) * sure.sum() ** 0.5
    response, weight = np.zeros(KNOTS), sure
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        matrix = np.concatenate([rows * root[:, None], bends, grey])
        right = np.concatenate([wanted * root, np.zeros(len(bends) + 1)])
        response = np.linalg.lstsq(matrix, right, rcond=None)[0]
        weight = sure * np.minimum(1, _HUBER_EV / np.maximum(np.abs(rows @ response - wanted), 1e-9))
    found = tuple(np.round(response, 4).tolist())
    return found if rises(found) else ()


def _usable(pair: Pair) -> Pair:
    dark, bright, noted = pair
    with np.errstate(divide="ignore", invalid="ignore"):
        near = (np.minimum(dark, bright) > _DARK) & (np.abs(np.log2(bright / dark) - noted) < _APART_EV)
    some = max(1, np.count_nonzero(near) // _VALUES)
    return Pair(dark[near][::some], bright[near][::some], noted)


def _is_uneven(pair: Pair) -> bool:
    """Whether the ratio of two pictures is another in bright than in dark parts, or far from what was noted."""
    ratio = np.log2(pair.bright / pair.dark)
    ratio = ratio[np.argsort(pair.dark * pair.bright, kind="stable")]
    levels = np.array([np.median(part) for part in np.array_split(ratio, _BINS)])
    return bool(np.ptp(levels) > _UNEVEN_EV or abs(np.median(ratio) - pair.noted_ev) > _OFF_EV)


def _hats(light: FloatArray) -> FloatArray:
    """How much each knot counts (n, KNOTS) at each light (n,)."""
    at = _code(light) * (KNOTS - 1)
    hats: FloatArray = np.maximum(0, 1 - np.abs(at[:, None] - np.arange(KNOTS)))
    return hats


def _code(light: FloatArray) -> FloatArray:
    """The sRGB code, 0..1 (IEC 61966-2-1)."""
    inside = np.clip(light, 0, 1)
    return np.where(inside <= 0.0031308, 12.92 * inside, 1.055 * np.maximum(inside, 1e-9) ** (1 / 2.4) - 0.055)


def _light(code: FloatArray) -> FloatArray:
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
