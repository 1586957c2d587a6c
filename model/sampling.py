"""Reading a picture between its pixels."""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Interpolation = Literal["nearest", "linear", "cubic"]

INTERPOLATIONS: dict[str, int] = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
}
"""Interpolations by name."""

_CV_LIMIT = 32766  # cv2.remap refuses pictures with longer sides
_MARGIN = 4


def sample(image: NDArray[Any], pixels: NDArray[np.float32], interpolation: Interpolation) -> NDArray[Any]:
    """Values of `image` (H, W) or (H, W, c) at `pixels` (h, w, 2), in the image's type: (h, w) or (h, w, c).

    Past the border the nearest pixel answers; where a pixel is NaN the value is zero.
    """
    outside = np.isnan(pixels[..., 0])
    at = np.where(outside[..., None], np.float32(0), pixels) if outside.any() else pixels
    if max(image.shape[:2]) > _CV_LIMIT:
        image, at = _window(image, at, outside)
    values = cv2.remap(image, at, None, INTERPOLATIONS[interpolation], borderMode=cv2.BORDER_REPLICATE)
    values = np.asarray(values).reshape(*outside.shape, *image.shape[2:])  # OpenCV drops the axis of a single channel
    values[outside] = 0
    return values


def _window(
    image: NDArray[Any], at: NDArray[np.float32], outside: NDArray[np.bool_]
) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """The part of a picture too large for OpenCV that is asked for, and the positions in it."""
    height, width = image.shape[:2]
    inner = at[~outside]
    if inner.size == 0:
        return image[:1, :1], np.zeros_like(at)
    low = np.clip(np.floor(inner.min(0)).astype(int) - _MARGIN, 0, [width - 1, height - 1])
    high = np.clip(np.ceil(inner.max(0)).astype(int) + _MARGIN + 1, low + 1, [width, height])
    return np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), at - low.astype(np.float32)


def smoothed(image: NDArray[Any], ratio: float) -> NDArray[Any]:
    """The picture with the detail taken out that a target of `ratio` times coarser pixels cannot show.

    A Gaussian as wide as the coarser pixel less the finer one; the geometry is untouched.  Below a ratio of 1.05 the
    picture itself is returned.
    """
    if ratio <= 1.05:
        return image
    sigma = 0.45 * float(np.sqrt(ratio**2 - 1))
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)).reshape(image.shape)
