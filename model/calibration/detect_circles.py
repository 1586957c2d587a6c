"""Finds a grid of black discs in the photo of an ultra-wide lens.

OpenCV finds the discs as blobs; they are numbered from neighbour to neighbour, a smooth map from the paper to the
picture confirms it, and each disc's centre of gravity is then measured in linear light.  That is not the image of the
disc's centre: `disc_images.centre_offset` gives the difference, once a camera is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import CirclesGrid
from fullsphere.model.calibration.lattice import numbered
from fullsphere.model.lens import FloatArray

_SEARCHED_PX = 1600  # longer side: a larger picture is searched reduced first, a smaller one enlarged later
_SMALLEST_PX2 = 12.0  # area of a disc in the searched picture
_LARGEST_SHARE = 0.02  # area of a disc in that of the picture
_MOST_UNEVEN = 0.25  # residual of the smooth map in distances of neighbours
_DEGREE = 3  # of the smooth map
_GATHERINGS = 3  # the window follows the disc
_LEAST_CONTRAST = 0.15  # paper minus ink over paper, linear light
_AREA = (0.5, 1.7)  # of a disc found over that of the disc expected
_MOST_SHIFT = 0.3  # diameters from OpenCV's blob
_LEAST_SHARE = 0.8  # of the discs must be credible, or it was no grid
_GOES_ON = 0.6  # of the places one step beyond a side hold a disc: the grid has more rows or columns


class _Chart(NamedTuple):
    """A smooth map from the paper to the picture: polynomials up to `powers` (k, 2) of the scaled marks."""

    middle: FloatArray
    scale: float
    powers: NDArray[np.intp]
    coefficients: FloatArray

    def pixels(self, marks: FloatArray) -> FloatArray:
        """Where the points (n, 2) of the paper are in the picture (n, 2)."""
        return np.asarray(_monomials((marks - self.middle) / self.scale, self.powers) @ self.coefficients, float)

    def steps(self, marks: FloatArray) -> FloatArray:
        """Derivatives (n, 2, 2) of the pixels by x and y, px per mm, by central differences."""
        nudge = 1e-4 * self.scale * np.eye(2)
        return np.stack([(self.pixels(marks + e) - self.pixels(marks - e)) / (2e-4 * self.scale) for e in nudge], -1)


class _Discs(NamedTuple):
    """Measured discs: centres of gravity (n, 2), contrast (n,), and area over the expected area (n,)."""

    pixels: FloatArray
    contrast: FloatArray
    area: FloatArray


def find_circles(grey: NDArray[np.uint8], light: NDArray[np.float32], board: CirclesGrid) -> MarksFound | None:
    """Find the discs of a grid of circles.

    Parameters
    ----------
    grey
        Photo (h, w) as the file has it.
    light
        The same (h, w) in linear light, 0 to 1.
    board
        What to look for.  All of it must be in the picture: a grid that is partly hidden or cut off is not found,
        because its discs carry no numbers.

    Returns
    -------
    The centres of gravity of the discs' images, numbered so that a viewer sees no mirrored grid; where the grid looks
    the same after a turn, in any of `equivalent_orders(board)`.  A few discs that are not clear may be missing.  None
    if there is no such grid, or one of other dimensions.
    """
    for candidate in _candidates(grey, board):
        found = _confirmed(light, board, candidate)
        if found is not None:
            return found
    return None


def _candidates(grey: NDArray[np.uint8], board: CirclesGrid) -> Iterator[FloatArray]:
    """Blobs (n, 2) in pixels of the picture that make a grid like the board.

    OpenCV's `findCirclesGrid` is not used: it takes an asymmetric grid that is wider than high for its transposed, and
    may take minutes over discs that make another grid.
    """
    longest = max(grey.shape)
    usual = min(1.0, _SEARCHED_PX / longest)
    for scale in (usual, 2 * usual if longest * usual <= _SEARCHED_PX / 2 or usual < 1 else 1.5, usual / 2):
        size = tuple(max(1, round(side * scale)) for side in grey.shape[::-1])
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        searched = grey if scale == 1 else cv2.resize(grey, size, interpolation=how)
        detector = cv2.SimpleBlobDetector_create(_blob_settings(size[0] * size[1]))
        spots = detector.detect(searched) if min(size) > 10 else ()
        points = np.array([spot.pt for spot in spots], float).reshape(-1, 2)
        order = numbered(points, np.array([spot.size for spot in spots], float), _lattice_places(board))
        if order is not None:
            yield (points[order] + 0.5) / scale - 0.5


def _lattice_places(board: CirclesGrid) -> NDArray[np.intp]:
    """Column and row (n, 2) of the discs on the lattice of nearest neighbours: that of the diagonals if asymmetric."""
    x, y = np.rint(board.marks_on_paper() / board.spacing_mm).astype(np.intp).T
    return np.stack([(x + y) // 2, (y - x) // 2], -1) if board.asymmetric else np.stack([x, y], -1)


def _blob_settings(pixels: int) -> cv2.SimpleBlobDetector_Params:
    settings = cv2.SimpleBlobDetector_Params()
    settings.minArea, settings.maxArea = _SMALLEST_PX2, max(_LARGEST_SHARE * pixels, 2 * _SMALLEST_PX2)
    settings.minThreshold, settings.maxThreshold, settings.thresholdStep = 10, 245, 8
    settings.minDistBetweenBlobs = 3
    settings.filterByColor, settings.blobColor = True, 0
    settings.filterByConvexity, settings.minConvexity = True, 0.85
    settings.filterByInertia, settings.minInertiaRatio = True, 0.08  # ellipses 1 : 3.5, as at the rim
    settings.filterByCircularity = False
    return settings


def _confirmed(light: NDArray[np.float32], board: CirclesGrid, blobs: FloatArray) -> MarksFound | None:
    """The discs measured in the picture; None if it is not the board."""
    marks = board.marks_on_paper()
    chart = _smooth_map(board, blobs)
    if chart is None:
        return None
    diameter_px = board.diameter_mm * np.linalg.norm(chart.steps(marks), axis=1).min(-1)
    discs = _measured(light, board, blobs, chart.steps(marks))
    with np.errstate(invalid="ignore"):
        good = _are_discs(discs) & (np.linalg.norm(discs.pixels - blobs, axis=1) < _MOST_SHIFT * diameter_px)
    if good.mean() < _LEAST_SHARE or _goes_on(light, board, chart):
        return None
    numbers = np.flatnonzero(good)
    return MarksFound(numbers, discs.pixels[numbers])


def _smooth_map(board: CirclesGrid, blobs: FloatArray) -> _Chart | None:
    """The polynomial map through the blobs; None if they do not lie on one, or it folds the paper or mirrors it."""
    marks = board.marks_on_paper()
    middle, scale = marks.mean(0), float(np.ptp(marks, axis=0).max()) / 2
    across, down = min(_DEGREE, board.columns - 1), min(_DEGREE, board.rows - 1)
    powers = np.array([(i, j) for i in range(across + 1) for j in range(down + 1) if i + j <= max(_DEGREE, 1)])
    design = _monomials((marks - middle) / scale, powers)
    chart = _Chart(middle, scale, powers, np.asarray(np.linalg.lstsq(design, blobs, rcond=None)[0], float))
    steps = chart.steps(marks)
    nearest_px = _nearest_mm(board) * np.linalg.norm(steps, axis=1).min(-1)
    uneven = np.linalg.norm(chart.pixels(marks) - blobs, axis=1) / np.maximum(nearest_px, 1e-9)
    return chart if np.linalg.det(steps).min() > 0 and uneven.max() < _MOST_UNEVEN else None


def _monomials(places: FloatArray, powers: NDArray[np.intp]) -> FloatArray:
    return np.asarray(places[:, :1] ** powers[:, 0] * places[:, 1:] ** powers[:, 1], float)


def _nearest_mm(board: CirclesGrid) -> float:
    """Distance of the centres of the two nearest discs."""
    return board.spacing_mm * (2**0.5 if board.asymmetric else 1.0)


def _measured(light: NDArray[np.float32], board: CirclesGrid, start: FloatArray, px_from_mm: FloatArray) -> _Discs:
    """Centre of gravity of the ink round each start (n, 2), the paper's light taken as a slope under each disc."""
    radius, rim = board.diameter_mm / 2, _nearest_mm(board) / board.diameter_mm
    discs = _Discs(np.full((len(start), 2), np.nan), np.full(len(start), np.nan), np.full(len(start), np.nan))
    for i, (centre, steps) in enumerate(zip(start, px_from_mm, strict=True)):
        for _ in range(_GATHERINGS):
            gathered = _gather(light, centre, steps * radius, rim)
            if gathered is None:
                break
            centre, discs.contrast[i], discs.area[i] = gathered
        else:
            discs.pixels[i] = centre
    return discs


