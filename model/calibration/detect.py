"""Finds the coded corners of a ChArUco target in the photo of an ultra-wide lens.

OpenCV finds and reads the markers.  Its own interpolation of chess corners assumes an ordinary lens over the whole
board, so here each corner is predicted from the one or two markers that touch it, and then fitted in the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.boards import CharucoBoard, marker_dictionary, one_dictionary
from fullsphere.model.calibration.saddle import Saddles, fit_saddles
from fullsphere.model.colour import linear_from_encoded
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray

_SEARCHES = ((1, (9, 29)), (2, (25,)))
"""Enlargement, and sides in pixels of the windows whose mean is the threshold between black and white: markers of few
pixels are read better in an enlarged picture."""
_LARGEST_SEARCH_PX = 8192  # the markers of a picture that large have pixels enough
_AGREE = 0.12  # squares: two markers that touch a corner must predict it to within this
_MOST_SHIFT = 0.12  # squares: a corner lies this near its prediction, or the fit has run off to something else
_MOST_SIGMA_PX = 0.12
_MOST_MISFIT = 0.15  # residual RMS over contrast: noise and blur stay below, anything that is no corner above
_LEAST_CONTRAST = 0.02  # of full scale, linear light


class CornersFound(NamedTuple):
    """Corners on the target (n, 3) in mm, and where they were found in the picture (n, 2) in pixels."""

    points_on_target: FloatArray
    pixels: FloatArray


class _Predictions(NamedTuple):
    """Corners of one board to look for: their numbers (n,), pixels (n, 2) and steps of a square (n, 2, 2)."""

    corners: NDArray[np.intp]
    pixels: FloatArray
    px_from_square: FloatArray


def find_charuco_corners(picture: NDArray[Any], boards: Sequence[CharucoBoard]) -> CornersFound:
    """Find the inner corners of a target's boards.

    Parameters
    ----------
    picture
        Photo (h, w) or (h, w, 3), uint8, sRGB.
    boards
        The boards of the target; they share a dictionary and no marker number.

    Returns
    -------
    The corners found, board by board in the order of `marks_on_target`; none if there is no target.  A corner
    counts only when two neighbouring markers confirm each other and the picture there is two crossing edges.

    Raises
    ------
    UsageError
        If the picture is not 8-bit, or the boards do not make one target.
    """
    dictionary = marker_dictionary(one_dictionary(boards))
    if picture.dtype != np.uint8 or picture.ndim not in (2, 3):
        raise UsageError(f"corners are looked for in an 8-bit picture, not in {picture.dtype} {picture.shape}")
    grey = _grey(picture)
    light = linear_from_encoded(grey[..., None])[..., 0]  # blurred edges are symmetrical only in light
    markers = _find_markers(grey, dictionary)
    points, pixels = [np.empty((0, 3))], [np.empty((0, 2))]
    for board in boards:
        expected = _predict(board, markers)
        if not len(expected.corners):
            continue
        clear = (1 - board.marker_mm / board.square_mm) / 2
        found = fit_saddles(light, expected.pixels, expected.px_from_square, clear)
        keep = _credible(board, expected, found)
        points.append(board.marks_on_target()[expected.corners[keep]])
        pixels.append(found.pixels[keep])
    return CornersFound(np.concatenate(points), np.concatenate(pixels))


def _grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if picture.ndim == 2 or picture.shape[2] < 3:
        return np.ascontiguousarray(picture.reshape(*picture.shape[:2], -1)[..., 0])
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_RGB2GRAY), np.uint8)


def _find_markers(grey: NDArray[np.uint8], dictionary: cv2.aruco.Dictionary) -> dict[int, list[FloatArray]]:
    """Outlines (4, 2) in pixels of what reads as a marker, by number; false ones are among them.

    The picture is searched several times; what is found twice is kept twice.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = 0.01  # a wide picture holds many small markers
    settings.polygonalApproxAccuracyRate = 0.06  # their sides are bent
    settings.minDistanceToBorder = 1
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementWinSize = 3
    markers: dict[int, list[FloatArray]] = {}
    for scale, windows in _SEARCHES:
        if scale > 1 and max(grey.shape) * scale > _LARGEST_SEARCH_PX:
            continue
        settings.adaptiveThreshWinSizeMin, settings.adaptiveThreshWinSizeMax = windows[0], windows[-1]
        settings.adaptiveThreshWinSizeStep = max(windows[-1] - windows[0], 1)
        scaled = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) if scale > 1 else grey
        outlines, ids, _ = cv2.aruco.ArucoDetector(dictionary, settings).detectMarkers(scaled)
        numbers = np.zeros(0, int) if ids is None else np.asarray(ids).ravel()
        for outline, number in zip(outlines, numbers, strict=True):
            pixels = (np.asarray(outline, float).reshape(4, 2) + 0.5) / scale - 0.5
            markers.setdefault(int(number), []).append(pixels)
    return markers


