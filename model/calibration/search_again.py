"""A second search of a photo, with a camera that is already roughly known: marks out to the rim, and missed boards.

Where the pose of the target is known, every mark that should be seen is predicted with the shape of its surroundings,
and fitted.  Marks next to those already found come first: how far these lie off their predictions corrects the
predictions beside them, so that a camera that is a few pixels wrong at the rim still leads there step by step.

Where no marker could be read, the photo is rectified: OpenCV's detectors, made for ordinary lenses, see it through a
few windows of an ordinary lens.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.board import Board, MarksFound
from fullsphere.model.calibration.boards import CirclesGrid
from fullsphere.model.calibration.crossings import Crossings, credible, crossings_of, fit_crossings
from fullsphere.model.calibration.detect import find_marks, grey_and_light
from fullsphere.model.calibration.targets import Target
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_STEP = 0.02  # squares, of the differences that tell the shape of a mark's surroundings
_LEAST_SQUARE_PX = 4.0  # across its thinner side: below, a crossing has too few pixels
_MOST_SHIFT = 0.25  # squares between a corrected prediction and the fit: a neighbouring corner is 1 away
_ROUNDS = 12
_NEIGHBOURS = 3  # that a plane is laid through
_BESIDE = 1.6  # squares: marks that correct the prediction of one another
_WINDOWS_DEG = ((0, 0), (55, 0), (-55, 0), (0, 55), (0, -55), (50, 45), (-50, 45), (50, -45), (-50, -45))
_WINDOW_FIELD_DEG, _MOST_WINDOW_PX = 90.0, 2500


class _Surroundings(NamedTuple):
    """Marks in the picture: pixels (n, 2), steps of a square (n, 2, 2), their change (n, 2, 2, 2); NaN if not seen."""

    pixels: FloatArray
    steps: FloatArray
    bends: FloatArray


def search_again(
    picture: NDArray[np.uint8],
    target: Target,
    camera: Camera,
    camera_from_target: FloatArray,
    translation: FloatArray,
    found: MarksFound,
) -> MarksFound:
    """The marks of a view that are found with the help of a camera; those found before are measured anew.

    Parameters
    ----------
    picture
        Photo (h, w[, 3]), uint8, sRGB.
    target
        What is in it.
    camera
        An interim camera; its field of view limits the search.
    camera_from_target, translation
        Rotation (3, 3) and shift (3,) in mm of the view.
    found
        The marks found so far.

    Returns
    -------
    The marks, numbered as in `target.points`.  Discs are not searched for again: a grid of circles is found whole.
    """
    if isinstance(target.boards[0], CirclesGrid):
        return found
    grey, light = grey_and_light(picture)
    # a blurred edge is symmetrical in light; not every camera's pixel values are sRGB, so both readings are tried
    readings = (light, np.asarray(grey / 255, np.float32))
    marks, pixels = [], []
    ends = [*target.first_marks[1:], len(target.points)]
    for board, first, end in zip(target.boards, target.first_marks, ends, strict=True):
        own = (found.marks >= first) & (found.marks < end)
        local = _predicted(board, crossings_of(board), camera, camera_from_target, translation)
        known = MarksFound(found.marks[own] - first, found.pixels[own])
        seen, _ = min((_seen_on(reading, board, local, known) for reading in readings), key=lambda result: result[1])
        marks.append(seen.marks + first)
        pixels.append(seen.pixels)
    return MarksFound(np.concatenate(marks), np.concatenate(pixels))


def find_rectified(picture: NDArray[np.uint8], target: Target, camera: Camera) -> MarksFound:
    """The marks that are found in a photo seen through windows of an ordinary lens, each where it is found first.

    Parameters are as in `search_again`.
    """
    best = MarksFound(np.zeros(0, np.intp), np.empty((0, 2)))
    known: dict[int, FloatArray] = {}
    for yaw, pitch in _WINDOWS_DEG:
        window, rays = _window(picture, camera, yaw, pitch)
        if window is None:
            continue
        seen = find_marks(window, target)
        if len(seen.marks):
            at = _pixels_of_window(seen.pixels, rays, camera)
            for mark, pixel in zip(seen.marks.tolist(), at, strict=True):
                if np.isfinite(pixel).all():
                    known.setdefault(mark, pixel)
    if not known:
        return best
    numbers = np.array(sorted(known), np.intp)
    return MarksFound(numbers, np.array([known[mark] for mark in numbers.tolist()]))


def _seen_on(
    light: NDArray[np.float32], board: Board, local: _Surroundings, known: MarksFound
) -> tuple[MarksFound, float]:
    """The marks of a board, grown from the known ones round by round, and how well they fit (median misfit)."""
    crossings = crossings_of(board)
    visible = _visible(local, light.shape)
    measured = np.full(local.pixels.shape, np.nan)
    measured[known.marks] = known.pixels
    measured = _grown(light, crossings, local, visible, measured)
    have = np.flatnonzero(np.asarray(np.isfinite(measured).all(1)) & visible)
    again, misfit = _fitted(light, crossings, local, have, measured[have])
    good = np.asarray(np.isfinite(again).all(1))
    measured[have[good]] = again[good]
    found = np.flatnonzero(np.isfinite(measured).all(1))
    return MarksFound(found, measured[found]), float(np.median(misfit[good])) if good.any() else math.inf


def _grown(
    light: NDArray[np.float32],
    crossings: Crossings,
    local: _Surroundings,
    visible: NDArray[np.bool_],
    measured: FloatArray,
) -> FloatArray:
    """The marks (n, 2), NaN where none was measured, with those added that others lead to."""
    tried = np.zeros(len(measured), np.intp)
    tree = cKDTree(crossings.places)
    near = [tree.query_ball_point(place, _BESIDE) for place in crossings.places]
    for _ in range(_ROUNDS):
        have = np.asarray(np.isfinite(measured).all(1))
        support = np.array([int(have[beside].sum()) for beside in near])
        wanted = np.flatnonzero(visible & ~have & (support > tried))
        if not wanted.size:
            break
        tried[wanted] = support[wanted]  # a mark is tried again when it has more neighbours to go by
        off = measured - local.pixels
        known = [[m for m in beside if have[m]] for beside in near]
        moved = [_offset(mark, crossings.places, known[mark], off) for mark in wanted.tolist()]
        start = local.pixels[wanted] + np.array(moved)
        measured = measured.copy()
        measured[wanted], _ = _fitted(light, crossings, local, wanted, start)
    return measured


def _fitted(
    light: NDArray[np.float32],
    crossings: Crossings,
    local: _Surroundings,
    marks: NDArray[np.intp],
    start: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Where marks (n,) are (n, 2), looked for near `start`, NaN where no mark is; and the misfit (n,) of each."""
    steps = local.steps[marks]
    fitted = fit_crossings(light, crossings, start, steps, local.bends[marks])
    good = credible(crossings, marks, start, steps, fitted, _MOST_SHIFT)
    return np.where(good[:, None], fitted.pixels, np.nan), fitted.misfit


