"""Keypoints of a frame, spread evenly over the picture, with descriptors that compare by dot product."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.conformal import conformal_view, is_wide
from fullsphere.mosaic.project import Picture

_AREA_PER_KEYPOINT_PX = 400  # a larger picture is reduced: more of it gives more keypoints than are kept
_MAX_AREA_PX = 4_000_000  # descriptors gain nothing from more
_DETECTED = 2  # times as many as are kept are described: half of a keypoint's time goes there
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


def find_features(
    picture: Picture, allowed: NDArray[np.uint8] | None, most: int, camera: Camera | None = None
) -> Features:
    """SIFT keypoints (Lowe 2004) with RootSIFT descriptors (Arandjelovic & Zisserman 2012).

    Parameters
    ----------
    picture
        The frame (h, w, c): uint8, uint16 or linear float32.
    allowed
        Mask (h, w): keypoints only where it is not zero; None for everywhere.
    most
        Keep about this many: the strongest of each cell of a grid.  The picture is reduced to what gives so many.
    camera
        That took the frame: wide pictures are looked at in a conformal view.  None to look at the picture as it is,
        which is better than a view by a lens that is only guessed.
    """
    none = Features(np.empty((0, 2)), np.empty((0, 128), np.float16))
    most_px = min(_AREA_PER_KEYPOINT_PX * most, _MAX_AREA_PX)
    light = _light(picture)
    if camera is not None and is_wide(camera):
        view = conformal_view(light, allowed, camera, most_px)
        found = None if view is None else _detected(view.light, view.inside, picture.dtype, most, conformal=True)
        if view is None or found is None:
            return none
        pixels, scale = view.in_frame(found.pixels)
    else:
        window = _window(allowed, light.shape)
        if window is None:
            return none
        light = light[window]
        reduced, inside = _reduced(light, None if allowed is None else allowed[window], most_px)
        found = _detected(reduced, inside, picture.dtype, most, conformal=False)
        if found is None:
            return none
        both = np.array(light.shape[::-1]) / reduced.shape[::-1]
        pixels = (found.pixels + 0.5) * both - 0.5 + [window[1].start, window[0].start]
        scale = np.full(len(found), both.mean())
    return _spread(dataclasses.replace(found, pixels=pixels, sigma_px=found.sigma_px * scale), picture.shape, most)


def _reduced(
    light: NDArray[np.float32], inside: NDArray[np.uint8] | None, most_px: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8] | None]:
    """Both so much smaller that no more than about `most_px` of them are allowed."""
    factor = (most_px / (light.size if inside is None else cv2.countNonZero(inside))) ** 0.5
    if factor >= 1:
        return light, inside
    size = max(1, round(light.shape[1] * factor)), max(1, round(light.shape[0] * factor))
    # Given a factor instead of a size OpenCV steps by it, and the last pixels are not those of the picture's end.
    light = np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), np.float32)
    return light, None if inside is None else cv2.resize(inside, size, interpolation=cv2.INTER_NEAREST)


def _detected(
    light: NDArray[np.float32], inside: NDArray[np.uint8] | None, dtype: np.dtype[Any], most: int, conformal: bool
) -> Features | None:
    """Keypoints of a picture in its own pixels; None if it has none."""
    # Without precise upscaling every keypoint is a quarter of a pixel off, thirty times the rotation error.
    sift = cv2.SIFT_create(nfeatures=_DETECTED * most, contrastThreshold=_WEAK_CONTRAST, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(_toned(light, inside, dtype), inside)
    if not keypoints:
        return None
    at = np.array([k.pt for k in keypoints], float)
    size, response = np.array([[k.size, k.response] for k in keypoints]).T
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-12))
    return Features(at, root.astype(np.float16), localisation_px(size, conformal), response)


def localisation_px(size_px: FloatArray, conformal: bool) -> FloatArray:
    """Standard deviation of a SIFT keypoint's coordinates, from its size (as OpenCV tells it) in the same pixels.

    As measured on rendered frames of known turns.  It grows with the size of what is found, and twice as fast in wide
    pictures as they are, because large things change their shape most.
    """
    return np.hypot(0.06, (0.014 if conformal else 0.03) * size_px)


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
    share = np.clip(light / np.float32(white), 0, 1)  # beside a lamp that is resampled light may be less than none
    if dtype != np.uint8:
        median = min(max(float(np.median(sample)) / white, 1e-4), 1.0)
        power = 1.0 if median >= _MIDDLE else max(np.log(_MIDDLE) / np.log(median), 0.4)
        share **= np.float32(power)
    grey: NDArray[np.uint8] = np.round(255 * share).astype(np.uint8)
    return grey


def _spread(features: Features, shape: tuple[int, ...], most: int) -> Features:
    """About `most` of the keypoints: round after round, the next strongest of every cell of the frame (h, w, ...).

    Weak ones come last, but for the first of a cell.  Those whose place in the frame is not known are left out.
    """
    features = features.where(np.isfinite(features.pixels[:, 0]))
    at, response = features.pixels, features.response
    key = (at // (max(shape[:2]) / _CELLS)).astype(np.int64)
    label = key[:, 1] * 100_000 + key[:, 0]
    order = np.lexsort((at[:, 1], at[:, 0], -response, label))
    start = np.concatenate([[0], np.flatnonzero(np.diff(label[order])) + 1])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.append(start, len(order))))
    late = (response[order] < _CONTRAST / _LAYERS) & (rank >= _WEAK_OF_CELL)
    by_rank = order[np.lexsort((-response[order], rank, late))]
    return features.where(np.sort(by_rank[:most]))
