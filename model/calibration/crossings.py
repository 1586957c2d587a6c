"""Marks that are crossings of two edges between black and white: where on the paper, how coloured, how undisturbed.

Chess corners and the corners of the tags of an AprilTag grid are alike in this, so that one fit measures both and one
set of tests says whether what was fitted is the mark.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Board
from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard
from fullsphere.model.calibration.saddle import Saddles, fit_saddles
from fullsphere.model.lens import FloatArray

_MOST_SHIFT = 0.12  # squares: a mark lies this near its prediction, or the fit has run off to something else
_MOST_SIGMA_PX = 0.12
_MOST_MISFIT = 0.15  # residual RMS over contrast: noise and blur stay below, anything that is no corner above
_LEAST_CONTRAST = 0.02  # of full scale, linear light
_CODE_MODULES = 6  # across the code of a tag of family 36h11


class Crossings(NamedTuple):
    """The crossings of a board.

    Attributes
    ----------
    places
        (n, 2) on the paper, in squares (tags): the unit of everything here.
    square_mm
        That unit.
    clear, reach
        As `fit_saddles` takes them.
    first_black
        (n,) 1 where the quadrant to the left of and above the crossing is black, -1 where it is white.
    """

    places: FloatArray
    square_mm: float
    clear: float
    reach: float
    first_black: FloatArray


def crossings_of(board: Board) -> Crossings:
    """The marks of a board as crossings; TypeError for a board whose marks are none."""
    if isinstance(board, AprilGrid):
        # left below, right below, right above, left above of each tag
        colours = np.tile([-1.0, 1.0, -1.0, 1.0], board.marker_count)
        border = board.border_modules / (_CODE_MODULES + 2 * board.border_modules)
        places = board.marks_on_paper() / board.tag_mm
        return Crossings(places, board.tag_mm, min(border, board.spacing), 0.9 * board.spacing, colours)
    if isinstance(board, CharucoBoard):
        clear, reach, square_mm = (1 - board.marker_mm / board.square_mm) / 2, 0.3, board.square_mm
    elif isinstance(board, Chessboard):
        clear, reach, square_mm = 1.0, 0.4, board.square_mm
    else:
        raise TypeError(f"the marks of a {type(board).__name__} are no crossings")
    places = board.marks_on_paper() / square_mm
    first_black = 1.0 - 2.0 * (np.rint(places).sum(-1) % 2)
    return Crossings(places, square_mm, clear, reach, first_black)


def fit_crossings(
    light: NDArray[np.float32],
    crossings: Crossings,
    start: FloatArray,
    px_from_square: FloatArray,
    bend: FloatArray | None = None,
) -> Saddles:
    """Fit crossings near `start` (n, 2), where a square's sides are `px_from_square` (n, 2, 2) and its lines bend."""
    return fit_saddles(light, start, px_from_square, crossings.clear, crossings.reach, bend)


def credible(
    crossings: Crossings,
    marks: NDArray[np.intp],
    expected: FloatArray,
    px_from_square: FloatArray,
    found: Saddles,
    most_shift: float = _MOST_SHIFT,
) -> NDArray[np.bool_]:
    """Which fits (n,) are the marks: near the prediction, of the board's own sign, sharp and well fitted."""
    with np.errstate(invalid="ignore"):
        moved = np.linalg.solve(px_from_square, (found.pixels - expected)[..., None])[..., 0]
        return np.asarray(
            (np.linalg.norm(moved, axis=-1) < most_shift)
            & (
                -crossings.first_black[marks] * found.contrast * np.sign(np.linalg.det(px_from_square))
                > _LEAST_CONTRAST
            )
            & (found.sigma_px < _MOST_SIGMA_PX)
            & (found.misfit < _MOST_MISFIT)
        )