def _predicted(
    board: Board, crossings: Crossings, camera: Camera, camera_from_target: FloatArray, translation: FloatArray
) -> _Surroundings:
    shifts = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]]) * _STEP
    around = (crossings.places[:, None] + shifts) * crossings.square_mm
    rays = board.placement.lift(around) @ camera_from_target.T + translation
    p = np.moveaxis(camera.project(rays), 1, 0)  # (9, n, 2)
    steps = np.stack([p[1] - p[2], p[3] - p[4]], -1) / (2 * _STEP)
    along_x, along_y = (p[1] + p[2] - 2 * p[0]) / _STEP**2, (p[3] + p[4] - 2 * p[0]) / _STEP**2
    mixed = (p[5] + p[6] - p[7] - p[8]) / (4 * _STEP**2)
    bends = np.stack([np.stack([along_x, mixed], -1), np.stack([mixed, along_y], -1)], -1)
    facing = np.linalg.det(np.stack([rays[:, 1] - rays[:, 2], rays[:, 3] - rays[:, 4], rays[:, 0]], -1)) > 0
    return _Surroundings(np.where(facing[:, None], p[0], np.nan), steps, bends)


def _visible(local: _Surroundings, picture: tuple[int, ...]) -> NDArray[np.bool_]:
    """Marks (n,) inside the picture whose squares are large enough to be measured."""
    height, width = picture[:2]
    predicted, steps = local.pixels, local.steps
    ok = np.isfinite(predicted).all(1) & np.isfinite(steps).all((1, 2)) & np.isfinite(local.bends).all((1, 2, 3))
    ok &= np.all((np.nan_to_num(predicted, nan=-1.0) > 1) & (np.nan_to_num(predicted) < [width - 2, height - 2]), 1)
    thinner = np.linalg.svd(np.where(ok[:, None, None], steps, 0.0), compute_uv=False)[:, 1]
    return np.asarray(ok & (thinner >= _LEAST_SQUARE_PX))


def _offset(mark: int, places: FloatArray, beside: list[int], off: FloatArray) -> FloatArray:
    """How far a mark lies off its prediction (2,), by what its measured neighbours do: a plane through them if it can.

    A plane is taken where the neighbours surround a corner of it; a mean where they are few or in a line.
    """
    if not beside:
        return np.zeros(2)
    mean: FloatArray = off[beside].mean(0)
    arms = places[beside] - places[mark]
    if len(beside) >= _NEIGHBOURS and np.linalg.matrix_rank(arms - arms.mean(0), tol=0.3) == 2:
        plane = np.linalg.lstsq(np.column_stack([np.ones(len(arms)), arms]), off[beside], rcond=None)[0]
        return np.asarray(plane[0], float)
    return mean


def _window(
    picture: NDArray[np.uint8], camera: Camera, yaw_deg: float, pitch_deg: float
) -> tuple[NDArray[np.uint8] | None, tuple[FloatArray, float, int]]:
    """The photo through a square window of an ordinary lens, and (rotation, focal length, side) of that lens."""
    per_radian = float(np.median(camera.pixels_per_radian(np.array([[0.0, 0.0, 1.0]]))))
    half = math.tan(math.radians(_WINDOW_FIELD_DEG / 2))
    side = int(min(2 * half * per_radian, _MOST_WINDOW_PX))
    focal = side / (2 * half)
    turn = Rotation.from_euler("YX", [yaw_deg, pitch_deg], degrees=True).as_matrix()
    v, u = np.indices((side, side), dtype=float)
    rays = np.stack([u - (side - 1) / 2, v - (side - 1) / 2, np.full_like(u, focal)], -1) @ turn.T
    source = camera.project(rays).astype(np.float32)
    inside = np.asarray(np.isfinite(source).all(-1))
    if np.mean(inside) < 0.2:
        return None, (turn, focal, side)
    source = np.where(inside[..., None], source, np.float32(-10.0))
    window = cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(window, np.uint8), (turn, focal, side)


def _pixels_of_window(pixels: FloatArray, lens: tuple[FloatArray, float, int], camera: Camera) -> FloatArray:
    turn, focal, side = lens
    rays = np.column_stack([pixels - (side - 1) / 2, np.full(len(pixels), focal)]) @ turn.T
    return camera.project(rays)
