"""How far things are, from the two eyes of a turning arm: disparity along rows, and range from it.

Rows of the eyes are epipolar lines.  What stands at a range rho from the turning axis is seen by the left eye further
to the right than by the right eye, by the angle

    disparity = 2 asin(1/rho),        rho = 1 / sin(disparity/2)        in arm lengths

at every elevation (Shum, Kalai & Seitz 1999; Seitz 2001).  Matching is OpenCV's semi-global one (Hirschmueller 2008),
over pictures that go round.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear

NEAREST = 2.5
"""Arm lengths from the axis: nothing is looked for nearer."""

_STEP = 16  # disparities are looked for in multiples of so many
_BLOCK = 5  # side of what is compared, pixels
_SMOOTH, _JUMP = 8 * 3 * _BLOCK**2, 32 * 3 * _BLOCK**2  # penalties of OpenCV's example for three colours
_UNIQUE = 5  # per cent by which the best match is better than the next
_GRADIENT = 31  # more than this much is as good as it
_AGREED_PX = 1.0  # between what is found from the left and from the right
_FIXED_POINT = 16  # OpenCV's disparities are 16 times as large
_SMOOTHED = 5  # side of the median, pixels
_LEAST_PX = 1e-3  # of a disparity; things without any are further than anything


class StereoRange(NamedTuple):
    """Of one eye: disparities (H, W) in pixels, and ranges (H, W) in arm lengths; NaN where they are not known."""

    disparity: NDArray[np.float32]
    rho: NDArray[np.float32]


def stereo_range(left: NDArray[Any], right: NDArray[Any], nearest: float = NEAREST) -> tuple[StereoRange, StereoRange]:
    """Range as the left and as the right eye see it.

    Parameters
    ----------
    left, right
        The eyes (H, W, 3), equirectangular, W = 2 H: codes of 8 or 16 bits, or linear light.
    nearest
        The smallest range that is looked for, arm lengths.

    Returns
    -------
    That of the left and that of the right eye; a pixel is known where the two agree within a pixel.
    """
    of_left, of_right = _matched(_codes(left), _codes(right), nearest)
    return _checked(of_left, of_right, -1), _checked(of_right, of_left, +1)


def filled_ranges(
    left: NDArray[Any], right: NDArray[Any], nearest: float = NEAREST
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Ranges (H, W) as each eye sees it, everywhere: where one eye sees past a thing, what is behind it.

    Rows of which nothing is known are infinitely far.
    """
    first, second = stereo_range(left, right, nearest)
    return _filled(first.disparity), _filled(second.disparity)


def range_of(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ranges in arm lengths of disparities (H, W) in pixels: rho = 1/sin(disparity/2)."""
    angle = np.maximum(disparity, _LEAST_PX) * (2 * math.pi / disparity.shape[1])
    return np.asarray(1 / np.sin(angle / 2), np.float32)


def _codes(eye: NDArray[Any]) -> NDArray[np.uint8]:
    """The codes of 8 bits that the matcher takes."""
    if eye.dtype.kind == "f":
        return np.asarray(encoded_from_linear(np.ascontiguousarray(eye), np.uint8), np.uint8)
    return eye if eye.dtype == np.uint8 else (eye >> 8).astype(np.uint8)


def _matched(
    left: NDArray[np.uint8], right: NDArray[np.uint8], nearest: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Disparities (H, W) of the left and of the right eye, below zero where no match is found."""
    width = left.shape[1]
    most = math.ceil(2 * math.asin(1 / nearest) / (2 * math.pi) * width / _STEP) * _STEP
    matcher = cv2.StereoSGBM.create(
        0, most, _BLOCK, _SMOOTH, _JUMP, uniquenessRatio=_UNIQUE, preFilterCap=_GRADIENT, disp12MaxDiff=1
    )
    padded = [cv2.copyMakeBorder(eye, 0, 0, most, most, cv2.BORDER_WRAP) for eye in (left, right)]
    mirrored = [np.ascontiguousarray(eye[:, ::-1]) for eye in reversed(padded)]
    found = matcher.compute(*padded), matcher.compute(*mirrored)[:, ::-1]
    of_left, of_right = (part[:, most:-most].astype(np.float32) / _FIXED_POINT for part in found)
    return of_left, of_right


def _checked(own: NDArray[np.float32], other: NDArray[np.float32], side: int) -> StereoRange:
    """The disparities of one eye where the other's, at the place that they lead to on its `side`, are the same."""
    width = own.shape[1]
    across = (np.arange(width) + np.rint(side * own).astype(np.intp)) % width
    there = np.take_along_axis(other, across, axis=1)
    agreed = (own >= 0) & (there >= 0) & (np.abs(own - there) <= _AGREED_PX)
    disparity = np.where(agreed, own, np.float32(np.nan))
    return StereoRange(disparity, range_of(disparity))


def _filled(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ranges of disparities (H, W) that are not known everywhere: gaps in a row get the smaller one beside them."""
    width = disparity.shape[1]
    around = np.tile(disparity, 3)
    known, columns = np.isfinite(around), np.arange(3 * width)
    before = np.maximum.accumulate(np.where(known, columns, 0), axis=1)
    behind = np.minimum.accumulate(np.where(known, columns, 3 * width - 1)[:, ::-1], axis=1)[:, ::-1]
    middle = slice(width, 2 * width)
    beside = [np.take_along_axis(around, at[:, middle], axis=1) for at in (before, behind)]
    far = np.nan_to_num(np.fmin(*beside)).astype(np.float32)
    smooth = cv2.medianBlur(cv2.copyMakeBorder(far, 2, 2, 2, 2, cv2.BORDER_WRAP), _SMOOTHED)[2:-2, 2:-2]
    return range_of(np.ascontiguousarray(smooth))
