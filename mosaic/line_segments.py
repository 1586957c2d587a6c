"""Straight edges of the scene as arcs of great circles, found in flat views all round the horizon."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import remap
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.allowed import allowed_pixels
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.rim import eight_bit

_VIEWS = 8  # round the horizon, overlapping by a third
_WIDTH, _HEIGHT = 56.0, 100.0  # angles that a view spans, degrees
_FOCAL_PX = 520.0  # of the finest views; coarser where the frames are
_SEEN_ENOUGH = 0.9  # of a view: no further frame is looked at for the rest
_FRAMES_A_VIEW = 3
_NEW_ENOUGH = 0.15  # of a view, that a further frame has to add
_NARROW, _NARROW_FRAMES, _NARROW_SIDE_PX = math.radians(48.0), 12, 1000  # half fields of view that no view needs
_LEAST_LENGTH = math.radians(2.5)
_INNER = 0.98  # of the field of view: the rim of the image circle is an edge too
_RIM_PX = 6  # segments as near to where a view ends are its border's


class Segments(NamedTuple):
    """Straight edges.

    Attributes
    ----------
    middles
        Unit rays (n, 3) in the world to the middles.
    normals
        Unit normals (n, 3) of the planes through the eye and the edges.
    lengths
        Angles (n,) that they span, radians.
    """

    middles: FloatArray
    normals: FloatArray
    lengths: FloatArray


class _View(NamedTuple):
    """A perspective lens and the rotation (3, 3) from the world."""

    lens: Camera
    view_from_world: FloatArray


class _Task(NamedTuple):
    """A frame, and the views that it is looked at in."""

    frame: Frame
    views: list[_View]


def find_segments(
    frames: Sequence[Frame], cameras: Sequence[Camera], up: FloatArray, executor: Executor | None = None
) -> Segments:
    """Straight edges in all directions round the horizon, with the line segment detector (von Gioi et al. 2010).

    It works in views through a perspective lens, in which straight lines are straight, each taken from the one to
    three frames that show most of it: time depends on the views, not on how many frames there are.  Frames that are
    narrower than such a view are looked at by themselves, some of them spread over the set.

    Parameters
    ----------
    frames
        Registered frames.
    cameras
        That took them.
    up
        Unit vector (3,) in their world, to some tens of degrees.
    executor
        Where views are worked on side by side.
    """
    inner = [dataclasses.replace(camera, half_fov=_INNER * camera.half_fov) for camera in cameras]
    tables = [tabulate(camera) for camera in inner]
    narrow = max(camera.half_fov for camera in cameras) < _NARROW
    tasks = _of_narrow(frames, cameras) if narrow else _tasks(frames, tables, _wide(cameras), up)

    def of_task(task: _Task) -> list[Segments]:
        return _segments(task, tables[task.frame.camera])

    found = [one for some in ordered_map(executor, of_task, tasks, ahead=2) for one in some]
    if not found:
        return Segments(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    return Segments(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _wide(cameras: Sequence[Camera]) -> Camera:
    """The lens of views round the horizon, as fine as the finest of the frames at their middle, up to a bound."""
    focal = min(_FOCAL_PX, max(_focal(camera) for camera in cameras))
    return _flat(focal, *(2 * focal * math.tan(math.radians(angle) / 2) for angle in (_WIDTH, _HEIGHT)))


def _of_narrow(frames: Sequence[Frame], cameras: Sequence[Camera]) -> list[_Task]:
    """Some frames spread over the set, each seen as its own camera sees it, by a perspective lens."""
    tasks = []
    for frame in frames[:: -(-len(frames) // _NARROW_FRAMES)]:
        assert frame.camera_from_world is not None
        camera = cameras[frame.camera]
        width, height = camera.size
        factor = min(1.0, _NARROW_SIDE_PX / max(width, height))
        lens = _flat(factor * _focal(camera), factor * width, factor * height)
        tasks.append(_Task(frame, [_View(lens, frame.camera_from_world)]))
    return tasks


def _focal(camera: Camera) -> float:
    return float(camera.pixels_per_radian(np.array([0.0, 0.0, 1.0])))


def _flat(focal: float, width: float, height: float) -> Camera:
    """A perspective lens without distortion, its axis in the middle."""
    corner = math.atan(math.hypot(width, height) / 2 / focal)
    size = (round(width), round(height))
    return Camera(Perspective(focal), size, ((size[0] - 1) / 2, (size[1] - 1) / 2), half_fov=corner + 0.01)


def _tasks(frames: Sequence[Frame], tables: Sequence[RayTable], view: Camera, up: FloatArray) -> list[_Task]:
    """Which frames are looked at, and in which views."""
    width, height = view.size
    u, v = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 15))
    rays = view.unproject(np.stack([u.ravel(), v.ravel()], -1))
    start = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    start /= np.linalg.norm(start)
    views: dict[int, list[_View]] = {}
    for k in range(_VIEWS):
        angle = 2 * math.pi * k / _VIEWS
        forward = math.cos(angle) * start + math.sin(angle) * np.cross(up, start)
        view_from_world = np.stack([np.cross(-up, forward), -up, forward])
        seen = np.array([_seen(frame, tables[frame.camera], rays @ view_from_world) for frame in frames])
        for chosen in _chosen(seen):
            views.setdefault(chosen, []).append(_View(view, view_from_world))
    return [_Task(frames[k], own) for k, own in sorted(views.items())]


def _seen(frame: Frame, table: RayTable, rays: FloatArray) -> FloatArray:
    """How well a frame shows world rays (n, 3): 0 where not at all, more towards its axis."""
    assert frame.camera_from_world is not None
    pixels = table.project(rays, frame.camera_from_world)
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels <= np.array(table.size) - 1), axis=-1)
    return np.asarray(np.where(inside, 2 + rays @ frame.camera_from_world[2], 0.0))


def _chosen(seen: FloatArray) -> list[int]:
    """Frames that together show most of a view: rows of `seen` (frames, n)."""
    chosen: list[int] = []
    left = np.ones(seen.shape[1], bool)
    while len(chosen) < _FRAMES_A_VIEW and left.mean() > 1 - _SEEN_ENOUGH:
        best = int(np.argmax(seen[:, left].sum(1)))
        if np.mean(left & (seen[best] > 0)) < _NEW_ENOUGH:
            break
        chosen.append(best)
        left &= seen[best] == 0
    return chosen


def _segments(task: _Task, table: RayTable) -> list[Segments]:
    """Those of each view."""
    frame = task.frame
    assert frame.camera_from_world is not None
    picture = frame.load()
    grey = _grey(eight_bit(picture))
    if frame.mask is not None or picture.shape[2] == 4:
        grey = np.stack([grey, allowed_pixels(frame, picture)], -1)
    found = []
    for view, view_from_world in task.views:
        flat, weight = remap(grey, table, view, view_from_world @ frame.camera_from_world.T)
        whole = weight > 0.99
        if flat.ndim == 3:
            flat, whole = flat[..., 0], whole & (flat[..., 1] > 250)
        away = cv2.erode(whole.astype(np.uint8), np.ones((2 * _RIM_PX + 1, 2 * _RIM_PX + 1), np.uint8)) > 0
        found.append(_on_sphere(_detected(np.ascontiguousarray(flat), away), view, view_from_world))
    return found


def _grey(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY) if colour.shape[2] == 3 else colour[..., 0], np.uint8)


def _detected(flat: NDArray[np.uint8], away: NDArray[np.bool_]) -> FloatArray:
    """Ends (n, 2, 2) of segments whose ends lie `away` from the border of what was seen."""
    lines = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(flat)[0]
    if lines is None:
        return np.empty((0, 2, 2))
    ends = np.asarray(lines, float).reshape(-1, 2, 2)
    column, row = np.moveaxis(np.rint(ends).astype(int), -1, 0)
    inside = (column >= 0) & (row >= 0) & (column < flat.shape[1]) & (row < flat.shape[0])
    inside[inside] = away[row[inside], column[inside]]
    return np.asarray(ends[inside.all(1)])


def _on_sphere(ends: FloatArray, view: Camera, view_from_world: FloatArray) -> Segments:
    rays = view.unproject(ends) @ view_from_world
    first, last = rays[:, 0], rays[:, 1]
    normals = np.cross(first, last)
    sine = np.linalg.norm(normals, axis=-1)
    lengths = np.arctan2(sine, (first * last).sum(-1))
    keep = lengths > _LEAST_LENGTH
    middles = (first + last)[keep]
    return Segments(
        middles / np.linalg.norm(middles, axis=-1, keepdims=True), normals[keep] / sine[keep, None], lengths[keep]
    )
