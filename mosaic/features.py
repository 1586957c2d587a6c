"""Keypoints of a frame, spread evenly over the picture, with descriptors that compare by dot product."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Picture

MAX_DETECTION_SIDE_PX = 2400  # larger frames are reduced for detection: descriptors gain nothing from more
_CELLS = 24  # along the longer side: each cell gives its strongest keypoints only


@dataclasses.dataclass(frozen=True)
class Features:
    """Keypoints as pixels (n, 2) of the frame and RootSIFT descriptors (n, 128), unit length, float32."""

    pixels: FloatArray
    descriptors: NDArray[np.float32]

    def __post_init__(self) -> None:
        if len(self.pixels) != len(self.descriptors):  # the matching kernel trusts this
            raise ValueError(f"{len(self.pixels)} keypoints and {len(self.descriptors)} descriptors")

    def __len__(self) -> int:
        return len(self.pixels)


def find_features(picture: Picture, allowed: NDArray[np.uint8] | None, most: int) -> Features:
    """SIFT keypoints (Lowe 2004) with RootSIFT descriptors (Arandjelovic & Zisserman 2012).

    Parameters
    ----------
    picture
        The frame (h, w, c): uint8, uint16 or linear float32.
    allowed
        Mask (h, w): keypoints only where it is not zero; None for everywhere.
    most
        Keep about this many: the strongest of each cell of a grid.
    """
    grey = _grey(picture)
    factor = min(1.0, MAX_DETECTION_SIDE_PX / max(grey.shape))
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        if allowed is not None:
            allowed = cv2.resize(allowed, grey.shape[::-1], interpolation=cv2.INTER_NEAREST)
    # Without precise upscaling every keypoint is a quarter of a pixel off, thirty times the rotation error.
    sift = cv2.SIFT_create(nfeatures=4 * most, contrastThreshold=0.02, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(grey, allowed)
    if not keypoints:
        return Features(np.empty((0, 2)), np.empty((0, 128), np.float32))
    at = np.array([k.pt for k in keypoints], float)
    response = np.array([k.response for k in keypoints])
    chosen = _spread(at, response, max(grey.shape) / _CELLS, most)
    root = np.sqrt(descriptors[chosen] / np.maximum(descriptors[chosen].sum(1, keepdims=True), 1e-12))
    scale = np.array([grey.shape[1] / picture.shape[1], grey.shape[0] / picture.shape[0]])
    return Features((at[chosen] + 0.5) / scale - 0.5, np.ascontiguousarray(root, np.float32))


def _grey(picture: Picture) -> NDArray[np.uint8]:
    """8-bit grey for detection only; float pictures are toned by their 99.5th percentile and a square root."""
    colour = picture[..., :3].mean(-1) if picture.shape[2] >= 3 else picture[..., 0]
    if picture.dtype == np.uint8:
        return np.round(colour).astype(np.uint8)
    if picture.dtype == np.uint16:
        return np.round(colour / 257.0).astype(np.uint8)
    light = np.nan_to_num(np.maximum(colour, 0.0), nan=0.0, posinf=0.0)
    white = max(float(np.percentile(light, 99.5)), 1e-9)
    return np.round(255 * np.sqrt(np.minimum(light / white, 1.0))).astype(np.uint8)


def _spread(at: FloatArray, response: FloatArray, cell: float, most: int) -> NDArray[np.intp]:
    """Indices of about `most` keypoints: round after round, the next strongest of every cell."""
    key = (at // cell).astype(np.int64)
    label = key[:, 1] * 100_000 + key[:, 0]
    order = np.lexsort((at[:, 1], at[:, 0], -response, label))
    start = np.concatenate([[0], np.flatnonzero(np.diff(label[order])) + 1])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.append(start, len(order))))
    by_rank = order[np.lexsort((-response[order], rank))]
    return np.sort(by_rank[:most])
