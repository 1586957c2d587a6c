"""The keypoints that a picture would have if it were flipped from left to right, without looking at it again."""

from __future__ import annotations

import dataclasses

import numpy as np

from fullsphere.mosaic.features import Features

_PLACES = np.arange(128).reshape(4, 4, 8)  # of a SIFT descriptor: cells across and along its orientation, gradients
_MIRRORED = _PLACES[::-1][..., -np.arange(8) % 8].ravel()


def flipped(features: Features, width: int) -> Features:
    """Keypoints of the picture flipped from left to right.

    A SIFT descriptor is taken in the frame of its own orientation.  In a mirror the orientation stays the axis and what
    was to its left is to its right: the cells across it change places, and gradients turn the other way round.

    Parameters
    ----------
    features
        Of the picture as it is.
    width
        Of the picture in pixels.
    """
    pixels = features.pixels.copy()
    pixels[:, 0] = width - 1 - pixels[:, 0]
    return dataclasses.replace(features, pixels=pixels, descriptors=features.descriptors[:, _MIRRORED])
