"""Finds a plain chessboard in the photo of an ultra-wide lens.

OpenCV's two detectors say where the grid of corners is, tried in several sizes and contrasts of the picture, the cheap
ones first.  Each corner is then fitted in the picture as the crossing of two blurred edges, and what OpenCV said is
believed only if these crossings alternate as the squares of a chessboard do and the grid runs on smoothly.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import Chessboard
from fullsphere.model.calibration.mark_order import viewer_orders
from fullsphere.model.calibration.saddle import Saddles, fit_saddles
from fullsphere.model.lens import FloatArray

_CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_SECTOR = cv2.CALIB_CB_NORMALIZE_IMAGE
_THOROUGH = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
_SEARCHED_PX = 1600  # longer side: a larger picture is searched reduced first, a smaller one enlarged later
_THOROUGH_PX = 1300  # the thorough search takes a second at this size
_CLEAR, _REACH = 1.0, 0.4  # squares, see `fit_saddles`: there is no marker, and the next corner is 1 away
_NARROW_REACH, _NARROW_PX = 0.6, 8  # so that squares as small as this give pixels enough
_LEAST_SINE = 0.05  # of the angle between a square's sides; flatter ones have no corner to fit
_MOST_SHIFT, _MOST_SHIFT_PX = 0.3, 2.5  # squares, but at least so many pixels: OpenCV's corner may be wrong by that
_MOST_SIGMA_PX = 0.3
_MOST_MISFIT = 0.35  # residual RMS over contrast; noisy photos come near it with corners good to 0.1 px
_LEAST_CONTRAST = 0.01  # of full scale
_LEAST_SHARE = 0.75  # of the corners must be credible, or it was no chessboard
_LEAST_SHARE_OF_LINE = 0.5  # of each row and column: the outer ones may be the board's edge, taken for corners
_MOST_BEND = 0.6  # second difference over first: neighbouring squares differ in size by less than a factor of 1.9
_GOES_ON = 0.6  # of the places one square further: the board has more rows or columns than was asked for


def find_chessboard(grey: NDArray[np.uint8], light: NDArray[np.float32], board: Chessboard) -> MarksFound | None:
    """Find the inner corners of a chessboard.

    Parameters
    ----------
    grey
        Photo (h, w) as the file has it.
    light
        The same (h, w) in linear light, 0 to 1.
    board
        What to look for.  All of it must be in the picture: a board that is partly hidden or cut off is not found,
        because its corners carry no numbers.

    Returns
    -------
    The corners, numbered so that a viewer sees no mirrored board and, where its colours can tell, the black first
    square first; where they cannot, in any of `equivalent_orders(board)`.  A few corners that are no clear crossing
    of two edges may be missing.  None if there is no such board, or one of other dimensions.
    """
    for candidate, scale in _candidates(grey, board.columns, board.rows):
        found = _confirmed(grey, light, board, candidate, scale)
        if found is not None:
            return found
    return None


def seen_chessboards(grey: NDArray[np.uint8]) -> list[tuple[int, int]]:
    """Inner corners (columns, rows) of a chessboard of any dimensions, to tell what is there instead of the target.

    Parameters
    ----------
    grey
        Photo (h, w).

    Returns
    -------
    At most one pair, the larger number first: a picture does not say which way round a board is meant.  Of a board that
    is hard to see it may be a part: trust what several photos agree on.
    """
    codes = grey.astype(np.float32) / np.float32(255)
    usual = min(1.0, _THOROUGH_PX / max(grey.shape))
    best: tuple[int, int] | None = None
    for scale in (usual, usual / 2, 2 * usual if usual == 1 and max(grey.shape) <= _THOROUGH_PX / 2 else usual / 1.4):
        try:
            seen, corners, meta = cv2.findChessboardCornersSBWithMeta(
                _scaled(grey, scale), (3, 3), _THOROUGH | cv2.CALIB_CB_LARGER
            )
        except cv2.error:  # a picture too small for the detector
            continue
        rows, columns = np.asarray(meta).shape[:2] if seen else (0, 0)
        candidate = (np.asarray(corners, float).reshape(-1, 2) + 0.5) / scale - 0.5 if seen else np.empty((0, 2))
        if min(rows, columns) < 3 or rows * columns != len(candidate) or (best and rows * columns <= best[0] * best[1]):
            continue
        if _confirmed(grey, codes, Chessboard(columns, rows, 1.0), candidate, scale) is not None:
            best = (max(columns, rows), min(columns, rows))
    return [best] if best else []


def _candidates(grey: NDArray[np.uint8], columns: int, rows: int) -> Iterator[tuple[FloatArray, float]]:
    """Grids (rows * columns, 2) in pixels of the picture that OpenCV takes for the board, and the search's scale."""
    longest = max(grey.shape)
    usual = min(1.0, _SEARCHED_PX / longest)
    finer = 2.0 * usual if longest * 2 * usual <= 2 * _SEARCHED_PX else 1.0
    thorough = min(1.0, _THOROUGH_PX / longest)
    even = cv2.createCLAHE(clipLimit=4.0, tileGridSize=(8, 8))
    for scale, flags, local_contrast in (
        (usual, _CLASSIC, False),
        (usual, _CLASSIC | cv2.CALIB_CB_FILTER_QUADS, False),
        (finer, _CLASSIC, False),
        (usual, _CLASSIC, True),
        (usual, _SECTOR, False),
        (finer, _CLASSIC, True),
        (thorough, _THOROUGH, False),
        (thorough, _THOROUGH, True),
    ):
        picture = _scaled(grey, scale)
        picture = even.apply(picture) if local_contrast else picture
        try:
            if flags & cv2.CALIB_CB_ADAPTIVE_THRESH:
                seen, corners = cv2.findChessboardCorners(picture, (columns, rows), flags=flags)
            else:
                seen, corners = cv2.findChessboardCornersSB(picture, (columns, rows), flags=flags)
        except cv2.error:  # a picture too small for the detector
            continue
        if seen and len(corners) == columns * rows:
            yield (np.asarray(corners, float).reshape(-1, 2) + 0.5) / scale - 0.5, scale


