"""Who owns which direction: seams where frames agree, and each thing that moved in one frame, whole.

Alpha-expansion (Boykov, Veksler & Zabih, PAMI 2001) on the working sphere, coarse to fine: the whole graph at about
256 columns, then a narrow band around the seams at each finer size.  A seam costs what the two frames differ on both
its sides, times its length on the sphere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.max_flow import grid_neighbours, minimum_cut
from fullsphere.mosaic.moved import what_moved
from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.seam_kernels import best_frame, code_at, expansion, fill_nearest
from fullsphere.mosaic.sphere_pyramid import latitudes

_COARSEST = 256  # columns: below, things are lost
_MOVED = 512  # columns at which what moved is looked for
_PER_STOP = 64.0  # coded light
_UNIT = 4096.0  # of costs, which are whole numbers
_LOSS = 800.0  # cost per steradian of all quality lost, in coded light
_SHORT = 25  # cost of any seam, in coded light
_BAND = 3  # pixels to each side of a coarser seam
_WORTH = 0.3  # of the best quality: worse frames, near their rims, have no say
_MANY = 24  # frames, of which not all are needed
_NEARLY = 0.85  # of the best quality
_ROUNDS = 2


class _Level(NamedTuple):
    """The frames at one size: their light, each (H, W, 3), and quality (K, H, W)."""

    light: list[NDArray[np.float32]]
    quality: NDArray[np.float32]


def find_owners(overviews: Sequence[Overview], executor: Executor | None = None) -> NDArray[np.int16]:
    """The frame that owns each direction of the working sphere.

    Parameters
    ----------
    overviews
        The frames on the working sphere, all of one size (H, W).
    executor
        Frames are prepared side by side on it; the result does not depend on it.

    Returns
    -------
    (H, W) places in `overviews`.  Where nobody sees, the nearest owner; 0 everywhere if nobody sees anything.
    """
    height, width = overviews[0].quality.shape
    needed = _needed(overviews)
    overviews = [overviews[k] for k in needed]
    sizes = _sizes(height, width)
    scale = _middle_light(overviews)

    def prepared(one: Overview) -> list[Overview]:
        return _at_sizes(one, sizes)

    each = list(ordered_map(executor, prepared, overviews))
    levels = []
    for i in range(len(sizes)):
        quality = np.stack([one[i].quality for one in each])
        quality[quality < _WORTH * quality.max(0)] = 0
        levels.append(_Level([one[i].light for one in each], quality))
    owner = np.full(sizes[0], -1, np.int16)
    best_frame(levels[0].quality, owner)
    shares = np.array([np.count_nonzero(owner == k, 1) @ _area(*sizes[0]) for k in range(len(overviews))])
    preference = np.argsort(-shares, kind="stable")

    look = max(i for i, (_, columns) in enumerate(sizes) if columns <= _MOVED or i == 0)
    everywhere = np.ones(sizes[look], bool)
    moved = what_moved(_features(levels[look], everywhere, scale, executor)[..., :3], levels[look].quality, preference)
    every = sizes[look][0] // sizes[0][0]
    owner = np.where((moved.owner >= 0)[::every, ::every] & (owner >= 0), moved.owner[::every, ::every], owner)
    for i, level in enumerate(levels):
        if i:
            owner = np.repeat(np.repeat(owner, 2, 0), 2, 1)
        free = _band(owner, _BAND) if i else np.ones_like(owner, bool)
        _settle(owner, level.quality, free)
        features = _features(level, _widened(free, 2), scale, executor)
        _expand(owner, features, level.quality, _at_size(moved.cost, sizes[i]), free, preference, whole=i == 0)
    lat = latitudes(height)
    fill_nearest(owner, np.sin(lat), np.cos(lat), np.cos(np.arange(width) * (2 * math.pi / width)))
    _to_who_sees(owner, overviews)
    return np.array(needed, np.int16)[np.maximum(owner, 0)]


def _needed(overviews: Sequence[Overview]) -> list[int]:
    """The frames to choose from: all of some, of many those that hardly leave a direction worse off.

    A hundred frames a degree apart would be cut into slivers, in a long time.
    """
    if len(overviews) <= _MANY:
        return list(range(len(overviews)))
    height = len(overviews[0].quality)
    step = max(1, height // 32)
    coarse = np.stack([one.quality[step // 2 :: step, step // 2 :: step] for one in overviews])
    good = (coarse > 0) & (coarse >= _NEARLY * coarse.max(0))
    weight = np.cos(latitudes(height))[step // 2 :: step]
    left, taken = good.any(0) * weight[:, None], []
    while left.any():
        taken.append(int(np.argmax((good * left).sum((1, 2)))))
        left[good[taken[-1]]] = 0
    # Slivers between the places looked at: whatever anybody sees is seen by somebody taken.
    unseen = ~np.logical_or.reduce([overviews[k].seen for k in taken], axis=0, initial=False)
    for k, one in enumerate(overviews):
        if (one.seen & unseen).any():
            taken.append(k)
            unseen &= ~one.seen
    return sorted(set(taken)) or [0]


def _sizes(height: int, width: int) -> list[tuple[int, int]]:
    """The sizes (H, W) to work at, the coarsest first, each half the next."""
    sizes = [(height, width)]
    while sizes[0][1] >= 2 * _COARSEST and sizes[0][0] % 2 == 0 and sizes[0][1] % 4 == 0:
        sizes.insert(0, (sizes[0][0] // 2, sizes[0][1] // 2))
    return sizes


def _at_size(cost: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """The cost (K, h, w), averaged if the size is smaller; kernels look a smaller one up."""
    if cost.shape[1] <= size[0]:
        return cost
    return np.stack([np.asarray(cv2.resize(one, size[::-1], interpolation=cv2.INTER_AREA)) for one in cost])


def _area(height: int, width: int) -> NDArray[np.float64]:
    """Steradians of a pixel of each row (H,)."""
    edge = np.sin((0.5 - np.arange(height + 1) / height) * math.pi)
    return (edge[:-1] - edge[1:]) * (2 * math.pi / width)


def _middle_light(overviews: Sequence[Overview]) -> float:
    """The median light of what is seen, from which on differences are seen as ratios."""
    few = [one.light[4::8].mean(-1)[one.quality[4::8] > 0] for one in overviews]
    light = np.concatenate(few)
    light = light[light > 0]
    return float(np.median(light)) if light.size else 1.0


def _at_sizes(one: Overview, sizes: list[tuple[int, int]]) -> list[Overview]:
    """A frame at each of the sizes, its poles one place each."""
    light, quality = one.light, one.quality
    levels = []
    for height, _ in reversed(sizes):
        if height != len(quality):
            seen = _halved((quality > 0).astype(np.float32)) > 0.999
            light, quality = _halved(light), np.where(seen, _halved(quality), np.float32(0))
        light, quality = light.copy(), quality.copy()
        for pole in (0, -1):
            light[pole] = light[pole].mean(0, np.float64)
            quality[pole] = quality[pole].mean(dtype=np.float64) if (quality[pole] > 0).all() else 0
        levels.append(Overview(light, quality))
    return levels[::-1]


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    half = (image.shape[1] // 2, image.shape[0] // 2)
    return np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA))


def _features(level: _Level, needed: NDArray[np.bool_], scale: float, executor: Executor | None) -> NDArray[np.int16]:
    """What differences are taken of (K, H, W, 5), where it is needed; elsewhere anything."""
    features = np.empty((*level.quality.shape, 5), np.int16)

    def code(k: int) -> None:
        code_at(level.light[k], level.quality[k], needed, np.float32(1 / scale), np.float32(_PER_STOP), features[k])

    for _ in ordered_map(executor, code, range(len(features))):
        pass
    return features


def _band(owner: NDArray[np.int16], reach: int) -> NDArray[np.bool_]:
    """The pixels near a seam or near where nobody sees; a pole is in it wholly or not."""
    seam = owner != np.roll(owner, -1, 1)
    seam[:-1] |= owner[:-1] != owner[1:]
    band = _widened(seam, reach)
    for pole in (0, -1):
        band[pole] = band[pole].any()
    return band


def _widened(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """The mask and what is near it, past the edge of the sphere too."""
    wide = np.concatenate([mask[:, -reach:], mask, mask[:, :reach]], 1).astype(np.uint8)
    return np.asarray(cv2.dilate(wide, np.ones((2 * reach + 1,) * 2, np.uint8)))[:, reach:-reach] > 0


def _settle(owner: NDArray[np.int16], quality: NDArray[np.float32], free: NDArray[np.bool_]) -> None:
    """Take away what its owner does not see, and give what nobody owns to the best; what is given anew is free."""
    seen = np.take_along_axis(quality, np.maximum(owner, 0)[None].astype(np.intp), 0)[0] > 0
    owner[~seen] = -1
    anew = owner < 0
    best_frame(quality, owner)
    free |= anew
    free &= owner >= 0


def _to_who_sees(owner: NDArray[np.int16], overviews: Sequence[Overview]) -> None:
    """Give to the best what its owner does not see and another does: parts of a pole's row, and far in a rim."""
    lost = np.ones_like(owner, bool)
    for k, one in enumerate(overviews):
        lost &= (owner != k) | ~one.seen
    y, x = np.nonzero(lost)
    if y.size:
        quality = np.stack([one.quality[y, x] for one in overviews])
        owner[y, x] = np.where(quality.max(0) > 0, quality.argmax(0), owner[y, x])


