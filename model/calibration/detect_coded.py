"""Finds the marks of coded boards, ChArUco and AprilTag grids, in the photo of an ultra-wide lens.

OpenCV finds and reads the markers.  Its own interpolation of chess corners assumes an ordinary lens over the whole
board, so here each mark is predicted from the one or two markers that touch it or stand beside it, and then fitted in
the picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import (
    APRILTAG_MARKS,
    AprilGrid,
    CharucoBoard,
    CodedBoard,
    marker_dictionary,
)
from fullsphere.model.calibration.crossings import Crossings, credible, crossings_of, fit_crossings
from fullsphere.model.lens import FloatArray

_SEARCHES = ((1, (9, 29)), (2, (25,)))
"""Enlargement, and sides in pixels of the windows whose mean is the threshold between black and white: markers of few
pixels are read better in an enlarged picture."""
_LARGEST_SEARCH_PX = 8192  # the markers of a picture that large have pixels enough
_AGREE = 0.12  # squares: two markers that touch a mark must predict it to within this
_BESIDE = 0.3  # the same where the mark is not the marker's own and is extrapolated

Markers = dict[int, list[FloatArray]]
"""Outlines (4, 2) in pixels of what reads as a marker, by number."""


class _Vote(NamedTuple):
    """What one marker says of one mark: its own place (n, 2) and step of a square (2, 2); `own` if it touches it."""

    marker: tuple[int, int]
    pixel: FloatArray
    step: FloatArray
    own: bool


def find_coded(
    grey: NDArray[np.uint8], light: NDArray[np.float32], boards: Sequence[CodedBoard]
) -> tuple[MarksFound, ...]:
    """Find the marks of each board of a target.

    Parameters
    ----------
    grey
        Photo (h, w) as the file has it.
    light
        The same (h, w) in linear light, 0 to 1.
    boards
        Boards of one kind and dictionary, no marker number twice.

    Returns
    -------
    The marks found on each board.  A mark counts only when two neighbouring markers confirm each other and the picture
    there is two crossing edges; the readings of a mirrored picture never count.
    """
    markers = find_markers(grey, boards[0].dictionary, border_modules(boards[0]))
    return tuple(_find_on(light, board, markers) for board in boards)


def border_modules(board: CodedBoard) -> int:
    """Width of the black border of the board's markers, in modules of their code."""
    return board.border_modules if isinstance(board, AprilGrid) else 1


