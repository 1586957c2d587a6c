"""In which order an uncoded board's marks are numbered: turns that look the same, mirrored grids, views made to agree.

A chessboard or a grid of circles turned by half, or by a quarter where it is square, may look as before.  A picture
then cannot say which of its corners is the first.  Any of these orders calibrates equally well; but errors by point,
and the bow of a board, mean something only where all views number the marks alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fullsphere.model.calibration.board import Board
from fullsphere.model.calibration.boards import Chessboard, CirclesGrid
from fullsphere.model.lens import FloatArray

_TURNS = tuple(np.array([[c, -s], [s, c]], float) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)))
_SAME = 1e-6  # of the board's extent


def equivalent_orders(board: Board) -> NDArray[np.intp]:
    """The orders (k, n) of a board's marks that its looks cannot tell apart; the first is the identity.

    If a picture shows mark m at pixels[m], then pixels[order] is as good a reading of it.  Boards other than
    `Chessboard` and `CirclesGrid` have only the identity.
    """
    return np.array([order for order, _ in _turns_alike(board)], np.intp)


def viewer_orders(marks: FloatArray, pixels: FloatArray) -> list[NDArray[np.intp]]:
    """The orders (n,) in which a whole regular grid was not seen as in a mirror: det(d pixel/d mark) > 0.

    Parameters
    ----------
    marks
        All marks (n, 2) on the paper.
    pixels
        Where they were found (n, 2), in some order that is right but for a turn or a reflection of the grid.

    Returns
    -------
    Orders; with each, pixels[order] are a reading of the marks in which x to the right and y down on the paper are so
    for the viewer.  Whether the colours of a chessboard fit is not looked at.
    """
    mirrored = _mean_determinant(marks, pixels) < 0
    flip = np.diag([-1.0, 1.0]) if mirrored else np.eye(2)
    orders = [_permutation(marks, turn @ flip) for turn in _TURNS]
    return [order for order in orders if order is not None]


def aligned(board: Board, camera_from_target: FloatArray) -> NDArray[np.intp]:
    """Which of the equivalent orders each view should take so that all views number the board's marks alike.

    In every view the order is chosen that makes the board's rotation nearest to that of a reference: of all
    views the one whose rotation is nearest to all the others, by the sum of the angles, which a few odd views do not
    move (a median).  Boards are mostly held, or a camera is mostly held, one way up; a view that really was turned by
    half cannot be told from one that was not.

    Parameters
    ----------
    camera_from_target
        Rotations (V, 3, 3) of the board's views, each from the marks in the order in which they were found.

    Returns
    -------
    Rows (V,) of `equivalent_orders(board)`: pixels[orders[row]] are the view's marks in the common order.  Its
    rotation and translation change with it; solve for them anew.
    """
    alike = _turns_alike(board)
    if len(alike) == 1 or not len(camera_from_target):
        return np.zeros(len(camera_from_target), np.intp)
    about = board.placement.target_from_board[:3, :3]
    candidates = np.stack([camera_from_target @ about @ _in_space(turn) @ about.T for _, turn in alike], 1)
    # angle between the reference, view v as found, and candidate k of view w
    cosine = (np.einsum("vij,wkij->vwk", camera_from_target, candidates) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    reference = int(np.argmin(angle.min(-1).sum(-1)))
    return np.asarray(np.argmin(angle[reference], -1), np.intp)


def _turns_alike(board: Board) -> list[tuple[NDArray[np.intp], FloatArray]]:
    """Orders and turns (2, 2) of the paper: where order[m] is the place that the turn brings mark m to."""
    marks = board.marks_on_paper()
    if not isinstance(board, Chessboard | CirclesGrid):
        return [(np.arange(len(marks)), np.eye(2))]
    found = []
    for turn in _TURNS:
        order = _permutation(marks, turn)
        if order is not None and (not isinstance(board, Chessboard) or _keeps_colours(board, turn)):
            found.append((order, turn))
    return found


def _keeps_colours(board: Chessboard, turn: FloatArray) -> bool:
    row, column = np.indices((board.rows + 1, board.columns + 1)).reshape(2, -1)
    black = (row + column) % 2 == 0
    order = _permutation(np.stack([column, row], -1).astype(float), turn)
    return order is not None and bool(np.array_equal(black[order], black))


def _permutation(points: FloatArray, motion: FloatArray) -> NDArray[np.intp] | None:
    """The numbers (n,) of the points on which a motion (2, 2) about their middle puts each; None if on no point."""
    centred = points - (points.min(0) + points.max(0)) / 2
    distance, place = cKDTree(centred).query(centred @ motion.T)
    return np.asarray(place, np.intp) if np.max(distance) < _SAME * np.ptp(points, axis=0).max() else None


def _in_space(turn: FloatArray) -> FloatArray:
    """The rotation (3, 3) about z."""
    rotation = np.eye(3)
    rotation[:2, :2] = turn
    return rotation


def _mean_determinant(marks: FloatArray, pixels: FloatArray) -> float:
    """Of the best affine map from the paper to pixels."""
    design = np.column_stack([marks, np.ones(len(marks))])
    return float(np.linalg.det(np.linalg.lstsq(design, pixels, rcond=None)[0][:2]))
