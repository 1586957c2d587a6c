"""Rigid calibration targets made of flat ChArUco boards.

A ChArUco board is a chessboard whose white squares hold coded markers, so that every inner corner has a number even
where only part of the board is seen.  Several boards fixed to each other make one three-dimensional target; its
corners are known in one frame, the target's, in millimetres.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Artwork, Board, Placement
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class CharucoBoard(Board):
    """One flat board of a target, printed as OpenCV prints it (not the "legacy" pattern): black first square.

    The board's frame has its origin at the outer corner of the first square, x along the first row, y down the first
    column and z into the paper, so that a viewer sees x to the right and y down.

    Attributes
    ----------
    squares_x, squares_y
        Squares in a row and in a column, at least 2 each.
    square_mm, marker_mm
        Sides of a square and of the marker in a white square.
    first_id
        Markers are numbered from it, row by row; the boards of one target have no number in common.
    dictionary
        OpenCV's name of the marker dictionary, "DICT_5X5_1000" for example.
    placement
        Where the board's paper is in the target's frame.

    Raises
    ------
    UsageError
        If the numbers describe no board.
    """

    squares_x: int
    squares_y: int
    square_mm: float
    marker_mm: float
    first_id: int = 0
    dictionary: str = "DICT_5X5_1000"
    placement: Placement = dataclasses.field(default_factory=Placement)

    def __post_init__(self) -> None:
        if min(self.squares_x, self.squares_y) < 2:
            raise UsageError(f"board: {self.squares_x} x {self.squares_y} squares have no inner corner")
        if not 0 < self.marker_mm < self.square_mm < 1e6:
            raise UsageError(f"board: a marker of {self.marker_mm} mm does not fit a square of {self.square_mm} mm")
        known = len(marker_dictionary(self.dictionary).bytesList)
        if not 0 <= self.first_id <= known - self.marker_count:
            raise UsageError(
                f"board: ids {self.first_id} to {self.first_id + self.marker_count - 1} are not all in "
                f"{self.dictionary}, which has {known}"
            )

    @property
    def marker_count(self) -> int:
        """Markers on the board: one in each white square."""
        return self.squares_x * self.squares_y // 2

    @property
    def corner_count(self) -> int:
        """Inner corners of the chessboard."""
        return (self.squares_x - 1) * (self.squares_y - 1)

    def marker_squares(self) -> NDArray[np.intp]:
        """Column and row (marker_count, 2) of the square of each marker, in the order of the ids."""
        row, column = np.nonzero(np.indices((self.squares_y, self.squares_x)).sum(0) % 2)
        return np.stack([column, row], -1)

    def marks_on_paper(self) -> FloatArray:
        """Inner corners (corner_count, 2), row by row."""
        row, column = np.indices((self.squares_y - 1, self.squares_x - 1)).reshape(2, -1)
        return np.asarray((np.stack([column, row], -1) + 1.0) * self.square_mm, float)

    def artwork(self) -> Artwork:
        """Black squares, and the black modules of the markers in the white ones, with a margin of half a square."""
        raise NotImplementedError


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's predefined dictionary of that name; UsageError if there is none."""
    if not (name.startswith("DICT_") and hasattr(cv2.aruco, name)):
        raise UsageError(f"no marker dictionary {name!r}; OpenCV knows DICT_4X4_50 to DICT_7X7_1000 and others")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def one_dictionary(boards: Sequence[CharucoBoard]) -> str:
    """The dictionary that all boards of a target share.

    Raises
    ------
    UsageError
        If there is no board, the boards differ in dictionary, or two boards share a marker number.
    """
    names = {board.dictionary for board in boards}
    if len(names) != 1:
        raise UsageError(f"a target needs boards of one marker dictionary, not {sorted(names) or 'none'}")
    end = -1
    for board in sorted(boards, key=lambda b: b.first_id):
        if board.first_id <= end:
            raise UsageError(f"two boards of the target both have marker {board.first_id}")
        end = board.first_id + board.marker_count - 1
    return names.pop()


@dataclasses.dataclass(frozen=True, eq=False)
class Target:
    """A rigid calibration target: one board, or several of one kind fixed to each other.

    Attributes
    ----------
    name
        What to call it in messages: the text it was specified by, or the name of its file.
    boards
        Its boards.  Marks are numbered over all of them: those of the first board, then those of the second, ...
    points
        All marks (N, 3) in the target's frame, mm; a mark's number is its row here.

    Raises
    ------
    UsageError
        If there is no board, or the boards do not make one target.
    """

    name: str
    boards: tuple[Board, ...]
    points: FloatArray = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.boards:
            raise UsageError(f"{self.name}: a target has at least one board")
        kind = type(self.boards[0])
        if any(type(board) is not kind for board in self.boards):
            raise UsageError(f"{self.name}: the boards of a target are of one kind")
        object.__setattr__(self, "points", np.concatenate([board.marks_on_target() for board in self.boards]))

    @property
    def first_marks(self) -> NDArray[np.intp]:
        """The number of the first mark of each board."""
        counts = [len(board.marks_on_paper()) for board in self.boards]
        return np.cumsum([0, *counts[:-1]])