def _gather(
    light: NDArray[np.float32], centre: FloatArray, px_from_radius: FloatArray, rim: float
) -> tuple[FloatArray, float, float] | None:
    """Centre (2,), contrast, and area over the expected one, of the disc at `centre`; None if it is not in the picture.

    Parameters
    ----------
    px_from_radius
        The map (2, 2) from the unit circle to the disc's outline.
    rim
        Half way to the next disc, in radii.
    """
    height, width = light.shape
    reach = rim * np.linalg.norm(px_from_radius, axis=1)
    first = np.maximum(np.floor(centre - reach), 0)
    last = np.minimum(np.ceil(centre + reach), [width - 1, height - 1])
    if not np.isfinite(centre).all() or (first > last).any() or abs(np.linalg.det(px_from_radius)) < 1:
        return None
    columns, rows = np.meshgrid(*(np.arange(a, b + 1, dtype=np.intp) for a, b in zip(first, last, strict=True)))
    relative = np.stack([columns, rows], -1) - centre
    radii = np.linalg.norm(relative @ np.linalg.inv(px_from_radius).T, axis=-1)
    window, paper, core = radii < rim, (radii < rim) & (radii > (1 + rim) / 2), radii < 0.5
    if np.count_nonzero(paper) < 8 or not core.any():
        return None
    values = light[rows, columns].astype(float)
    slope = np.concatenate([np.ones((*relative.shape[:2], 1)), relative], -1)
    background = slope @ np.linalg.lstsq(slope[paper], values[paper], rcond=None)[0]
    ink = np.where(window, background - values, 0.0)
    depth = float(np.mean((background - values)[core]))
    total = float(ink.sum())
    if total <= 0 or depth <= 0:
        return None
    moved = centre + (ink[..., None] * relative).sum((0, 1)) / total
    area = total / depth / (np.pi * abs(float(np.linalg.det(px_from_radius))))
    return moved, depth / max(float(np.mean(background[core])), 1e-6), area


def _are_discs(discs: _Discs) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray((discs.contrast > _LEAST_CONTRAST) & (discs.area > _AREA[0]) & (discs.area < _AREA[1]), bool)


def _goes_on(light: NDArray[np.float32], board: CirclesGrid, chart: _Chart) -> bool:
    """Whether the grid has another row or column of discs on one of its sides: then it is another board."""
    lines = []
    for row in (-1, board.rows):
        shift = row % 2 if board.asymmetric else 0
        column = np.arange(board.columns) * (2 if board.asymmetric else 1) + shift
        lines.append(np.stack([column, np.full(board.columns, row)], -1))
    for past in (-1, board.columns):
        rows = np.arange(board.rows)
        lines.append(np.stack([2 * past + rows % 2 if board.asymmetric else np.full(board.rows, past), rows], -1))
    for line in lines:
        marks = line * board.spacing_mm
        steps, places = chart.steps(marks), chart.pixels(marks)
        discs = _measured(light, board, places, steps)
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(discs.pixels - places, axis=1) < board.diameter_mm * np.linalg.norm(
                steps, axis=1
            ).min(1)
        if (_are_discs(discs) & near).mean() > _GOES_ON:
            return True
    return False
