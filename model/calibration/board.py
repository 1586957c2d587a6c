"""What every board of a calibration target has: marks at known places on paper, and paper at a known place in space."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Placement:
    """Where a board's paper is in the target's frame: a flat sheet, or a strip rolled into (part of) a tube.

    The board's frame has x along its rows, y down its columns and z into the paper, so that a viewer sees x to the
    right and y down.  A rolled board touches that plane along x = 0 and bends towards the viewer, who is inside the
    tube: its axis is parallel to y at z = -radius.

    Attributes
    ----------
    target_from_board
        Rigid motion (4, 4), mm.
    radius_mm
        Of the tube; infinite for a flat board.

    Raises
    ------
    UsageError
        If the motion is not rigid, or the radius not positive.
    """

    target_from_board: FloatArray = dataclasses.field(default_factory=lambda: np.eye(4), repr=False)
    radius_mm: float = math.inf

    def __post_init__(self) -> None:
        pose = np.array(self.target_from_board, float)
        turn = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        rigid = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
        if not (rigid and np.allclose(pose[3], [0, 0, 0, 1])):
            raise UsageError("board: target_from_board is not a rigid motion (4 x 4)")
        if not self.radius_mm > 0:
            raise UsageError(f"board: a tube has a positive radius, not {self.radius_mm} mm")
        pose.flags.writeable = False
        object.__setattr__(self, "target_from_board", pose)

    @property
    def is_flat(self) -> bool:
        """Whether the paper is not rolled."""
        return math.isinf(self.radius_mm)

    def lift(self, points_on_paper: ArrayLike) -> FloatArray:
        """Points (..., 2) on the paper, mm -> (..., 3) in the target's frame, mm.

        On a tube of radius R the point (x, y) is (R sin(x/R), y, R (cos(x/R) - 1)) in the board's frame.
        """
        x, y = np.moveaxis(np.asarray(points_on_paper, float), -1, 0)
        if self.is_flat:
            on_board = np.stack([x, y, np.zeros_like(x)], -1)
        else:
            turn, radius = x / self.radius_mm, self.radius_mm
            on_board = np.stack([radius * np.sin(turn), y, -2 * radius * np.sin(turn / 2) ** 2], -1)
        pose = self.target_from_board
        lifted: FloatArray = on_board @ pose[:3, :3].T + pose[:3, 3]
        return lifted


@dataclasses.dataclass(frozen=True, eq=False)
class Artwork:
    """What is printed, black on white, in mm on the board's paper.

    Attributes
    ----------
    lower, upper
        Corners (2,) of the white paper; marks and margin lie inside.
    polygons
        Black shapes, each (k, 2).
    discs
        Black discs (n, 3): x, y, radius.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    polygons: tuple[FloatArray, ...] = ()
    discs: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 3)))


class Board(ABC):
    """One printed sheet of a target; what kind of marks it has is a subclass's matter."""

    placement: Placement

    @abstractmethod
    def marks_on_paper(self) -> FloatArray:
        """The marks (n, 2) on the paper, mm; a mark's number on the board is its row here."""

    @abstractmethod
    def artwork(self) -> Artwork:
        """What to print."""

    def marks_on_target(self) -> FloatArray:
        """The marks (n, 3) in the target's frame, mm, in the order of `marks_on_paper`."""
        return self.placement.lift(self.marks_on_paper())


class MarksFound(NamedTuple):
    """Marks of one board in a picture: their numbers (n,) on the board, ascending and unique, and pixels (n, 2)."""

    marks: NDArray[np.intp]
    pixels: FloatArray
