"""Pictures in which nothing can be found: blank, black, overexposed, or nothing but noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.mosaic.project import Picture

_ALIKE = 4  # levels of 255 between the darkest and the brightest that compression alone makes of one grey
_WHITE, _BLACK = 250, 5
_CLIPPED = 0.9  # share of the pixels at an end of the scale that leaves too little of the scene
_BLOCK = 8  # pixels along each side that are averaged: white noise falls to an eighth, a scene hardly at all
_NOISE_LEFT = 0.25


def what_is_wrong(picture: Picture, allowed: NDArray[np.uint8] | None = None) -> str:
    """Why no keypoints can be expected in a picture, in plain words; empty where it shows something.

    Parameters
    ----------
    picture
        The frame (h, w, c): uint8, uint16 or linear float.
    allowed
        Mask (h, w): only pixels where it is not zero count; None for all.
    """
    grey = _levels(picture)
    inside = np.ones(grey.shape, bool) if allowed is None else allowed > 0
    values = grey[inside]
    if not values.size:
        return "has no pixel to use: all lie outside the image circle or its mask"
    low, high = np.percentile(values, [0.5, 99.5])
    white, black = float((values >= _WHITE).mean()), float((values <= _BLACK).mean())
    if white > _CLIPPED:
        return f"is overexposed: {100 * white:.0f} % of its pixels are white"
    if black > _CLIPPED:
        return f"is black: {100 * black:.0f} % of its pixels hold no light"
    if high - low <= _ALIKE:
        return "is blank: all its pixels are alike"
    return "shows nothing but noise" if _is_noise(grey, inside) else ""


def _levels(picture: Picture) -> NDArray[np.float32]:
    """Grey from 0 to 255 (h, w); float pictures by the square root of their light over its 99.5th percentile."""
    colour = picture[..., :3].mean(-1, dtype=np.float32) if picture.shape[2] >= 3 else picture[..., 0]
    if picture.dtype == np.uint8:
        return np.asarray(colour, np.float32)
    if picture.dtype == np.uint16:
        return np.asarray(colour / np.float32(257), np.float32)
    light = np.nan_to_num(np.maximum(colour.astype(np.float32), 0), nan=0.0, posinf=0.0)
    brightest = max(float(np.percentile(light, 99.5)), 1e-9)
    return np.asarray(255 * np.sqrt(np.minimum(light / brightest, 1)), np.float32)


def _is_noise(grey: NDArray[np.float32], inside: NDArray[np.bool_]) -> bool:
    """Whether averages over blocks are as alike as those of pixels that know nothing of each other."""
    size = (grey.shape[1] // _BLOCK, grey.shape[0] // _BLOCK)
    if min(size) < 4:
        return False
    cut = np.s_[: size[1] * _BLOCK, : size[0] * _BLOCK]
    covered = cv2.resize(inside[cut].astype(np.float32), size, interpolation=cv2.INTER_AREA)
    means = cv2.resize(grey[cut], size, interpolation=cv2.INTER_AREA)[covered > 0.999]
    return means.size > 16 and float(means.std()) < _NOISE_LEFT * float(grey[inside].std())
