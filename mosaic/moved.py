"""Where frames that look the same way saw different things: what moved between them must not be cut in two.

Three frames or more outvote the one that saw something else.  Where two disagree, or things that moved overlap, a
connected region of strong disagreement goes to one frame as a whole.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.seam_kernels import deviations, middle
from fullsphere.mosaic.sphere_pyramid import latitudes

_CLEAR = 40  # coded light, summed over three channels: less is left to the seams
_OF_NORMAL = 5.0  # times what four fifths of the sphere stay below
_OF_TEXTURE = 0.5  # of the contrast around a pixel: what is not quite in register differs so much
_SMALLEST = 4  # pixels that differ clearly
_LARGEST = 0.5  # steradian: no single thing is larger
_EVIDENT = 0.25  # of the disagreement itself
_POOR = 0.2  # of the best quality
_OUTVOTED, _FORCED = 50.0, 3e5  # costs per steradian: for a unit of coded light, and for what another frame is to own


class Moved(NamedTuple):
    """What moved: cost (K, H, W) per steradian of giving a pixel to a frame, and owners (H, W), -1 where left open."""

    cost: NDArray[np.float32]
    owner: NDArray[np.int16]


def what_moved(light: NDArray[np.int16], quality: NDArray[np.float32], preference: NDArray[np.intp]) -> Moved:
    """Look for disagreement between frames on a working sphere.

    Parameters
    ----------
    light
        (K, H, W, 3) coded so that equal steps look equal.
    quality
        (K, H, W) 0 where a frame does not see.
    preference
        The frames (K,), those first that win where nothing else decides.
    """
    low = np.stack([_around(one, seen > 0, cv2.erode) for one, seen in zip(light, quality, strict=True)])
    high = np.stack([_around(one, seen > 0, cv2.dilate) for one, seen in zip(light, quality, strict=True)])
    mid, count = middle(light, quality)
    mid_low, mid_high = (_around(mid, count > 0, function) for function in (cv2.erode, cv2.dilate))
    single, any_two = deviations(light, low, high, quality, mid, mid_low, mid_high, count)

    for pole in (0, -1):  # one place
        single[:, pole] = single[:, pole].max(1, keepdims=True)
        any_two[pole] = any_two[pole].max()
    height, width = any_two.shape
    contrast = high.sum(-1, dtype=np.int32) - low.sum(-1, dtype=np.int32)
    texture = np.where(quality > 0, contrast, 2**15).min(0)
    normal = float(np.quantile(any_two[count > 1], 0.8)) if (count > 1).any() else 0.0
    clear = (max(_CLEAR, _OF_NORMAL * normal) + _OF_TEXTURE * texture).astype(np.float32)
    cost = np.float32(_OUTVOTED) * np.maximum(single - clear / 2, 0)
    owner = np.full((height, width), -1, np.int16)
    regions, number = _regions(any_two, clear)
    area = np.cos(latitudes(height)) * (2 * math.pi / width) * (math.pi / height)
    if number == 0:
        return Moved(cost, owner)
    rim = regions > 0
    rim &= np.asarray(cv2.erode(_wrapped(rim.astype(np.uint8), 3), np.ones((7, 7), np.uint8)))[:, 3:-3] == 0
    for y, x in _each(regions, number):
        if area[y].sum() > _LARGEST:
            continue
        region = _Region(
            area[y],
            quality[:, y, x],
            single[:, y, x],
            any_two[y, x].astype(float),
            count[y, x],
            rim[y, x],
            contrast[:, y, x],
        )
        chosen = _chosen(region, preference)
        if chosen is not None:
            owner[y, x] = chosen
            cost[np.arange(len(cost)) != chosen, y[:, None], x[:, None]] = _FORCED
    return Moved(cost, owner)


class _Region(NamedTuple):
    """The n pixels of a region, in K frames."""

    area: FloatArray  # (n,)
    quality: NDArray[np.float32]  # (K, n)
    single: NDArray[np.int16]  # (K, n)
    any_two: FloatArray  # (n,)
    seen_by: NDArray[np.int16]  # (n,) how many frames
    rim: NDArray[np.bool_]  # (n,) where the contour of the region is
    contrast: NDArray[np.int32]  # (K, n)


def _chosen(region: _Region, preference: NDArray[np.intp]) -> int | None:
    """The frame that is to own a region: of those that see all of it the one which shows the scene without the thing.

    Of three frames the outvoted one shows the thing; of two the one that has a contour around the region.  Where this
    decides nothing, a fixed order of frames does: what is seen in two places in two frames then appears in one.
    """
    able = np.flatnonzero(((region.quality > 0) | (region.seen_by == 0)).all(1))
    if able.size == 0:
        return None
    two, more = region.seen_by == 2, region.seen_by > 2
    odd = np.zeros(len(able))
    if more.any():
        odd += np.average(region.single[able][:, more], 1, region.area[more]) * more.mean()
    if (two & region.rim).any():
        odd += np.average(region.contrast[able][:, two & region.rim], 1, region.area[two & region.rim]) * two.mean()
    strength = np.average(region.any_two, weights=region.area * (region.any_two > 0) + 1e-12)
    good = np.average(region.quality[able], 1, region.area)
    even = (odd <= odd.min() + _EVIDENT * strength) & (good >= _POOR * good.max())
    if not even.any():
        return int(able[np.argmin(odd)])
    if more.mean() > 0.5:
        return int(able[even][np.argmax(good[even])])
    rank = np.argsort(preference)
    return int(min(able[even], key=lambda k: rank[k]))


def _around(image: NDArray[np.int16], seen: NDArray[np.bool_], function: Callable[..., Any]) -> NDArray[np.int16]:
    """The least (erode) or largest (dilate) seen value around each pixel: one pixel each way, more near a pole."""
    least = function is cv2.erode
    result = image.copy()
    result[~seen] = 32767 if least else -32768
    result = _widened(result, function, 1, 1)
    height = len(image)
    cos = np.cos(latitudes(height))
    reach = 1
    while (near := cos < 0.7 / reach).any() and reach < image.shape[1] // 4:
        rows = int(np.count_nonzero(near)) // 2  # the same at both poles
        if rows:
            for part in (slice(0, rows), slice(height - rows, height)):
                result[part] = _widened(result[part], function, reach, 0)
        reach *= 2
    return result


def _widened(image: NDArray[np.int16], operation: Callable[..., Any], right: int, down: int) -> NDArray[np.int16]:
    whole = operation(
        _wrapped(image, right), np.ones((2 * down + 1, 2 * right + 1), np.uint8), borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(whole)[:, right:-right].astype(np.int16, copy=False)


def _regions(any_two: NDArray[np.int16], clear: NDArray[np.float32]) -> tuple[NDArray[np.int32], int]:
    """Connected regions of disagreement, a pixel wider than it: their numbers (H, W) from 1, 0 outside, and how many.

    What is half as clear belongs to a region that somewhere is clear.
    """
    wide = _wrapped((any_two > clear / 2).astype(np.uint8), 2)
    touched = np.asarray(cv2.dilate(wide, np.ones((5, 5), np.uint8)))[:, 2:-2]
    touched = touched.copy()
    for pole in (0, -1):
        touched[pole] = touched[pole].max()
    number, region = cv2.connectedComponents(touched, connectivity=8)
    pairs = []
    for shift in (-1, 0, 1):
        a, b = region[:, -1], np.roll(region[:, 0], shift)
        both = (a > 0) & (b > 0)
        if shift:
            both[0 if shift > 0 else -1] = False
        pairs.append((a[both], b[both]))
    rows, columns = np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
    joined = _joined(number, rows, columns)
    clear_in = np.bincount(joined[region[any_two > clear]], minlength=int(joined.max()) + 1) >= _SMALLEST
    clear_in[joined[0]] = False
    names = np.cumsum(clear_in) * clear_in
    return names[joined[region]].astype(np.int32), int(clear_in.sum())


def _each(regions: NDArray[np.int32], number: int) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """The pixels (y, x) of each region."""
    order = np.argsort(regions, axis=None, kind="stable")
    borders = np.searchsorted(regions.ravel()[order], np.arange(1, number + 2))
    for start, stop in itertools.pairwise(borders):
        y, x = np.unravel_index(order[start:stop], regions.shape)
        yield y, x


def _wrapped(image: NDArray[Any], columns: int) -> NDArray[Any]:
    """The picture with as many columns of its other side put to each side."""
    return np.concatenate([image[:, -columns:], image, image[:, :columns]], axis=1)


def _joined(number: int, rows: NDArray[np.int32], columns: NDArray[np.int32]) -> NDArray[np.int32]:
    """For each of so many regions the number (n,) of the one that it is a part of, by the pairs that are one."""
    if not len(rows):
        return np.arange(number, dtype=np.int32)
    from scipy.sparse import coo_array  # their import takes as long as all the rest here, and is seldom needed
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(number, number))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