def find_markers(grey: NDArray[np.uint8], dictionary: str, border: int) -> Markers:
    """What reads as a marker of a dictionary with a border of that many modules; false ones are among them.

    The picture is searched several times; what is found twice is kept twice.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = 0.01  # a wide picture holds many small markers
    settings.polygonalApproxAccuracyRate = 0.06  # their sides are bent
    settings.minDistanceToBorder = 1
    settings.markerBorderBits = border
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementWinSize = 3
    markers: Markers = {}
    for scale, windows in _SEARCHES:
        if scale > 1 and max(grey.shape) * scale > _LARGEST_SEARCH_PX:
            continue
        settings.adaptiveThreshWinSizeMin, settings.adaptiveThreshWinSizeMax = windows[0], windows[-1]
        settings.adaptiveThreshWinSizeStep = max(windows[-1] - windows[0], 1)
        scaled = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) if scale > 1 else grey
        outlines, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(dictionary), settings).detectMarkers(scaled)
        numbers = np.zeros(0, int) if ids is None else np.asarray(ids).ravel()
        for outline, number in zip(outlines, numbers, strict=True):
            pixels = (np.asarray(outline, float).reshape(4, 2) + 0.5) / scale - 0.5
            markers.setdefault(int(number), []).append(pixels)
    return markers


def _find_on(light: NDArray[np.float32], board: CodedBoard, markers: Markers) -> MarksFound:
    crossings = crossings_of(board)
    votes = _votes(board, crossings, markers)
    confirmed = _confirmed(votes)
    marks, pixels, steps = [], [], []
    for mark, said in sorted(votes.items()):
        trusted = [vote for vote in said if vote.marker in confirmed and vote.own]
        if trusted and all(_agree(trusted[0], vote) for vote in trusted[1:]) and _supported(board, trusted[0], said):
            marks.append(mark)
            pixels.append(np.mean([vote.pixel for vote in trusted], axis=0))
            steps.append(np.mean([vote.step for vote in trusted], axis=0))
    if not marks:
        return MarksFound(np.zeros(0, np.intp), np.empty((0, 2)))
    numbers, expected, px_from_square = np.array(marks, np.intp), np.array(pixels), np.array(steps)
    found = fit_crossings(light, crossings, expected, px_from_square)
    keep = credible(crossings, numbers, expected, px_from_square, found)
    return MarksFound(numbers[keep], found.pixels[keep])


def _supported(board: CodedBoard, own: _Vote, said: list[_Vote]) -> bool:
    """Whether a tag beside expects the corner of a tag there too.

    A crossing of the same colours stands a gap away: a single outline drawn there would find it.  A chess corner is
    far from the next of its colours.
    """
    beside = [vote for vote in said if vote.marker[0] != own.marker[0] and not vote.own]
    return isinstance(board, CharucoBoard) or any(_agree(own, vote) for vote in beside)


def _votes(board: CodedBoard, crossings: Crossings, markers: Markers) -> dict[int, list[_Vote]]:
    """What the markers say of the marks that they touch, and of those of the markers beside them."""
    votes: dict[int, list[_Vote]] = {}
    for number in range(board.marker_count):
        for reading, outline in enumerate(markers.get(board.first_id + number, [])):
            homography, marks = _reading(board, crossings, number, outline)
            for mark, place, own in marks:
                pixel, step = _apply(homography, place)
                if np.isfinite(step).all() and np.linalg.det(step) > 0:  # a mirrored marker is none
                    votes.setdefault(mark, []).append(_Vote((number, reading), pixel, step, own))
    return votes


def _reading(
    board: CodedBoard, crossings: Crossings, number: int, outline: FloatArray
) -> tuple[FloatArray, Iterator[tuple[int, FloatArray, bool]]]:
    """The homography (3, 3) from the paper in squares to pixels that a marker's outline gives, and marks near it."""
    if isinstance(board, CharucoBoard):
        i, j = board.marker_squares()[number]
        gap = (1 - board.marker_mm / board.square_mm) / 2
        flat = np.array([[gap, gap], [1 - gap, gap], [1 - gap, 1 - gap], [gap, 1 - gap]]) + np.array([i, j])
        marks = _corners_of_square(board, int(i), int(j))
    else:
        own = 4 * number + np.array(APRILTAG_MARKS)
        flat = crossings.places[own]
        marks = _corners_of_tags(board, crossings, number)
    homography = cv2.getPerspectiveTransform(flat.astype(np.float32), outline.astype(np.float32))
    return np.asarray(homography, float), marks


def _corners_of_square(board: CharucoBoard, i: int, j: int) -> Iterator[tuple[int, FloatArray, bool]]:
    """The inner corners at square (i, j): number, place in squares."""
    for x in (i, i + 1):
        for y in (j, j + 1):
            if 0 < x < board.squares_x and 0 < y < board.squares_y:
                yield (y - 1) * (board.squares_x - 1) + x - 1, np.array([x, y], float), True


def _corners_of_tags(board: CodedBoard, crossings: Crossings, number: int) -> Iterator[tuple[int, FloatArray, bool]]:
    """The corners of a tag, and the nearest two of each tag beside it: number, place, whether its own."""
    own = crossings.places[4 * number : 4 * number + 4]
    for k, place in enumerate(own):
        yield 4 * number + k, place, True
    apart = np.abs(crossings.places[:, None] - own).max(-1).min(1)
    for mark in np.flatnonzero((apart > 0) & (apart < 1)):
        yield int(mark), crossings.places[mark], False


def _confirmed(votes: dict[int, list[_Vote]]) -> set[tuple[int, int]]:
    """Markers for which a neighbour predicts a common mark at the same place.

    Chance readings, and the readings of a mirrored picture, have no such neighbour.
    """
    confirmed: set[tuple[int, int]] = set()
    for said in votes.values():
        for k, vote in enumerate(said):
            for other in said[k + 1 :]:
                if vote.marker[0] != other.marker[0] and (vote.own or other.own) and _agree(vote, other):
                    confirmed |= {vote.marker, other.marker}
    return confirmed


def _apply(homography: FloatArray, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The image (2,) of a place on the paper and the derivative (2, 2) there."""
    u, v, w = homography @ [*place, 1.0]
    pixel = np.array([u, v]) / w
    return pixel, (homography[:2, :2] - np.outer(pixel, homography[2, :2])) / w


def _agree(vote: _Vote, other: _Vote) -> bool:
    """Whether two predictions are of one place, one scale and one orientation."""
    apart = np.linalg.norm(np.linalg.solve(vote.step + other.step, 2 * (vote.pixel - other.pixel)))
    differ = np.linalg.norm(vote.step - other.step) / np.linalg.norm(vote.step + other.step)
    return bool(apart < (_AGREE if vote.own and other.own else _BESIDE) and differ < 0.25)
