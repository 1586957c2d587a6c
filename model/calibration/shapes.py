"""The black shapes that boards are printed with, in mm on the paper, and the grids on which they stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Artwork
from fullsphere.model.lens import FloatArray


def grid(columns: int, rows: int) -> FloatArray:
    """Column and row (columns * rows, 2) of every place of a grid, row by row."""
    row, column = np.indices((rows, columns)).reshape(2, -1)
    return np.stack([column, row], -1).astype(float)


def framed(shapes: Sequence[FloatArray], size: FloatArray, margin: FloatArray) -> Artwork:
    """Shapes on a pattern of that size (2,) from the origin, with a margin (2,) on both sides."""
    left, top = (0.0 - margin).tolist()
    right, bottom = (size + margin).tolist()
    return Artwork((left, top), (right, bottom), tuple(shapes))


def chess_squares(squares_x: int, squares_y: int, side: float) -> list[FloatArray]:
    """The black squares of a chessboard whose first square, at the origin, is black."""
    places = grid(squares_x, squares_y)
    return [rectangle(place, side, side) for place in places[places.sum(1) % 2 == 0] * side]


def rectangle(corner: FloatArray, width: float, height: float) -> FloatArray:
    """The outline (4, 2) of a rectangle from its corner (2,) of least x and y."""
    return np.asarray(corner + np.array([[0, 0], [width, 0], [width, height], [0, height]]), float)


def rectangles(black: NDArray[np.bool_], corner: FloatArray, module: float) -> list[FloatArray]:
    """The black modules (h, w) as few rectangles: runs along rows, joined with equal runs of the next rows.

    `corner` (2,) is the place of the first module, `module` the side of one.
    """
    first: dict[tuple[int, int], int] = {}  # start and end of a run -> the row where its rectangle began
    shapes = []
    for row in range(len(black) + 1):
        edges = np.flatnonzero(np.diff(np.pad(black[row], 1).astype(int))) if row < len(black) else np.zeros(0, int)
        runs = {(int(start), int(end)) for start, end in edges.reshape(-1, 2)}
        for start, end in sorted(first.keys() - runs):
            top = first.pop((start, end))
            place = corner + module * np.array([start, top])
            shapes.append(rectangle(place, module * (end - start), module * (row - top)))
        first |= dict.fromkeys(runs - first.keys(), row)
    return shapes