def _scaled(grey: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    if scale == 1:
        return np.ascontiguousarray(grey)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    size = tuple(max(1, round(side * scale)) for side in grey.shape[::-1])
    return np.asarray(cv2.resize(grey, size, interpolation=how), np.uint8)


def _confirmed(
    grey: NDArray[np.uint8], light: NDArray[np.float32], board: Chessboard, candidate: FloatArray, scale: float
) -> MarksFound | None:
    """The candidate's corners fitted in the picture and put in order; None if it is not the board."""
    shape = (board.rows, board.columns)
    corners = candidate[viewer_orders(board.marks_on_paper(), candidate)[0]]
    if not _is_regular(corners.reshape(*shape, 2), grey.shape):
        return None
    if scale < 1:
        corners = _fitted_in_reduced(light, corners, shape, scale)
    picture, found = _best_fit(grey, light, corners, steps_of_grid(corners.reshape(*shape, 2)))
    row, column = np.divmod(np.arange(len(corners)), board.columns)
    # positive where the square above and left of the corner is black
    upper_left_black = -found.contrast * np.where((row + column) % 2 == 0, 1.0, -1.0)
    first_black = np.nanmedian(upper_left_black) > 0 if np.isfinite(upper_left_black).any() else False
    good = _credible(corners, steps_of_grid(corners.reshape(*shape, 2)), found)
    good &= (upper_left_black > 0) == first_black
    lines = [good.reshape(shape).mean(axis) for axis in (0, 1)]
    if good.mean() < _LEAST_SHARE or min(float(line.min()) for line in lines) < _LEAST_SHARE_OF_LINE:
        return None
    fitted = np.where(good[:, None], found.pixels, corners)
    if not _is_regular(fitted.reshape(*shape, 2), grey.shape):
        return None
    if _goes_on(picture, fitted.reshape(*shape, 2), bool(first_black)):
        return None
    order = _order_by_colour(board, fitted, bool(first_black))
    marks = np.flatnonzero(good[order])
    return MarksFound(marks, fitted[order][marks])


def steps_of_grid(grid: FloatArray) -> FloatArray:
    """Local maps (rows * columns, 2, 2) from steps along x and y on a regular grid to pixels, from its neighbours.

    Parameters
    ----------
    grid
        Pixels (rows, columns, 2), NaN where unknown; the maps there and beside are NaN.
    """
    along_x, along_y = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    return np.asarray(np.stack([along_x, along_y], -1).reshape(-1, 2, 2), float)


def _is_regular(grid: FloatArray, picture: tuple[int, ...]) -> bool:
    """Whether a grid (rows, columns, 2) lies in the picture, is not folded and bends only as a lens bends it."""
    height, width = picture
    if not np.all((grid >= 0) & (grid <= [width - 1, height - 1])):
        return False
    bends = []
    for axis in (0, 1):
        step = np.diff(grid, axis=axis)
        before, after = (np.take(step, range(i, step.shape[axis] - 1 + i), axis) for i in (0, 1))
        length = np.linalg.norm(before, axis=-1) + np.linalg.norm(after, axis=-1)
        bends.append(np.linalg.norm(after - before, axis=-1) / np.maximum(length / 2, 1e-9))
    right, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
    turning = [
        r[..., 0] * d[..., 1] - r[..., 1] * d[..., 0]
        for r, d in ((right[:-1], down[:, :-1]), (right[1:], down[:, 1:]), (right[1:], down[:, :-1]))
    ]
    unfolded = min(float(t.min()) for t in turning) > 0
    return unfolded and max(float(bend.max()) for bend in bends) < _MOST_BEND


def _fitted_in_reduced(
    light: NDArray[np.float32], corners: FloatArray, shape: tuple[int, int], scale: float
) -> FloatArray:
    """Corners of a search in the reduced picture, made exact there first: a pixel there is several of the original."""
    height, width = light.shape
    reduced = cv2.resize(light, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
    start = (corners + 0.5) * scale - 0.5
    steps = steps_of_grid(start.reshape(*shape, 2))
    found = _fit(np.asarray(reduced, np.float32), start, steps)
    better = _credible(start, steps, found)
    return (np.where(better[:, None], found.pixels, start) + 0.5) / scale - 0.5


def _best_fit(
    grey: NDArray[np.uint8], light: NDArray[np.float32], corners: FloatArray, steps: FloatArray
) -> tuple[NDArray[np.float32], Saddles]:
    """The corners fitted in linear light or in the file's own codes, and the picture that was used.

    Blurred edges are symmetrical in light; but few cameras follow the sRGB curve, and cheap ones blur and sharpen the
    codes.  The one whose edges are the more symmetrical is taken, by the median misfit.
    """
    pictures = (light, grey.astype(np.float32) / np.float32(255))
    fits = [_fit(picture, corners, steps) for picture in pictures]
    misfits = [np.median(np.where(np.isfinite(fit.misfit), fit.misfit, np.inf)) for fit in fits]
    best = int(np.argmin(misfits))
    return pictures[best], fits[best]


def _fit(picture: NDArray[np.float32], corners: FloatArray, steps: FloatArray) -> Saddles:
    """`fit_saddles` with windows that fit the local squares; NaN where the map of the squares is none."""
    count = len(corners)
    result = Saddles(*(np.full(shape, np.nan) for shape in ((count, 2), count, count, count)))
    square = _square_px(steps)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(corners).all(1) & (np.linalg.det(steps) > _LEAST_SINE * square**2)
    for chosen, reach in ((known & (square < _NARROW_PX), _NARROW_REACH), (known & (square >= _NARROW_PX), _REACH)):
        if chosen.any():
            fitted = fit_saddles(picture, corners[chosen], steps[chosen], _CLEAR, reach)
            for whole, part in zip(result, fitted, strict=True):
                whole[chosen] = part
    return result


def _square_px(steps: FloatArray) -> FloatArray:
    """The shorter side (n,) of the squares in pixels."""
    return np.asarray(np.linalg.norm(steps, axis=1).min(-1))


def _credible(corners: FloatArray, steps: FloatArray, found: Saddles) -> NDArray[np.bool_]:
    """Which fits (n,) are chess corners: near where OpenCV saw them, sharp and well fitted."""
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(found.pixels - corners, axis=-1)
        square = _square_px(steps)
        return np.asarray(
            (moved < np.minimum(np.maximum(_MOST_SHIFT * square, _MOST_SHIFT_PX), 0.5 * square))
            & (np.abs(found.contrast) > _LEAST_CONTRAST)
            & (found.sigma_px < _MOST_SIGMA_PX)
            & (found.misfit < _MOST_MISFIT)
        )


def _goes_on(picture: NDArray[np.float32], grid: FloatArray, first_black: bool) -> bool:
    """Whether the chessboard has another row or column of corners on one of its sides: then it is another board."""
    height, width = picture.shape
    places, maps, signs = [], [], []
    for turn in range(4):
        turned = np.rot90(grid, turn)  # the side looked at is the first row
        beyond = 3 * turned[0] - 3 * turned[1] + turned[2]
        places.append(beyond)
        maps.append(np.stack([np.gradient(beyond, axis=0), turned[0] - beyond], -1))
        parity = np.rot90(np.indices(grid.shape[:2]).sum(0), turn)[0] % 2
        signs.append(np.where(parity == 0, 1.0, -1.0) * (-1.0) ** turn)  # of a crossing there if the first is black
    beyond, steps = np.concatenate(places), np.concatenate(maps)
    inside = np.all((beyond >= 0) & (beyond <= [width - 1, height - 1]), axis=1)
    found = _fit(picture, np.where(inside[:, None], beyond, np.nan), steps)
    expected = np.concatenate(signs) * (1.0 if first_black else -1.0)
    crossing = _credible(beyond, steps, found) & (expected * found.contrast > 0)
    sides = np.split(crossing, np.cumsum([len(place) for place in places])[:-1])
    return any(side.mean() > _GOES_ON for side in sides)


def _order_by_colour(board: Chessboard, corners: FloatArray, first_black: bool) -> NDArray[np.intp]:
    """An order (n,) of the viewer's in which the first square is black, if there is one."""
    for order in viewer_orders(board.marks_on_paper(), corners):
        row, column = divmod(int(order[0]), board.columns)
        # which side of the found corner the first square is on: away from the grid's inside
        near_x, near_y = column == 0, row == 0
        same_square_colour = near_x == near_y  # upper left and lower right of a corner are of one colour
        black_upper_left = ((row + column) % 2 == 0) == first_black
        if black_upper_left == same_square_colour:
            return order
    return viewer_orders(board.marks_on_paper(), corners)[0]
