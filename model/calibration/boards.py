"""The kinds of board a target can be made of: chessboard, ChArUco, Kalibr's AprilTag grid, and grids of circles.

All lengths are in millimetres on the paper, x to the viewer's right and y down; `Placement` says where the paper is.
"""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Artwork, Board, Placement
from fullsphere.model.calibration.shapes import chess_squares, framed, grid, rectangle, rectangles
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray

_MOST_MM = 1e6  # a kilometre of paper
_MOST_COUNT = 1000

APRILTAG_MARKS = (1, 0, 3, 2)
"""Which mark of its tag each corner is that OpenCV reports for an AprilTag: OpenCV holds the codes of family 36h11 half
a turn round from AprilTag's own pictures, so its first corner is the lower right one of the upright tag."""


class CodedBoard(Board):
    """A board whose markers are numbered, so that its marks have numbers wherever part of it is seen."""

    first_id: int
    dictionary: str

    @property
    @abstractmethod
    def marker_count(self) -> int:
        """Markers on the board, numbered from `first_id`."""

    def _demand_ids(self) -> None:
        known = len(marker_dictionary(self.dictionary).bytesList)
        if not 0 <= self.first_id <= known - self.marker_count:
            raise UsageError(
                f"board: ids {self.first_id} to {self.first_id + self.marker_count - 1} are not all in "
                f"{self.dictionary}, which has {known}"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class CharucoBoard(CodedBoard):
    """A chessboard with a marker in each white square, as OpenCV prints it (not "legacy"): black first square.

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
        if not 0 < self.marker_mm < self.square_mm < _MOST_MM:
            raise UsageError(f"board: a marker of {self.marker_mm} mm does not fit a square of {self.square_mm} mm")
        if self.squares_x * self.square_mm > 2 * math.pi * self.placement.radius_mm * (1 + 1e-9):
            raise UsageError(f"board: its rows are longer than a tube of radius {self.placement.radius_mm} mm is round")
        self._demand_ids()

    @property
    def marker_count(self) -> int:
        """Markers on the board: one in each white square."""
        return self.squares_x * self.squares_y // 2

    @property
    def is_closed(self) -> bool:
        """Whether the board is rolled into a whole tube: the last square of a row meets the first."""
        return self.squares_x * self.square_mm > 2 * math.pi * self.placement.radius_mm * (1 - 1e-9)

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
        return (grid(self.squares_x - 1, self.squares_y - 1) + 1.0) * self.square_mm

    def artwork(self) -> Artwork:
        """Black squares, and the black modules of the markers in the white ones, with a margin of half a square.

        A whole tube has no margin where its ends meet.
        """
        shapes = chess_squares(self.squares_x, self.squares_y, self.square_mm)
        gap = (self.square_mm - self.marker_mm) / 2
        for number, square in enumerate(self.marker_squares(), self.first_id):
            black = ~marker_modules(self.dictionary, number)
            shapes += rectangles(black, square * self.square_mm + gap, self.marker_mm / len(black))
        margin = np.array([0.0 if self.is_closed else 0.5, 0.5]) * self.square_mm
        return framed(shapes, np.array([self.squares_x, self.squares_y]) * self.square_mm, margin)


@dataclasses.dataclass(frozen=True, eq=False)
class Chessboard(Board):
    """A plain chessboard with a black first square, counted by its inner corners as OpenCV does.

    The board's frame is that of `CharucoBoard`: origin at the outer corner of the first square, x along the first row.
    OpenCV's detectors may begin at the other end: its `findChessboardCornersSB` at a white corner where there is one.

    Attributes
    ----------
    columns, rows
        Inner corners in a row and in a column, at least 3 each (OpenCV's detectors find none of fewer); one square
        more lies in each direction.
    square_mm
        Side of a square.
    placement
        Where the board's paper is in the target's frame.

    Raises
    ------
    UsageError
        If the numbers describe no board.
    """

    columns: int
    rows: int
    square_mm: float
    placement: Placement = dataclasses.field(default_factory=Placement)

    def __post_init__(self) -> None:
        _demand_count(self.columns, self.rows, 3, "inner corners")
        _demand_length(self.square_mm, "square")

    def marks_on_paper(self) -> FloatArray:
        """Inner corners (columns * rows, 2), row by row."""
        return (grid(self.columns, self.rows) + 1.0) * self.square_mm

    def artwork(self) -> Artwork:
        """Black squares, with a margin of one square, which OpenCV's detectors need."""
        shapes = chess_squares(self.columns + 1, self.rows + 1, self.square_mm)
        margin = np.full(2, self.square_mm)
        return framed(shapes, np.array([self.columns + 1, self.rows + 1]) * self.square_mm, margin)


@dataclasses.dataclass(frozen=True, eq=False)
class CirclesGrid(Board):
    """Black discs in rows and columns, or staggered ("asymmetric"), numbered as OpenCV's `findCirclesGrid` does.

    The board's frame has its origin at the centre of the first disc.

    Attributes
    ----------
    columns, rows
        Discs in a row, and rows: OpenCV's patternSize; at least 2 each.
    spacing_mm
        Distance of neighbouring rows.  In a symmetric grid also that of neighbours in a row; in an asymmetric one those
        are twice as far apart, and every second row is shifted by once the spacing: disc j of row i is centred at
        ((2 j + i % 2) spacing, i spacing).
    diameter_mm
        Of a disc.
    asymmetric
        Whether every second row is shifted.
    placement
        Where the board's paper is in the target's frame.

    Raises
    ------
    UsageError
        If the numbers describe no board, or its discs touch.
    """

    columns: int
    rows: int
    spacing_mm: float
    diameter_mm: float
    asymmetric: bool = False
    placement: Placement = dataclasses.field(default_factory=Placement)

    def __post_init__(self) -> None:
        _demand_count(self.columns, self.rows, 2, "circles")
        _demand_length(self.spacing_mm, "spacing")
        nearest = self.spacing_mm * (2**0.5 if self.asymmetric else 1)
        if not 0 < self.diameter_mm < nearest:
            raise UsageError(
                f"board: circles of {self.diameter_mm:g} mm do not fit a spacing of {self.spacing_mm:g} mm"
            )

    def marks_on_paper(self) -> FloatArray:
        """Centres of the discs (columns * rows, 2), row by row."""
        column, row = grid(self.columns, self.rows).T
        if self.asymmetric:
            column = 2 * column + row % 2
        return np.stack([column, row], -1) * self.spacing_mm

    def artwork(self) -> Artwork:
        """The discs, with a margin of one spacing round their centres and half a diameter more."""
        centres, radius = self.marks_on_paper(), self.diameter_mm / 2
        margin = self.spacing_mm + radius
        discs = np.column_stack([centres, np.full(len(centres), radius)])
        width, height = centres.max(0) + margin
        return Artwork((-margin, -margin), (float(width), float(height)), (), discs)


@dataclasses.dataclass(frozen=True, eq=False)
class AprilGrid(CodedBoard):
    """Kalibr's grid of AprilTags of family 36h11, with black squares between that make each corner a crossing.

    Tags are numbered from the lower left one, to the right and then upwards, and their corners are the marks: four for
    each tag, from its lower left corner against the clock (lower left, lower right, upper right, upper left).  The
    board's frame has its origin at the lower left corner of the first tag, as Kalibr's has, but y down and z into the
    paper: a point (x, y) of Kalibr's is (x, -y) here.

    Attributes
    ----------
    columns, rows
        Tags in a row and in a column.
    tag_mm
        Side of a tag, its black border included.
    spacing
        Gap between two tags, in sides of a tag: Kalibr's tagSpacing.
    first_id
        Number of the first tag.
    border_modules
        Width of a tag's black border, in modules of its code: 2 as Kalibr prints it, 1 in AprilTag's own pictures.
    placement
        Where the board's paper is in the target's frame.
    dictionary
        OpenCV's name of the tag family.

    Raises
    ------
    UsageError
        If the numbers describe no board.
    """

    columns: int
    rows: int
    tag_mm: float
    spacing: float
    first_id: int = 0
    border_modules: int = 2
    placement: Placement = dataclasses.field(default_factory=Placement)
    dictionary: str = dataclasses.field(default="DICT_APRILTAG_36h11", init=False)

    def __post_init__(self) -> None:
        _demand_count(self.columns, self.rows, 1, "tags")
        _demand_length(self.tag_mm, "tag")
        if not 0 < self.spacing < 1:
            raise UsageError(f"board: a gap of {self.spacing:g} tag sides; between 0 and 1 it can be, Kalibr's is 0.3")
        if self.border_modules not in (1, 2):
            raise UsageError(f"board: a tag's border is 1 or 2 modules wide, not {self.border_modules}")
        self._demand_ids()

    @property
    def marker_count(self) -> int:
        """Tags on the board."""
        return self.columns * self.rows

    def marks_on_paper(self) -> FloatArray:
        """Corners of the tags (4 * marker_count, 2), tag by tag, each from its lower left corner against the clock."""
        corners = np.array([[0, 0], [1, 0], [1, -1], [0, -1]]) * self.tag_mm
        return (self._lower_left()[:, None] + corners).reshape(-1, 2)

    def artwork(self) -> Artwork:
        """The tags' black modules and the squares between them, with a margin as wide as a gap."""
        gap, pitch = self.spacing * self.tag_mm, (1 + self.spacing) * self.tag_mm
        crossings = grid(self.columns + 1, self.rows + 1) * [pitch, -pitch] - [gap, 0]
        shapes = [rectangle(crossing, gap, gap) for crossing in crossings]
        for number, (x, y) in enumerate(self._lower_left(), self.first_id):
            black = np.rot90(~marker_modules(self.dictionary, number, self.border_modules), 2)
            shapes += rectangles(black, np.array([x, y - self.tag_mm]), self.tag_mm / len(black))
        width, height = self.columns * pitch, self.rows * pitch
        return Artwork((-2 * gap, -height - gap), (width + gap, 2 * gap), tuple(shapes))

    def _lower_left(self) -> FloatArray:
        """The lower left corner (marker_count, 2) of each tag."""
        pitch = (1 + self.spacing) * self.tag_mm
        return grid(self.columns, self.rows) * [pitch, -pitch]


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's predefined dictionary of that name; UsageError if there is none."""
    if not (name.startswith("DICT_") and hasattr(cv2.aruco, name)):
        raise UsageError(f"no marker dictionary {name!r}; OpenCV knows DICT_4X4_50 to DICT_7X7_1000 and others")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def marker_modules(dictionary: str, number: int, border: int = 1) -> NDArray[np.bool_]:
    """Which modules (n, n) of a marker are white, its black border of that many modules included."""
    known = marker_dictionary(dictionary)
    white = cv2.aruco.Dictionary.getBitsFromByteList(known.bytesList[number : number + 1], known.markerSize)
    return np.pad(np.asarray(white) > 0, border)


def one_dictionary(boards: Sequence[CodedBoard]) -> str:
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


def _demand_count(columns: int, rows: int, least: int, what: str) -> None:
    if not (least <= columns <= _MOST_COUNT and least <= rows <= _MOST_COUNT):
        raise UsageError(f"board: {columns} x {rows} {what}; at least {least} x {least} make a board")


def _demand_length(length_mm: float, what: str) -> None:
    if not 0 < length_mm < _MOST_MM:
        raise UsageError(f"board: a {what} of {length_mm:g} mm is none")
