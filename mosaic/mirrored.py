"""The keypoints that a picture would have if it were flipped from left to right, without looking at it again."""

from __future__ import annotations

import dataclasses

import numpy as np

from fullsphere.mosaic.features import Features

_ROWS, _COLUMNS, _DIRECTIONS = 4, 4, 8  # of a SIFT descriptor: cells across and along its orientation, and gradients


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
    cells = features.descriptors.reshape(-1, _ROWS, _COLUMNS, _DIRECTIONS)[:, ::-1]
    directions = -np.arange(_DIRECTIONS) % _DIRECTIONS
    descriptors = np.ascontiguousarray(cells[..., directions].reshape(features.descriptors.shape))
    return dataclasses.replace(features, pixels=pixels, descriptors=descriptors)
