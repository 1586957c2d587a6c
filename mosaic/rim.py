"""The image circle that frames of one lens show together."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.circle import SEARCH_SIDE_PX, ImageCircle, brightest, corner_levels, find_circle
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.project import Frame, Picture

_AT_MOST = 16  # frames looked at: what is dark at the rim of one is bright in another of so many
_ALIKE = 16  # levels of 255 between corners and all else, below which a frame is blank or dark and has no say
_SHINING = 0.25  # of the usual light: corners brighter than that are lit


class _Look(NamedTuple):
    """The brightest of each pixel's channels (h, w), reduced; the level of the dark corners, and of what is lit."""

    grey: NDArray[np.uint8]
    corner: float
    lit: float


def common_circle(frames: Sequence[Frame], executor: Executor | None = None) -> ImageCircle | None:
    """The image circle of frames taken with one lens; None where none is to be seen.

    It is sought in the brightest that any of some frames, spread over the set, shows at each pixel; they are opened
    side by side on `executor`.  Where most have dark corners, single frames with lit ones (overexposed, blank, noise,
    taken with another lens) would hide the circle and are passed over.
    """
    some = frames[:: max(1, -(-len(frames) // _AT_MOST))]
    looks = list(ordered_map(executor, _look, some, ahead=2))
    telling = [look for look in looks if look.lit - look.corner > _ALIKE] or looks
    if not telling:
        return None
    usual = float(np.median([look.lit for look in telling]))
    dark = [look for look in telling if look.corner <= _SHINING * usual]
    if 2 * len(dark) < len(telling):
        return None
    found = find_circle(functools.reduce(np.maximum, [look.grey for look in dark]))
    return None if found is None else found.scaled(frames[0].size[0] / dark[0].grey.shape[1])


def _look(frame: Frame) -> _Look:
    grey = brightest([eight_bit(frame.load())])
    factor = min(1.0, SEARCH_SIDE_PX / max(grey.shape))
    small = np.asarray(cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)
    return _Look(small, *corner_levels(small))


def eight_bit(picture: Picture) -> NDArray[np.uint8]:
    """The colours (h, w, c) of a picture in 8 bits; floating-point light by its 99th percentile and a square root."""
    colour = picture[..., :3]
    if picture.dtype == np.uint8:
        return colour
    if picture.dtype == np.uint16:
        return (colour >> 8).astype(np.uint8)
    light = np.nan_to_num(colour, nan=0.0, posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(light, 99)), 1e-9)
    return np.asarray(255 * np.sqrt(np.clip(light / white, 0, 1)), np.uint8)