def _predict(board: CharucoBoard, markers: dict[int, list[FloatArray]]) -> _Predictions:
    """Where the corners touched by a confirmed marker should be.

    A marker is confirmed when a neighbour predicts the corner between them at the same place: chance readings, and
    the readings of a mirrored picture, have no such neighbour.
    """
    votes: dict[int, list[tuple[tuple[int, int], FloatArray, FloatArray]]] = {}
    for number, (i, j) in enumerate(board.marker_squares().tolist(), board.first_id):
        for reading, outline in enumerate(markers.get(number, [])):
            homography = _pixel_from_square(board, outline)
            for corner, place in _corners_of_square(board, i, j):
                pixel, step = _apply(homography, place)
                if np.isfinite(step).all() and np.linalg.det(step) > 0:  # a mirrored marker is none
                    votes.setdefault(corner, []).append(((number, reading), pixel, step))
    confirmed: set[tuple[int, int]] = set()
    for said in votes.values():
        for k, (name, pixel, step) in enumerate(said):
            for other, pixel_2, step_2 in said[k + 1 :]:
                if name[0] != other[0] and _agree(pixel, step, pixel_2, step_2):
                    confirmed |= {name, other}
    corners, pixels, steps = [], [], []
    for corner, said in sorted(votes.items()):
        trusted = [vote for vote in said if vote[0] in confirmed]
        if trusted and all(_agree(*trusted[0][1:], *vote[1:]) for vote in trusted[1:]):
            corners.append(corner)
            pixels.append(np.mean([vote[1] for vote in trusted], axis=0))
            steps.append(np.mean([vote[2] for vote in trusted], axis=0))
    return _Predictions(np.array(corners, np.intp), np.array(pixels).reshape(-1, 2), np.array(steps).reshape(-1, 2, 2))


def _pixel_from_square(board: CharucoBoard, outline: FloatArray) -> FloatArray:
    """The homography (3, 3) from the unit square round a marker to pixels."""
    gap = (1 - board.marker_mm / board.square_mm) / 2
    flat = np.array([[gap, gap], [1 - gap, gap], [1 - gap, 1 - gap], [gap, 1 - gap]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(flat, outline.astype(np.float32)), float)


def _corners_of_square(board: CharucoBoard, i: int, j: int) -> list[tuple[int, tuple[int, int]]]:
    """The inner corners at square (i, j): their number and which corner of the square they are."""
    return [
        ((j + y - 1) * (board.squares_x - 1) + i + x - 1, (x, y))
        for x in (0, 1)
        for y in (0, 1)
        if 0 < i + x < board.squares_x and 0 < j + y < board.squares_y
    ]


def _apply(homography: FloatArray, place: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """The image (2,) of a point of the unit square and the derivative (2, 2) there."""
    u, v, w = homography @ [*place, 1.0]
    pixel = np.array([u, v]) / w
    return pixel, (homography[:2, :2] - np.outer(pixel, homography[2, :2])) / w


def _agree(pixel: FloatArray, step: FloatArray, pixel_2: FloatArray, step_2: FloatArray) -> bool:
    """Whether two predictions are of one place, one scale and one orientation."""
    apart = np.linalg.norm(np.linalg.solve(step + step_2, 2 * (pixel - pixel_2)))
    differ = np.linalg.norm(step - step_2) / np.linalg.norm(step + step_2)
    return bool(apart < _AGREE and differ < 0.25)


def _credible(board: CharucoBoard, expected: _Predictions, found: Saddles) -> NDArray[np.bool_]:
    """Which fits (n,) are chess corners: near the prediction, of the board's own sign, sharp and well fitted."""
    row, column = np.divmod(expected.corners, board.squares_x - 1)
    first_black = np.where((row + column) % 2 == 0, 1.0, -1.0)  # the square above and left of the corner
    with np.errstate(invalid="ignore"):
        moved = np.linalg.solve(expected.px_from_square, (found.pixels - expected.pixels)[..., None])[..., 0]
        return np.asarray(
            (np.linalg.norm(moved, axis=-1) < _MOST_SHIFT)
            & (-first_black * found.contrast > _LEAST_CONTRAST)
            & (found.sigma_px < _MOST_SIGMA_PX)
            & (found.misfit < _MOST_MISFIT)
        )
