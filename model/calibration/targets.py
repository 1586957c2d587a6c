"""Rigid calibration targets: boards fixed to each other, their marks known in one frame, the target's, in mm."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Board
from fullsphere.model.calibration.boards import CodedBoard, one_dictionary
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray


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
        If there is no board, the boards are of several kinds or dictionaries, or two have a marker in common.
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
        coded = [board for board in self.boards if isinstance(board, CodedBoard)]
        if coded:
            try:
                one_dictionary(coded)
            except UsageError as error:
                raise UsageError(f"{self.name}: {error}") from error
        object.__setattr__(self, "points", np.concatenate([board.marks_on_target() for board in self.boards]))

    @property
    def first_marks(self) -> NDArray[np.intp]:
        """The number of the first mark of each board."""
        counts = [len(board.marks_on_paper()) for board in self.boards]
        return np.cumsum([0, *counts[:-1]])
