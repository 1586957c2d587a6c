"""How two pictures of one thing differ: in exposure, by the light that both recorded, and in where they show it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import decoding_table
from fullsphere.model.errors import InputError
from fullsphere.model.images import read_picture
from fullsphere.mosaic.camera_response import Pair, responded
from fullsphere.mosaic.small_light import small_light

_SIDE_PX = 600  # of the pictures that are compared: noise and small shifts average out
_CLIPPED, _DARK = 0.9, 0.004  # linear light, of full scale: beyond them a pixel says nothing of the brightness
_LIKELY_EV, _NEAR_EV = 0.5, 0.25  # from the median: so near are values of one thing, and those that are measured with
_ROUNDS = 4
_WINDOW_PX = 384
_PLACES = ((0.5, 0.5), (0.3, 0.3), (0.7, 0.3), (0.3, 0.7), (0.7, 0.7))  # of the windows' middles: inside any circle
_FINE_PX = 4.0  # standard deviation of the blur beside which detail stands out
_FLAT_EV = 0.05  # standard deviation: a window with less shows no detail
_FOUND = 0.2  # of 1: the least peak of a phase correlation that is believed


class Look(NamedTuple):
    """A picture made small: its light (h, w, 3), and which of its pixels are sure (h, w): none of them above `most`.

    `windows` are parts of it as it is.
    """

    light: NDArray[np.float32]
    sure: NDArray[np.bool_]
    most: float
    windows: tuple[NDArray[np.float32], ...]


class Step(NamedTuple):
    """How much brighter one picture is than another, by how many values, and what share of all that do say so."""

    ev: float
    values: int
    agreeing: float


def look_at(path: Path, response_ev: Sequence[float] = ()) -> Look:
    """Open a picture file to compare it, its light by the camera's tone curve (`camera_response`).

    Raises
    ------
    InputError
        If it cannot be read, or holds light instead of codes.
    """
    picture = read_picture(path)
    if picture.linear:
        raise InputError(f"{path}: holds light (floating point), which needs no brackets; give pictures of codes")
    codes = picture.pixels
    table = responded(decoding_table(codes.dtype, picture.profile), response_ev)
    most = float(responded(np.array(_CLIPPED), response_ev))
    colour = codes if codes.shape[2] >= 3 else np.repeat(codes[..., :1], 3, axis=2)
    factor = max(1, round(max(codes.shape[:2]) / _SIDE_PX))
    small = small_light(colour, table, float(np.searchsorted(table, most)), factor)
    green = codes[..., 1 if codes.shape[2] >= 3 else 0]
    windows = tuple(table[green[window]] for window in _windows(*codes.shape[:2]))
    return Look(small.light, (small.seen == 1) & (small.clipped == 0), most, windows)


def pair_of(dark: Look, bright: Look, noted_ev: float) -> Pair:
    """What two pictures of one size tell of the camera's tone curve."""
    sure = dark.sure & bright.sure
    return Pair(dark.light[sure].astype(float).ravel(), bright.light[sure].astype(float).ravel(), noted_ev)


def step_between(dark: Look, bright: Look) -> Step:
    """How much brighter the second of two pictures of one size is than the first.

    A value counts where both pictures are sure of it and it is neither clipped nor dark in either, judged by the mean
    of both, so that noise does not choose; and where the two are apart as most are.
    """
    sure = dark.sure & bright.sure
    a, b = (look.light[sure].astype(float).ravel() for look in (dark, bright))
    lit = (a > _DARK / 4) & (b > _DARK / 4)
    a, b = a[lit], b[lit]
    if not a.size:
        return Step(0.0, 0, 0.0)
    apart, chosen = np.log2(b / a), np.ones(a.shape, bool)
    ev = float(np.median(apart))
    for _ in range(_ROUNDS):
        chosen = np.sqrt(a * b) > _DARK * 2 ** (abs(ev) / 2)
        if not chosen.any():
            return Step(ev, 0, 0.0)
        ev = float(np.median(apart[chosen]))
    near = chosen & (np.abs(apart - ev) < _NEAR_EV)
    likely = float((np.abs(apart[chosen] - ev) < _LIKELY_EV).mean())
    return Step(float(np.log2(b[near].sum() / a[near].sum())), int(near.sum()), likely)


def shift_between(one: Look, other: Look, ev: float) -> float | None:
    """By how many pixels two pictures are shifted against each other, the second brighter by `ev`; None if unknown.

    By phase correlation (Kuglin and Hines 1975) of windows, of what both show; the median of those that are sure.
    """
    found = []
    for a, b in zip(one.windows, other.windows, strict=True):
        b = b * np.float32(2.0**-ev)
        least, most = _DARK * max(1.0, 2.0**-ev), one.most * min(1.0, 2.0**-ev)
        if least >= most:
            continue
        both = [_detail(np.clip(light, least, most)) for light in (a, b)]
        if min(float(light.std()) for light in both) < _FLAT_EV:
            continue
        across = cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F)
        (u, v), peak = cv2.phaseCorrelate(*both, across)
        if peak > _FOUND:
            found.append(float(np.hypot(u, v)))
    return float(np.median(found)) if found else None


def _detail(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light (h, w) as EV above that around it."""
    ev = np.log2(light).astype(np.float32)
    return np.asarray(ev - cv2.GaussianBlur(ev, (0, 0), _FINE_PX))


def _windows(height: int, width: int) -> list[tuple[slice, slice]]:
    side = min(_WINDOW_PX, max(16, min(height, width) // 3))
    corners = [(int(y * height - side / 2), int(x * width - side / 2)) for x, y in _PLACES]
    return [(slice(max(top, 0), top + side), slice(max(left, 0), left + side)) for top, left in corners]