def _expand(
    owner: NDArray[np.int16],
    features: NDArray[np.int16],
    quality: NDArray[np.float32],
    penalty: NDArray[np.float32],
    free: NDArray[np.bool_],
    preference: NDArray[np.intp],
    whole: bool,
) -> None:
    """Let each frame that owns something gain what pays, until nothing changes or some rounds are over."""
    height, width = owner.shape
    area = _area(height, width) * _UNIT
    edges = np.cos((0.5 - np.arange(1, height + 1) / height) * math.pi)
    across = np.rint(np.maximum(edges, 0) * (2 * math.pi / width) * _UNIT).astype(np.int32)
    along = round(math.pi / height * _UNIT)
    present = np.bincount(owner[owner >= 0], minlength=len(quality)) > 0
    waiting = [int(k) for k in preference if present[k]]
    fruitless = 0
    for _ in range(_ROUNDS):
        for alpha in waiting:
            if fruitless >= len(waiting):
                return
            fruitless += 1
            may = free & (quality[alpha] > 0) & (owner != alpha)
            if not whole:
                may &= _widened(owner == alpha, 2 * _BAND)
                for row in (0, -1):
                    may[row] = may[row].all()
            pixels, neighbours = grid_neighbours(may)
            if pixels.size == 0:
                continue

            terminal, capacity = expansion(
                owner,
                alpha,
                pixels,
                neighbours,
                features,
                quality,
                penalty,
                area,
                along,
                across,
                _LOSS,
                _SHORT,
            )
            gained = pixels[minimum_cut(terminal, capacity, neighbours).sink]
            if gained.size:
                owner.reshape(-1)[gained] = alpha
                fruitless = 0
