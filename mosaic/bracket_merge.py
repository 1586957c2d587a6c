"""Pictures of one thing at several exposures -> its light, at the exposure of one of them.

Each pixel is the mean of what the brackets say of it, weighted by how exactly each knows it (`bracket_kernels`).  The
reference is taken first, then the darker ones, then the brighter ones, each the nearest first and each opened once.
Where a bracket contradicts those before it something moved, and it is left out there: so everything is seen as the
reference saw it, or, where that is clipped, the nearest that is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import decoding_table
from fullsphere.model.icc import Profile
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.bracket_kernels import LEAST, add_bracket
from fullsphere.mosaic.camera_response import responded
from fullsphere.mosaic.project import Picture
from fullsphere.mosaic.small_light import SmallLight, small_light

_FULL = (0.8, 0.95)  # light by the profile: brighter than the first counts less, from the second on not at all
_SIDE_PX = 1000  # of the picture on which it is decided what moved: noise averages out
_LEVELS = 12  # of brightness, of each of which it is known how far brackets usually are apart
_FEWEST, _MOST = 50, 30_000  # squares that tell what is usual: of a level, of all
_SPREADS, _ALIKE_EV = 4.0, 0.3  # further apart than so many usual differences, and this, is another thing
_MOST_USUAL_EV, _MOST_SPREAD_EV = 1.0, 0.5  # where all that is so bright moved it is not what is usual
_BRIGHTER_EV = 0.75  # a clipped pixel that another bracket shows darker than white by this much moved
_DARK = 0.002  # linear light of a bracket: differences of less are noise
_AROUND = np.ones((5, 5), np.uint8)  # squares about one that moved that are left out too: its soft edge


class Exposed(NamedTuple):
    """The codes of a bracket (h, w, c), and what they mean."""

    codes: Picture
    profile: Profile


class _Known(NamedTuple):
    """What is known so far, made small: light (H, W, 3), its weight (H, W), 0 where it is only a lower bound."""

    light: NDArray[np.float32]
    weight: NDArray[np.float32]


def merged_light(
    exposures_ev: Sequence[float],
    reference: int,
    opened: Callable[[int], Exposed],
    response_ev: Sequence[float] = (),
) -> Picture:
    """The light (h, w, c) of a bracketed picture, float32; 1 is what clips at an exposure of 0 EV.

    Parameters
    ----------
    exposures_ev
        How much brighter each bracket recorded the scene than the picture is to be.
    reference
        Index of the bracket that shows things where they are.
    opened
        Gives a bracket by its index; all are of one size.  What is not opaque in one of them is transparent.
    response_ev
        The tone curve of the camera (`camera_response`).

    Returns
    -------
    In the primaries of sRGB.
    """
    exposures = 2.0 ** np.asarray(exposures_ev, float)
    darkest = float(exposures.min())
    codes, profile = opened(reference)
    total = np.zeros((*codes.shape[:2], 3 if codes.shape[2] >= 3 else 1), np.float32)
    weight = np.zeros(codes.shape[:2], np.float32)
    known, alpha = None, _alpha(codes)
    to_srgb = profile.srgb_from_own.T.astype(np.float32)
    nearly, clipped = responded(np.array(_FULL), response_ev).tolist()
    for k in _order(exposures, reference):
        if known is not None:
            codes, profile = opened(k)
            alpha = np.minimum(alpha, _alpha(codes))
        exposure, table = float(exposures[k]), responded(decoding_table(codes.dtype, profile), response_ev)
        factor = max(1, round(max(codes.shape[:2]) / _SIDE_PX))
        small = _small(codes, table, nearly, factor, exposure)
        known, moved = _added(known, small, exposure, exposure == darkest)
        least = LEAST if k == reference else 0.0
        add_bracket(codes, table, exposure, exposure == darkest, least, nearly, clipped, moved, factor, total, weight)
    total /= weight[..., None]
    if total.shape[2] == 3 and not np.array_equal(to_srgb, np.eye(3)):
        total = np.maximum(total @ to_srgb, np.float32(0))
    return np.concatenate([total, alpha], axis=2) if alpha.size else total


def _alpha(codes: Picture) -> NDArray[np.float32]:
    """How opaque the pixels are (h, w, 1); (h, w, 0) where a picture does not say."""
    if codes.shape[2] != 4:
        return np.empty((*codes.shape[:2], 0), np.float32)
    return np.asarray(codes[..., 3:] / np.iinfo(codes.dtype).max, np.float32)


def _order(exposures: FloatArray, reference: int) -> list[int]:
    """The reference, the darker ones from bright to dark, the brighter ones from dark to bright."""
    rising = [int(k) for k in np.argsort(exposures, kind="stable")]
    place = rising.index(reference)
    return [reference, *rising[:place][::-1], *rising[place + 1 :]]


def _small(codes: Picture, table: NDArray[np.float32], nearly: float, factor: int, exposure: float) -> SmallLight:
    """A bracket made small, its light at the reference's exposure."""
    colour = codes if codes.shape[2] >= 3 else np.repeat(codes[..., :1], 3, axis=2)
    small = small_light(colour, table, float(np.searchsorted(table, nearly)), factor)
    return small._replace(light=small.light / np.float32(exposure))


