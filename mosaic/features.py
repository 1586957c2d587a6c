"""Keypoints of a frame, spread evenly over the picture, with descriptors that compare by dot product."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Picture

_AREA_PER_KEYPOINT_PX = 400  # a larger picture is reduced: more of it gives more keypoints than are kept
_MAX_AREA_PX = 4_000_000  # descriptors gain nothing from more
_CELLS = 24  # along the longer side: each cell gives its strongest keypoints only
_CONTRAST, _WEAK_CONTRAST = 0.04, 0.02  # weaker keypoints are less exact: they fill up where strong ones are few
_LAYERS = 3  # of an octave, OpenCV's default: it compares the response with the contrast divided by them
_WEAK_OF_CELL = 2  # weak keypoints of a cell that count as much as strong ones, so that no part is left empty
_BRIGHT = 99.5  # percentile of the grey values that becomes white
_MIDDLE = 0.4  # share of white that the median becomes, where it is darker
_WHITE_8_BIT = 10.0  # no 8-bit picture is stretched further than from here


def _unknown() -> FloatArray:
    return np.empty(0)


@dataclasses.dataclass(frozen=True)
class Features:
    """Keypoints of a frame.

    Attributes
    ----------
    pixels
        Where they are in the frame (n, 2).
    descriptors
        RootSIFT (n, 128), of unit length; float16 takes half the memory of float32 and matches as well.
    sigma_px
        Standard deviation (n,) of each coordinate, in pixels of the frame; empty where it is not known.
    response
        Contrast (n,) of each keypoint, in shares of white; empty where it is not known.
    """

    pixels: FloatArray
    descriptors: NDArray[np.float16] | NDArray[np.float32]
    sigma_px: FloatArray = dataclasses.field(default_factory=_unknown)
    response: FloatArray = dataclasses.field(default_factory=_unknown)

    def __post_init__(self) -> None:
        if len(self.pixels) != len(self.descriptors):  # the matching kernel trusts this
            raise ValueError(f"{len(self.pixels)} keypoints and {len(self.descriptors)} descriptors")

    def __len__(self) -> int:
        return len(self.pixels)

    def where(self, chosen: NDArray[Any]) -> Features:
        """Those that are chosen, by index or by mask."""
        known = {name: getattr(self, name)[chosen] for name in ("sigma_px", "response") if getattr(self, name).size}
        return Features(self.pixels[chosen], self.descriptors[chosen], **known)


def find_features(picture: Picture, allowed: NDArray[np.uint8] | None, most: int) -> Features:
    """SIFT keypoints (Lowe 2004) with RootSIFT descriptors (Arandjelovic & Zisserman 2012).

    They are looked for in the picture as it is, a fisheye's too: up to its rim it is nearly conformal, and what is
    turned within it stays alike.

    Parameters
    ----------
    picture
        The frame (h, w, c): uint8, uint16 or linear float32.
    allowed
        Mask (h, w): keypoints only where it is not zero; None for everywhere.
    most
        Keep about this many: the strongest of each cell of a grid.  The picture is reduced to what gives so many.
    """
    none = Features(np.empty((0, 2)), np.empty((0, 128), np.float16))
    window = _window(allowed, picture.shape[:2])
    if window is None:
        return none
    part, inside = picture[window], None if allowed is None else allowed[window]
    light = _light(part)
    area = light.size if inside is None else cv2.countNonZero(inside)
    factor = min(1.0, (min(_AREA_PER_KEYPOINT_PX * most, _MAX_AREA_PX) / area) ** 0.5)
    if factor < 1:
        size = tuple(max(1, round(side * factor)) for side in light.shape[::-1])
        light = cv2.resize(light, size, interpolation=cv2.INTER_AREA)  # given a factor it steps by that, past the rim
        if inside is not None:
            inside = cv2.resize(inside, size, interpolation=cv2.INTER_NEAREST)
    grey = _toned(light, inside, picture.dtype)
    # Without precise upscaling every keypoint is a quarter of a pixel off, thirty times the rotation error.
    sift = cv2.SIFT_create(nfeatures=4 * most, contrastThreshold=_WEAK_CONTRAST, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(grey, inside)
    if not keypoints:
        return none
    at = np.array([k.pt for k in keypoints], float)
    size, response = np.array([[k.size, k.response] for k in keypoints]).T
    chosen = _spread(at, response, max(grey.shape) / _CELLS, most)
    root = np.sqrt(descriptors[chosen] / np.maximum(descriptors[chosen].sum(1, keepdims=True), 1e-12))
    scale = np.array([grey.shape[1] / part.shape[1], grey.shape[0] / part.shape[0]])
    corner = [window[1].start, window[0].start]
    return Features(
        (at[chosen] + 0.5) / scale - 0.5 + corner,
        root.astype(np.float16),
        localisation_px(size[chosen]) / scale.mean(),
        response[chosen],
    )


def localisation_px(size_px: FloatArray) -> FloatArray:
    """Standard deviation of a SIFT keypoint's coordinates, from its size (as OpenCV tells it) in the same pixels.

    As measured on rendered frames of known turns; it grows with the size of what is found.
    """
    return np.hypot(0.06, 0.03 * size_px)


def _window(allowed: NDArray[np.uint8] | None, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns outside which nothing is allowed; None if nothing is."""
    if allowed is None:
        return slice(0, shape[0]), slice(0, shape[1])
    rows, columns = np.flatnonzero(allowed.any(1)), np.flatnonzero(allowed.any(0))
    if not rows.size:
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _light(picture: Picture) -> NDArray[np.float32]:
    """Mean of the colours (h, w), in the picture's own units."""
    colour = np.ascontiguousarray(picture[..., : 3 if picture.shape[2] >= 3 else 1], np.float32)
    if colour.shape[2] == 1:
        light: NDArray[np.float32] = colour[..., 0]
    else:
        light = cv2.transform(colour, np.full((1, 3), 1 / 3, np.float32))
    np.nan_to_num(light, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return np.maximum(light, 0, out=light)


def _toned(light: NDArray[np.float32], inside: NDArray[np.uint8] | None, dtype: np.dtype[Any]) -> NDArray[np.uint8]:
    """8-bit grey for detection only, so that dark frames show as much as bright ones.

    The brightest percentile becomes white.  Pictures of more than 8 bits may hold linear light: where the median is
    dark, a power lifts it.
    """
    sample = light[::4, ::4] if inside is None else light[::4, ::4][inside[::4, ::4] > 0]
    if not sample.size:
        sample = light
    white = max(float(np.percentile(sample, _BRIGHT)), _WHITE_8_BIT if dtype == np.uint8 else 1e-9)
    share = np.minimum(light / np.float32(white), 1)
    if dtype != np.uint8:
        median = min(max(float(np.median(sample)) / white, 1e-4), 1.0)
        power = 1.0 if median >= _MIDDLE else max(np.log(_MIDDLE) / np.log(median), 0.4)
        share **= np.float32(power)
    grey: NDArray[np.uint8] = np.round(255 * share).astype(np.uint8)
    return grey


def _spread(at: FloatArray, response: FloatArray, cell: float, most: int) -> NDArray[np.intp]:
    """Indices of about `most` keypoints: round after round, the next strongest of every cell.

    Weak ones come last, but for the first of a cell.
    """
    key = (at // cell).astype(np.int64)
    label = key[:, 1] * 100_000 + key[:, 0]
    order = np.lexsort((at[:, 1], at[:, 0], -response, label))
    start = np.concatenate([[0], np.flatnonzero(np.diff(label[order])) + 1])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.append(start, len(order))))
    late = (response[order] < _CONTRAST / _LAYERS) & (rank >= _WEAK_OF_CELL)
    by_rank = order[np.lexsort((-response[order], rank, late))]
    return np.sort(by_rank[:most])
