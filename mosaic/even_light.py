"""Exposure flicker of a turn: what each frame's light is multiplied by, so that columns do not differ in brightness.

Neighbours show the same along the rays of the columns where they stand.  The ratios of their light make a small linear
problem in EV for each colour, with the mean held at zero.  What a lens loses towards its rim drops out: along the left
eye's rays the first of two frames looks nearer to its rim than the second, along the right eye's it is the other way.
"""

from __future__ import annotations

import itertools
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.turn_reader import Seen, TurnReader

_COLUMNS = 5  # that are compared
_DARK, _BRIGHT = 0.004, 0.9  # linear light: beyond them a pixel says nothing of the brightness
_CUT = 0.3  # of the ratios at either end: near things, edges, noise
_LEAST_SHARED = 50  # pixels: fewer tell nothing
_PRIOR = 1e-6  # of each frame, beside ratios of weight 1: only the mean is held by it


def even_light(reader: TurnReader, executor: Executor | None = None) -> NDArray[np.float32]:
    """Factors (n, 3) for the light of each frame."""
    n = len(reader.turn.frames)
    seen = ordered_map(executor, lambda k: _seen(reader, k), range(n))
    first = before = next(seen)
    brighter = []
    for this in itertools.chain(seen, (first,)):
        brighter.append(_brighter(before, this))
        before = this
    ratios = np.array(brighter)
    return np.stack([np.exp2(-_levels(ratios[:, channel])) for channel in range(3)], -1).astype(np.float32)


class _Shown(NamedTuple):
    """What a frame shows of the columns at its own angle, at that of the frame before and of the one behind it."""

    own: Seen
    before: Seen
    behind: Seen


def _seen(reader: TurnReader, k: int) -> _Shown:
    angles = reader.turn.angles
    return _Shown(*(reader.read(k, _columns(reader, angles[i % len(angles)])) for i in (k, k - 1, k + 1)))


def _columns(reader: TurnReader, angle: float) -> slice:
    """The columns around a turn angle."""
    left = round(angle / (2 * np.pi) * reader.surface.size[0] - 0.5) - _COLUMNS // 2
    return slice(left, left + _COLUMNS)


def _brighter(first: _Shown, second: _Shown) -> FloatArray:
    """How much brighter the second of two neighbours recorded the same than the first (3,), in EV; NaN if unknown."""
    height = len(first.own.worth)
    left_eye = np.abs(np.arange(height) + 0.5 - height / 2) < height / 4
    halves = [_ratio(first.own, second.before, left_eye), _ratio(first.behind, second.own, ~left_eye)]
    return np.asarray(np.mean(halves, axis=0))


def _ratio(first: Seen, second: Seen, rows: NDArray[np.bool_]) -> FloatArray:
    """The ratio (3,) in EV of what two frames saw in some rows (H,).

    The mean of the middle ratios: the median would be one of the few that codes of 8 bits have.
    """
    usable = (first.worth > 0) & (second.worth > 0) & rows[:, None]
    for seen in (first, second):
        usable &= (seen.light.min(-1) > _DARK) & (seen.light.max(-1) < _BRIGHT)
    if np.count_nonzero(usable) < _LEAST_SHARED:
        return np.full(3, np.nan)
    ratios = np.sort(np.log2(second.light[usable] / first.light[usable]), axis=0)
    cut = int(_CUT * len(ratios))
    return np.asarray(ratios[cut : len(ratios) - cut].mean(0))


def _levels(brighter: FloatArray) -> FloatArray:
    """Brightness (n,) in EV of frames that are so much brighter (n,) than the one before, the first than the last.

    The ratios once round have the sum zero; what is missing is shared out evenly.  Where one is not known the chain is
    held together by the others.
    """
    n = len(brighter)
    known = np.isfinite(brighter)
    first, second = np.arange(n)[known], (np.arange(n)[known] + 1) % n
    normal, right = np.eye(n) * _PRIOR, np.zeros(n)
    np.add.at(normal, (first, first), 1)
    np.add.at(normal, (second, second), 1)
    np.add.at(normal, (first, second), -1)
    np.add.at(normal, (second, first), -1)
    np.add.at(right, second, brighter[known])
    np.add.at(right, first, -brighter[known])
    level = np.linalg.solve(normal, right)
    return np.asarray(level - level.mean())