def _trusted(small: SmallLight, darkest: bool) -> NDArray[np.float32]:
    """1 where all of a square counts and is not clipped; the darkest bracket is taken as it is."""
    return np.asarray((small.seen == 1) & ((small.clipped == 0) | darkest), np.float32)


def _added(
    known: _Known | None, small: SmallLight, exposure: float, darkest: bool
) -> tuple[_Known, NDArray[np.float32]]:
    """What is known after another bracket, and where that shows another thing, softly (H, W)."""
    trusted = _trusted(small, darkest)
    if known is None:
        return _Known(small.light, trusted * np.float32(exposure)), np.zeros_like(trusted)
    dark = np.float32(_DARK / min(exposure, 1.0))
    ev = np.log2((small.light + dark) / (known.light + dark))
    both = (known.weight > 0) & (trusted > 0)
    apart = _unusual(ev, known.light.mean(-1), both)
    bounded = (known.weight == 0) & (trusted > 0) & (ev.max(-1) < -_BRIGHTER_EV)
    shining = (known.weight > 0) & (trusted == 0) & (ev.min(-1) > _BRIGHTER_EV)  # clipped, where nothing is so bright
    other = cv2.medianBlur((apart | bounded | shining).astype(np.uint8), 3)
    other = cv2.dilate(other, _AROUND)
    share = trusted * np.float32(exposure) * (other == 0)
    weight = known.weight + share
    light = known.light * known.weight[..., None] + small.light * share[..., None]
    light = np.where(weight[..., None] > 0, light / np.maximum(weight, np.float32(1e-9))[..., None], known.light)
    return _Known(light, weight), np.asarray(cv2.blur(other.astype(np.float32), (3, 3)), np.float32)


def _unusual(ev: NDArray[np.float32], level: NDArray[np.float32], both: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where two brackets differ (H, W, 3) by more than is usual where the scene is as bright as there (H, W).

    What is usual they tell themselves: noise, and the tone curve of a camera, for which exposures are no mere factors.
    """
    squares = np.count_nonzero(both)
    if squares < _FEWEST:
        return np.zeros(level.shape, bool)
    brightness, some = np.log2(level + np.float32(_DARK)), max(1, squares // _MOST)
    inside, found = brightness[both][::some], ev[both][::some]
    count = min(_LEVELS, len(inside) // _FEWEST)
    part = np.array_split(np.argsort(inside, kind="stable"), count)
    at = np.array([inside[k].mean(dtype=float) for k in part])
    usual = np.clip([np.median(found[k]) for k in part], -_MOST_USUAL_EV, _MOST_USUAL_EV)
    spread = np.array([1.4826 * np.median(np.abs(found[k] - m)) for k, m in zip(part, usual, strict=True)])
    spread = np.minimum(spread, _MOST_SPREAD_EV)
    limit = _ALIKE_EV + _SPREADS * np.interp(brightness, at, spread)
    off = np.abs(ev - np.interp(brightness, at, usual)[..., None]).max(-1)
    return np.asarray(both & (off > limit))
