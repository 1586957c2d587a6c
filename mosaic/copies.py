"""Frames that are copies of others, saved anew: the same view to a fraction of a pixel, and the same light."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.project import Frame, Picture

_SAME_PX = 1.0  # compression moves nearly all keypoints by less; no two shots from the hand are as near
_SHARE = 0.8  # of the matches that must lie where they lay
_FOUND_AGAIN = 0.1  # of the keypoints of the frame that has fewer
_COMPARED_PX = 128  # longer side of the pictures that are compared: compression and noise are averaged away
_SAME_LIGHT = 3.5  # levels of 255 by which they may differ on average; a seventh of a stop makes more
_SAME_THINGS = 25.0  # and where they differ most: somebody who walked through makes more


def copies(frames: Sequence[Frame], evidence: Evidence) -> dict[int, int]:
    """For each frame that shows the same as an earlier one, pixel for pixel but for compression, that earlier frame.

    A view taken twice from a tripod with another exposure is no copy.  Neither is one on which something moved.

    Parameters
    ----------
    frames
        All frames, those left out included.
    evidence
        Keypoints and matches of those in use, by index into `frames`.
    """
    first_of: dict[int, int] = {}
    small: dict[int, NDArray[np.float32]] = {}
    for pair in sorted(evidence.matches):
        i, j = pair
        if i in first_of or j in first_of or frames[i].size != frames[j].size or not _same_view(evidence, pair):
            continue
        for k in pair:
            if k not in small:
                small[k] = _reduced(frames[k].load())
        apart = np.abs(small[i] - small[j])
        if apart.mean() < _SAME_LIGHT and np.percentile(apart, 99.8) < _SAME_THINGS:
            first_of[j] = i
    return first_of


def _same_view(evidence: Evidence, pair: Pair) -> bool:
    (i, j), matches = pair, evidence.matches[pair]
    a, b = evidence.features[i].pixels, evidence.features[j].pixels
    if len(matches.first) < max(8, _FOUND_AGAIN * min(len(a), len(b))):
        return False
    moved = np.linalg.norm(a[matches.first] - b[matches.second], axis=1)
    return bool(np.mean(moved < _SAME_PX) > _SHARE)


def _reduced(picture: Picture) -> NDArray[np.float32]:
    """A small grey picture on a scale of 255, its light in fair steps for the eye whatever the type."""
    height, width = picture.shape[:2]
    factor = min(1.0, _COMPARED_PX / max(height, width))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    colour = picture[..., :3].astype(np.float32)
    if picture.dtype == np.uint16:
        colour /= 257
    elif picture.dtype != np.uint8:
        colour = 255 * np.sqrt(np.clip(np.nan_to_num(colour), 0, 4))
    return np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1).mean(-1))
