"""How a pattern lies on sheets of paper: on one large enough for it, or in overlapping parts on several."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from fullsphere.model.errors import UsageError

MARGIN_MM = 12.0
"""White edge of a sheet: printers do not reach it, and marks for cutting stand in it."""

CAPTION_MM = 24.0
"""Height of the strip of text below the pattern, or beside it."""

OVERLAP_MM = 10.0
"""Width of the strip that two neighbouring sheets both show; there they are glued."""

PAPERS = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
}
"""Width and height in mm of the papers that have a name."""

_NARROWEST_MM = 150.0  # the line of 100 mm and its words fit
_LOWEST_MM = 100.0
_LARGEST_MM = 5000.0  # PDF readers take no more than 200 inches
_MOST_SHEETS = 400

Pair = tuple[float, float]


class Sheet(NamedTuple):
    """One sheet of paper and the part of the pattern on it; all lengths in mm.

    Attributes
    ----------
    size
        Width and height of the sheet.
    lower, upper
        Corners of the part that it shows, on the pattern's own paper (x right, y down).
    place, grid
        Its row and column among all sheets of the pattern, and how many rows and columns there are.
    beside
        Whether the text stands to the right of the pattern, turned, instead of below it.
    """

    size: Pair
    lower: Pair
    upper: Pair
    place: tuple[int, int] = (0, 0)
    grid: tuple[int, int] = (1, 1)
    beside: bool = False

    @property
    def corner(self) -> Pair:
        """Where the upper left corner of the part lies on the sheet."""
        if self.beside:
            return MARGIN_MM, (self.size[1] - (self.upper[1] - self.lower[1])) / 2
        return (self.size[0] - (self.upper[0] - self.lower[0])) / 2, MARGIN_MM


def paper_size(text: str) -> Pair:
    """Width and height in mm of a paper such as A4, letter or 610x914mm; UsageError if it is none."""
    for name, size in PAPERS.items():
        if text.lower() == name.lower():
            return size
    found = re.fullmatch(r"(\d{1,5}(?:\.\d{1,3})?)[xX](\d{1,5}(?:\.\d{1,3})?)mm", text)
    if not found:
        raise UsageError(f"--paper {text}: is none of {', '.join(PAPERS)}, nor a size such as 610x914mm")
    short, long = sorted((float(found[1]), float(found[2])))
    if not (short >= _LOWEST_MM and long >= _NARROWEST_MM and long <= _LARGEST_MM):
        raise UsageError(
            f"--paper {text}: a sheet has sides of at least {_LOWEST_MM:g} and {_NARROWEST_MM:g} mm, "
            f"and at most {_LARGEST_MM:g} mm"
        )
    return float(found[1]), float(found[2])


def lay_out(lower: Pair, upper: Pair, paper: Pair | None) -> list[Sheet]:
    """The sheets that show a pattern from its corner `lower` to `upper`, row by row.

    Parameters
    ----------
    lower, upper
        Corners of the pattern with its margin, mm.
    paper
        Width and height of the sheets, mm; they are turned where fewer are needed then.  None for one sheet as large as
        the pattern needs.

    Raises
    ------
    UsageError
        If one sheet would be larger than a PDF can be, or hundreds would be needed.
    """
    width, height = upper[0] - lower[0], upper[1] - lower[1]
    if paper is None:
        size = max(width + 2 * MARGIN_MM, _NARROWEST_MM), height + 2 * MARGIN_MM + CAPTION_MM
        if max(size) > _LARGEST_MM:
            raise UsageError(f"a sheet of {size[0]:.0f} x {size[1]:.0f} mm is too large; add --paper A0 for several")
        return [Sheet(size, lower, upper)]
    ways = [_way(width, height, size, beside) for beside in (False, True) for size in (paper, paper[::-1])]
    rows, columns, size, beside = min((way for way in ways if way), key=lambda way: way.rows * way.columns)
    if rows * columns > _MOST_SHEETS:
        raise UsageError(f"{rows * columns} sheets of {size[0]:g} x {size[1]:g} mm; choose a larger --paper")
    wide, high = _part(width, columns), _part(height, rows)
    sheets = []
    for row in range(rows):
        for column in range(columns):
            x, y = lower[0] + column * (wide - OVERLAP_MM), lower[1] + row * (high - OVERLAP_MM)
            sheets.append(Sheet(size, (x, y), (x + wide, y + high), (row, column), (rows, columns), beside))
    return sheets


class _Way(NamedTuple):
    """Rows and columns of sheets of that width and height, with the text below or beside the pattern."""

    rows: int
    columns: int
    size: Pair
    beside: bool


def _way(width: float, height: float, size: Pair, beside: bool) -> _Way | None:
    """How many sheets a pattern needs in one way; None where the text finds no room."""
    if (size[1] if beside else size[0]) < _NARROWEST_MM:
        return None
    free = [side - 2 * MARGIN_MM - CAPTION_MM * (beside == (axis == 0)) for axis, side in enumerate(size)]
    return _Way(_count(height, free[1]), _count(width, free[0]), size, beside)


def _count(length: float, free: float) -> int:
    return max(1, math.ceil((length - OVERLAP_MM) / (free - OVERLAP_MM) * (1 - 1e-9)))


def _part(length: float, count: int) -> float:
    """Length of each of `count` equal parts that overlap."""
    return (length + (count - 1) * OVERLAP_MM) / count
