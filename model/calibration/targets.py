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
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class CharucoBoard:
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
    target_from_board
        Rigid motion (4, 4) that takes points of the board's frame to the target's, mm.

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
    target_from_board: FloatArray = dataclasses.field(default_factory=lambda: np.eye(4), repr=False)

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
        pose = np.array(self.target_from_board, float)
        turn = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        rigid = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
        if not (rigid and np.allclose(pose[3], [0, 0, 0, 1])):
            raise UsageError("board: target_from_board is not a rigid motion (4 x 4)")
        pose.flags.writeable = False
        object.__setattr__(self, "target_from_board", pose)

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

    def corners_on_board(self) -> FloatArray:
        """Inner corners (corner_count, 2) on the board, mm, row by row: the number of a corner is its row here."""
        row, column = np.indices((self.squares_y - 1, self.squares_x - 1)).reshape(2, -1)
        return np.asarray((np.stack([column, row], -1) + 1.0) * self.square_mm, float)

    def to_target(self, points_on_board: ArrayLike) -> FloatArray:
        """Points (..., 2) on the board's paper -> (..., 3) in the target's frame, mm."""
        flat = np.asarray(points_on_board, float)
        pose = self.target_from_board
        moved: FloatArray = flat @ pose[:3, :2].T + pose[:3, 3]
        return moved

    def corners_on_target(self) -> FloatArray:
        """Inner corners (corner_count, 3) in the target's frame, mm, in the order of `corners_on_board`."""
        return self.to_target(self.corners_on_board())


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
