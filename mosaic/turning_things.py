"""What turns with the camera: a strap, the photographer's shoes, the arm of a head.

It stands at the same pixels of every frame, though the scene behind has turned on.  A plain sky or an evenly lit wall
is the same in every frame too, but there the other frames that look the same way see the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.overview import Overview

_SIDE = 192  # pixels of the longer side on which it is looked for
_MOST = 10  # frames that are compared
_LEAST = 3
_PER_STOP = 64.0
_CLEAR = 60.0  # coded light, summed over three channels: what other frames see differs at least so much
_CONSTANT = 0.35  # of that difference, at most, the pixel differs from frame to frame
_RINGS = 30  # of angles from the axis
_IN_MOST = 0.7  # of the frames
_EDGE = 30.0  # coded light, summed over three channels, from pixel to pixel
_FIRST, _FINALLY = 0.12, 0.6  # share of a zone that other frames contradict
_SMALLEST = 8  # pixels
_LARGEST = 0.25  # of the picture
_MORE = 20  # pixels around what is found that are looked at again
_ROUNDS = 4


def turning_things(
    overviews: Sequence[Overview],
    camera_from_world: Sequence[FloatArray] | FloatArray,
    camera: Camera,
    executor: Executor | None = None,
) -> NDArray[np.bool_] | None:
    """Find the pixels of a camera that show the same thing in every frame, hiding the scene.

    Parameters
    ----------
    overviews
        Registered frames of this camera on the working sphere.
    camera_from_world
        Their orientations, (3, 3) each.
    camera
        Its picture is that of the frames.
    executor
        Frames are compared side by side on it; the result does not depend on it.

    Returns
    -------
    (h, w) of the camera's size, true where something turns with it; None if nothing does, or if fewer than three frames
    overlap so that it cannot be told.
    """
    used = range(0, len(overviews), max(1, -(-len(overviews) // _MOST)))
    if len(used) < _LEAST:
        return None
    scale = _middle_light([overviews[k] for k in used])
    coded = ordered_map(executor, lambda k: _coded(overviews[k], scale), used)
    views = [_View(one, np.asarray(camera_from_world[k])) for one, k in zip(coded, used, strict=True)]
    width, height = camera.size
    factor = max(1.0, max(width, height) / _SIDE)
    small = (round(width / factor), round(height / factor))
    u, v = ((np.arange(n) + 0.5) * whole / n - 0.5 for n, whole in zip(small, (width, height), strict=True))
    table = tabulate(camera, 1e-2)
    rays = table.unproject(np.stack(np.meshgrid(u, v), -1))

    found = np.zeros(small[::-1], np.uint8)
    own, differences = _compared(views, rays, table, found, executor)
    trend = _around_the_axis(differences, rays)
    zones = _zones(own)
    found = _hidden(zones, _contradicted(own, differences, trend, by_half=False), _FIRST)
    for _ in range(_ROUNDS):
        if not found.any():
            return None
        # Where things of several frames lie in one direction they confirm each other, until some of them are known.
        rows, columns = _window(found)
        own, differences = _compared(views, rays[rows, columns], table, found, executor)
        contradicted = np.zeros_like(found)
        contradicted[rows, columns] = _contradicted(own, differences, trend[rows, columns], by_half=True)
        before, found = found, _hidden(zones, contradicted, _FINALLY)
        if np.array_equal(before, found):
            break
    if not found.any():
        return None
    return np.asarray(cv2.resize(_wider(found), camera.size, interpolation=cv2.INTER_NEAREST)) > 0


class _View(NamedTuple):
    """A frame: coded light on the working sphere (H, W, 3), NaN where it does not see, and its orientation (3, 3)."""

    coded: NDArray[np.float32]
    camera_from_world: FloatArray


def _compared(
    views: Sequence[_View], rays: FloatArray, table: RayTable, things: NDArray[np.uint8], executor: Executor | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What each frame shows along rays of the camera, (n, h, w, 3), less what each other shows, (n, n - 1, h, w, 3).

    What others show of known `things` (of the camera's picture made small) does not count; NaN where nothing does.
    """
    ratio = np.array([things.shape[1] / table.size[0], things.shape[0] / table.size[1]])

    def compared(n: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        in_world = rays @ views[n].camera_from_world
        places = _places(in_world, *views[n].coded.shape[:2])
        own, less = _at(views[n].coded, places), []
        for k, other in enumerate(views):
            if k == n:
                continue
            values = own - _at(other.coded, places)
            if things.any():
                pixels = table.project(in_world, other.camera_from_world)
                at = np.nan_to_num((pixels + 0.5) * ratio).astype(np.intp)
                at = np.clip(at, 0, np.array(things.shape[::-1]) - 1)
                values[things[at[..., 1], at[..., 0]] > 0] = np.nan
            less.append(values)
        return own, np.stack(less)

    pairs = list(ordered_map(executor, compared, range(len(views))))
    return np.stack([own for own, _ in pairs]), np.stack([less for _, less in pairs])


def _middle_light(overviews: Sequence[Overview]) -> float:
    lit = np.concatenate([one.light[::3, ::3][one.seen[::3, ::3]].ravel() for one in overviews])
    return (float(np.median(lit)) if lit.size else 0.0) or 1.0


def _coded(one: Overview, scale: float) -> NDArray[np.float32]:
    """Logarithmic light (H, W, 3), NaN where the frame does not see."""
    light = np.maximum(one.light, np.float32(0)) / np.float32(scale)
    coded = np.log2(light + np.float32(0.125)) * np.float32(_PER_STOP)
    return np.where(one.seen[..., None], coded, np.float32(np.nan))


class _Places(NamedTuple):
    """Columns and rows (h, w) of a padded picture of the sphere, and where there is none (h, w)."""

    column: NDArray[np.float32]
    row: NDArray[np.float32]
    outside: NDArray[np.bool_]


def _places(rays: FloatArray, height: int, width: int) -> _Places:
    """Where a picture of the sphere shows rays (h, w, 3), which are NaN where the camera does not look."""
    outside = np.isnan(rays[..., 0])
    x, y, z = np.moveaxis(np.where(outside[..., None], (0.0, 0.0, 1.0), rays), -1, 0)
    column = (np.arctan2(x, z) / (2 * math.pi) + 0.5) * width - 0.5
    row = (0.5 + np.arcsin(np.clip(y, -1, 1)) / math.pi) * height - 0.5
    return _Places((column + 1).astype(np.float32), row.astype(np.float32), outside)


def _at(coded: NDArray[np.float32], places: _Places) -> NDArray[np.float32]:
    """The picture of the sphere (H, W, 3) at places (h, w); NaN where there is none."""
    padded = cv2.copyMakeBorder(coded, 0, 0, 1, 1, cv2.BORDER_WRAP)
    values = np.asarray(cv2.remap(padded, places.column, places.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    values[places.outside] = np.nan
    return values


def _median(values: NDArray[np.float32], upper: bool = False) -> NDArray[np.float32]:
    """Of (n, ...) over the first axis; of an even number the lower or the upper; NaN only where all are."""
    ranked, count = np.sort(values, axis=0), np.isfinite(values).sum(0)
    place = np.where(count > 0, (count if upper else count - 1) // 2, 0)
    return np.asarray(np.take_along_axis(ranked, place[None], 0)[0])


def _around_the_axis(differences: NDArray[np.float32], rays: FloatArray) -> NDArray[np.float32]:
    """The usual difference (h, w, 3) of frames (n, n - 1, h, w, 3) from others at the same angle from the axis.

    What is left of vignetting is constant in the camera too; it goes all around, which things do not.
    """
    signed = np.stack([_median(one) for one in differences])
    theta = np.nan_to_num(np.arccos(np.clip(rays[..., 2], -1, 1)))
    ring = np.minimum(theta / max(theta.max(), 1e-9) * _RINGS, _RINGS - 1).astype(int)
    trend = np.zeros(signed.shape[1:], np.float32)
    for k in range(_RINGS):
        there = signed[:, ring == k]
        known = there[np.isfinite(there[..., 0])]
        if len(known):
            trend[ring == k] = np.median(known, 0)
    return trend


def _contradicted(
    own: NDArray[np.float32], differences: NDArray[np.float32], trend: NDArray[np.float32], by_half: bool
) -> NDArray[np.uint8]:
    """Where frames show the same (h, w), 1 or 0, and most others (or half of them) say that it is not there."""
    off = np.stack([_median(np.abs(one - trend).sum(-1), upper=by_half) for one in differences])
    spread = _median(np.abs(own - _median(own)).sum(-1))
    compared = np.isfinite(off).sum(0)
    with np.errstate(invalid="ignore"):
        often = (compared >= _LEAST) & ((off > _CLEAR).sum(0) >= _IN_MOST * compared)
        return np.asarray(often & (spread < _CONSTANT * _median(off)), np.uint8)


def _zones(own: NDArray[np.float32]) -> NDArray[np.int32]:
    """The parts of the camera's picture (h, w) that edges leave apart which all frames share; from 1, 0 for the edges.

    A thing that turns along has an outline.  A place on a plain floor has none, even if other frames show something
    else there: their own view of the thing.
    """
    middle = _median(own)
    seen = np.isfinite(middle[..., 0])
    low = cv2.erode(np.where(seen[..., None], middle, np.float32(1e9)), np.ones((3, 3), np.uint8))
    high = cv2.dilate(np.where(seen[..., None], middle, np.float32(-1e9)), np.ones((3, 3), np.uint8))
    plain = seen & ((high - low).sum(-1) < _EDGE)
    return np.asarray(cv2.connectedComponents(plain.astype(np.uint8), connectivity=4)[1])


def _hidden(zones: NDArray[np.int32], contradicted: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """The zones of which so large a share is contradicted, without the holes and edges between them: (h, w), 1 or 0."""
    area = np.bincount(zones.ravel())
    hidden = np.bincount(zones.ravel(), contradicted.ravel()) >= share * area
    hidden &= (area >= _SMALLEST) & (area <= _LARGEST * zones.size)
    hidden[0] = False
    things = cv2.dilate(hidden[zones].astype(np.uint8), np.ones((3, 3), np.uint8))
    closed = cv2.morphologyEx(things, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    around = cv2.copyMakeBorder(closed, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    cv2.floodFill(around, None, (0, 0), 2)  # from outside: holes are what it does not reach
    return np.asarray(around[1:-1, 1:-1] != 2, np.uint8)


def _wider(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """With the soft edge of things, in which the scene is mixed."""
    return np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8)))


def _window(mask: NDArray[np.uint8]) -> list[slice]:
    """Rows and columns of what is found, and some more around it."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return [slice(max(int(at[0]) - _MORE, 0), int(at[-1]) + _MORE + 1) for at in (rows, columns)]
