"""Local alignment along seams: what parallax or a lens's misfit leaves apart is drawn together, half by each frame.

Frames that were not quite turned about one point show near things in different directions.  No orientation mends that,
but along a seam only two frames meet: optical flow tells by how much their pictures differ there, each gives way by
half, and the shift fades out inside the frames (after Shum and Szeliski, "Construction of panoramic image mosaics with
global and local alignment", IJCV 2000, section 5).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.frame_light import gain_of
from fullsphere.mosaic.overview import reduced_frame
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.shift import Shift

_SCALE = 220.0  # pixels per radian at which pictures are compared: a quarter of a degree each
_BAND = math.radians(2.5)  # to each side of a seam in which the flow is asked for
_FADE = math.radians(2.0)  # standard deviation with which a shift fades into the frame
_SMOOTH = math.radians(1.0)  # over which the flow is averaged
_ROUNDS = 2  # the second sees what the first has left
_AGREEMENT = math.radians(0.05)  # of matches: what keypoints of a camera turned about one point come to
_MOST = math.radians(1.2)  # that two frames may be apart: more is another thing, not parallax
_LEAST_PX = 0.12  # of the compared pictures: less is noise, and stays as it is
_TEXTURE = 12.0  # squared grey levels per pixel: half trusted
_FREE = 0.004  # weight of staying where one is
_CELL = math.radians(1.0)  # of the grid that holds a frame's shifts


class _Small(NamedTuple):
    """A frame made small: grey (h, w) as the eye sees it, where it shows anything, and its camera."""

    grey: NDArray[np.uint8]
    seen: NDArray[np.bool_]
    camera: Camera
    table: RayTable
    factor: int


class _Pull(NamedTuple):
    """What a frame is asked for at some of its pixels: (n, 2) of the small picture, (n, 2) shifts, (n,) weights."""

    at: FloatArray
    shift: FloatArray
    weight: FloatArray


def local_shifts(
    mosaic: Mosaic, owners: NDArray[np.int16], sphere: Equirectangular, executor: Executor | None = None
) -> tuple[Shift | None, ...]:
    """For each registered frame by how much it is read aside, None where nothing asks for it.

    Parameters
    ----------
    mosaic
        The solved project.  If its matches agree to what keypoints are good for, nobody is asked.
    owners
        (H, W) which registered frame owns each pixel of the working sphere.
    sphere
        The working sphere.
    executor
        Where frames and pairs are worked on side by side.
    """
    frames = mosaic.registered
    if _agree(mosaic):
        return (None,) * len(frames)
    seams = _seams(owners, sphere)
    used = sorted({k for pair in seams for k in pair})
    small = dict(zip(used, ordered_map(executor, lambda k: _small(mosaic, frames[k]), used, ahead=4), strict=True))

    shifts: dict[int, Shift] = {}
    for _ in range(_ROUNDS):
        seen = {k: _read_aside(small[k], shifts.get(k)) for k in used}
        for k, more in _asked_for(frames, seen, seams, executor).items():
            shifts[k] = more if k not in shifts else dataclasses.replace(more, values=more.values + shifts[k].values)
    return tuple(shifts.get(k) for k in range(len(frames)))


def _asked_for(
    frames: Sequence[Frame],
    small: Mapping[int, _Small],
    seams: Mapping[tuple[int, int], FloatArray],
    executor: Executor | None,
) -> dict[int, Shift]:
    """The shifts that pictures as they are now ask for, of the frames that are asked."""

    def pulls_of(pair: tuple[int, int]) -> tuple[_Pull, _Pull] | None:
        i, j = pair
        return _pulls(frames[i], frames[j], small[i], small[j], seams[pair])

    asked: dict[int, list[_Pull]] = {}
    for pair, pulls in zip(seams, ordered_map(executor, pulls_of, seams, ahead=4), strict=True):
        for k, pull in zip(pair, pulls or (), strict=False):
            asked.setdefault(k, []).append(pull)
    found = {k: _shift(pulls, small[k]) for k, pulls in asked.items()}
    return {k: shift for k, shift in found.items() if shift is not None}


def _read_aside(small: _Small, shift: Shift | None) -> _Small:
    """The small picture as it is after a shift."""
    if shift is None:
        return small
    height, width = small.grey.shape
    v, u = np.mgrid[:height, :width].astype(float)
    own = Shift(shift.values / np.float32(small.factor), shift.cell_px / small.factor)
    places = [np.nan_to_num(x, nan=-9.0).astype(np.float32) for x in own.moved(u, v, (width, height))]
    grey = cv2.remap(small.grey, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.remap(small.seen.astype(np.uint8), *places, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
    return small._replace(grey=grey, seen=seen > 0)


def _agree(mosaic: Mosaic) -> bool:
    """Whether matches that no fit has seen tell that there is nothing to mend."""
    if not mosaic.quality.get("held_out_matches"):
        return False
    return mosaic.quality["held_out_median_px"] < _AGREEMENT * float(mosaic.camera.lens.slope(0.0))


def _seams(owners: NDArray[np.int16], sphere: Equirectangular) -> Mapping[tuple[int, int], FloatArray]:
    """The directions (n, 3) on the seam of each pair of frames that meet."""
    height, width = owners.shape
    rays = sphere.window_rays(slice(0, width), slice(0, height))
    found: dict[tuple[int, int], list[FloatArray]] = {}
    right = np.roll(owners, -1, axis=1)
    for other, here in ((right, owners), (owners[1:], owners[:-1])):
        rows, columns = np.nonzero(other != here)
        low, high = np.minimum(other, here)[rows, columns], np.maximum(other, here)[rows, columns]
        for pair in np.unique(np.stack([low, high], -1), axis=0).tolist():
            chosen = (low == pair[0]) & (high == pair[1])
            found.setdefault((pair[0], pair[1]), []).append(rays[rows[chosen], columns[chosen]])
    return {pair: np.concatenate(parts) for pair, parts in sorted(found.items())}


def _small(mosaic: Mosaic, frame: Frame) -> _Small:
    camera = mosaic.cameras[frame.camera]
    factor = max(1, round(float(camera.lens.slope(0.0)) / _SCALE))
    reduced = reduced_frame(frame, camera, factor)
    gain = gain_of(mosaic, frame)
    light = reduced.light @ (gain.factors / 3)
    share = np.maximum(reduced.seen, np.float32(0.5))
    grey = np.clip(255 * np.sqrt(np.maximum(light / share, 0)), 0, 255).astype(np.uint8)
    height, width = grey.shape
    smaller = camera.cropped(0, 0, width * factor, height * factor).scaled(1 / factor)
    return _Small(grey, reduced.seen > 0.99, smaller, tabulate(smaller, 1e-3), factor)


def _pulls(frame_i: Frame, frame_j: Frame, i: _Small, j: _Small, seam: FloatArray) -> tuple[_Pull, _Pull] | None:
    """What both frames are asked for along their seam (n, 3)."""
    turn_i, turn_j = frame_i.camera_from_world, frame_j.camera_from_world
    assert turn_i is not None and turn_j is not None
    i_from_j = turn_i @ turn_j.T
    per_radian = float(i.camera.lens.slope(0.0))
    window = _window(i, seam @ turn_i.T, _BAND * per_radian)
    if window is None:
        return None
    near, rows, columns = window
    cut = i.camera.cropped(columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start)
    there, weight = remap(j.grey[..., None], j.table, cut, i_from_j, "linear")
    known, _ = remap(j.seen[..., None].astype(np.uint8), j.table, cut, i_from_j, "nearest")
    here, both = i.grey[rows, columns], i.seen[rows, columns] & (weight > 0.99) & (known[..., 0] > 0)
    flow, trust = _flow(here, there[..., 0], both, per_radian)
    v, u = np.nonzero(near[rows, columns] & (trust > 0.02))
    if u.size == 0:
        return None
    shift, weights = flow[v, u], trust[v, u]
    place = np.stack([u + columns.start, v + rows.start], -1).astype(float)
    halves = [i.table.unproject(place + side * shift) @ i_from_j for side in (0.0, 0.5)]
    at_j, moved_j = (j.table.project(rays) for rays in halves)
    good = np.isfinite(at_j[:, 0]) & np.isfinite(moved_j[:, 0])
    return (
        _Pull(place[good], -0.5 * shift[good], weights[good]),
        _Pull(at_j[good], (moved_j - at_j)[good], weights[good]),
    )


def _window(small: _Small, seam: FloatArray, reach_px: float) -> tuple[NDArray[np.bool_], slice, slice] | None:
    """Where a small picture is near a seam (n, 3), and the rows and columns around that."""
    height, width = small.grey.shape
    pixels = small.table.project(seam)
    pixels = pixels[np.isfinite(pixels[:, 0])].round().astype(int)
    pixels = pixels[(pixels >= 0).all(1) & (pixels < [width, height]).all(1)]
    if len(pixels) == 0:
        return None
    off = np.ones((height, width), np.uint8)
    off[pixels[:, 1], pixels[:, 0]] = 0
    near = cv2.distanceTransform(off, cv2.DIST_L2, 3) <= reach_px
    room = round(2 * reach_px)
    low, high = pixels.min(0) - room, pixels.max(0) + room + 1
    rows, columns = slice(max(low[1], 0), min(high[1], height)), slice(max(low[0], 0), min(high[0], width))
    if min(rows.stop - rows.start, columns.stop - columns.start) < 32:
        return None
    return near, rows, columns


def _flow(
    here: NDArray[np.uint8], there: NDArray[np.uint8], both: NDArray[np.bool_], per_radian: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """By how many pixels (h, w, 2) what is here is elsewhere there, averaged, and how much that is to be trusted."""
    here, there = (np.where(both, picture, here) for picture in (here, there))  # no flow where one sees nothing
    finder = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    finder.setFinestScale(0)
    forth, back = finder.calc(here, there, None), finder.calc(there, here, None)
    height, width = here.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    returned = cv2.remap(back, u + forth[..., 0], v + forth[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    apart = np.linalg.norm(forth + returned, axis=-1)
    across, down = (cv2.Sobel(here, cv2.CV_32F, *axes, ksize=3, scale=1 / 8) for axes in ((1, 0), (0, 1)))
    energy = cv2.GaussianBlur(across**2 + down**2, (0, 0), 2)
    trust = both * (energy / (energy + _TEXTURE)) * np.exp(-(apart**2) / 0.5)
    trust *= np.linalg.norm(forth, axis=-1) < _MOST * per_radian
    sigma = _SMOOTH * per_radian
    sums = [cv2.GaussianBlur(layer, (0, 0), sigma) for layer in (trust, forth * trust[..., None])]
    flow = sums[1] / np.maximum(sums[0], 1e-6)[..., None]
    return flow.astype(np.float32), (sums[0] * both).astype(np.float32)


def _shift(pulls: Sequence[_Pull], small: _Small) -> Shift | None:
    """All that a frame is asked for, as one smooth field that fades where nobody asks."""
    per_radian = float(small.camera.lens.slope(0.0))
    cell = _CELL * per_radian
    width, height = (math.ceil(side / cell) + 1 for side in small.camera.size)
    sums = np.zeros((height, width, 3))
    for pull in pulls:
        column, row = np.floor((pull.at + 0.5) / cell).astype(int).T
        weighted = np.column_stack([pull.shift * pull.weight[:, None], pull.weight])
        np.add.at(sums, (np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)), weighted)
    sums /= max(cell * cell * 0.25, 1.0)  # a cell full of half trusted pixels weighs two
    near = cv2.GaussianBlur(sums, (0, 0), _FADE * per_radian / cell, borderType=cv2.BORDER_CONSTANT)
    field = near[..., :2] / (near[..., 2:] + _FREE)
    size = np.linalg.norm(field, axis=-1, keepdims=True)
    field *= np.maximum(0, 1 - _LEAST_PX / np.maximum(size, 1e-9))
    if not field.any():
        return None
    return Shift((field * small.factor).astype(np.float32), cell * small.factor)
