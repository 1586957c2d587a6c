"""Draws sheets to print at true scale, as vectors: PDF and SVG, the same bytes for the same pattern."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Transform

from fullsphere.cli.sheet_layout import CAPTION_MM, MARGIN_MM, OVERLAP_MM, Sheet
from fullsphere.model.calibration.board import Artwork

PATTERN = "pattern"
"""The id of the printed pattern in an SVG."""

_MM_PER_INCH, _POINTS_PER_MM = 25.4, 72 / 25.4
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "path.simplify": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "fullsphere",  # else identifiers in the file are random
}
_CHECK_MM = 100.0
_TEXT_PT, _LINE_MM = 7.5, 4.0
_LETTER_WIDTH = 0.56  # of the font's size, on average
_HAIR_MM, _GREY = 0.1, "0.5"


def draw(sheet: Sheet, artwork: Artwork, lines: Sequence[str], flap_from: float | None = None) -> Figure:
    """One sheet: its part of the artwork, marks for cutting and gluing, text, and lines to check the scale with.

    Parameters
    ----------
    sheet
        The sheet and the part of the pattern on it.
    artwork
        What to print.
    lines
        Text below the pattern.
    flap_from
        Place on the pattern's paper, mm, from which on it is only there to be glued; None if there is no such flap.
    """
    with _styled():
        figure = Figure(figsize=(sheet.size[0] / _MM_PER_INCH, sheet.size[1] / _MM_PER_INCH))
        page = Affine2D().scale(1, -1).translate(0, sheet.size[1]).scale(1 / _MM_PER_INCH) + figure.dpi_scale_trans
        _draw_pattern(figure, page, sheet, artwork)
        _draw_marks(figure, page, sheet, flap_from)
        _draw_text(figure, page, sheet, lines)
    return figure


def as_pdf(figures: Sequence[Figure], title: str) -> bytes:
    """The sheets as the pages of one PDF."""
    buffer = io.BytesIO()
    metadata = {"Title": title, "CreationDate": None, "Creator": None, "Producer": None}
    with _styled(), PdfPages(buffer, metadata=metadata) as file:
        for figure in figures:
            file.savefig(figure)
    return buffer.getvalue()


def as_svg(figure: Figure) -> bytes:
    """One sheet as an SVG whose width and height are in mm (its coordinates are in points)."""
    buffer = io.BytesIO()
    with _styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Type": None, "Format": None})
    width, height = figure.get_size_inches() * _MM_PER_INCH
    size = f'width="{width:.4f}mm" height="{height:.4f}mm"'
    return re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', size, buffer.getvalue().decode(), count=1).encode()


@contextlib.contextmanager
def _styled() -> Iterator[None]:
    """Draw as here is said, whatever the user's matplotlibrc wants."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def _draw_pattern(figure: Figure, page: Transform, sheet: Sheet, artwork: Artwork) -> None:
    shift = np.subtract(sheet.corner, sheet.lower)
    closed = (np.vstack([polygon, polygon[:1]]) + shift for polygon in artwork.polygons if _on(sheet, polygon))
    paths = [Path(outline, closed=True) for outline in closed]
    for x, y, radius in artwork.discs:
        if _on(sheet, np.array([[x - radius, y - radius], [x + radius, y + radius]])):
            paths.append(Path.circle((x + shift[0], y + shift[1]), radius))
    if not paths:
        return
    # One path for all of it: shapes that touch are then filled without a light seam between them.
    pattern = PathPatch(Path.make_compound_path(*paths), facecolor="black", edgecolor="none", linewidth=0, gid=PATTERN)
    pattern.set_transform(page)
    window = np.array([sheet.lower, sheet.upper]) + shift
    pattern.set_clip_path(Path(_rectangle(*window[0], *window[1]), closed=True), page)
    figure.add_artist(pattern)


def _on(sheet: Sheet, outline: np.ndarray) -> bool:
    return bool((outline.min(0) < sheet.upper).all() and (outline.max(0) > sheet.lower).all())


def _rectangle(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]


def _draw_marks(figure: Figure, page: Transform, sheet: Sheet, flap_from: float | None) -> None:
    left, top = sheet.corner
    right, bottom = left + sheet.upper[0] - sheet.lower[0], top + sheet.upper[1] - sheet.lower[1]
    for x in (left, right):
        _line(figure, page, [(x, top - 7), (x, top - 2)])
        _line(figure, page, [(x, bottom + 2), (x, bottom + 5)])
    for y in (top, bottom):
        _line(figure, page, [(left - 7, y), (left - 2, y)])
        _line(figure, page, [(right + 2, y), (right + 7, y)])
    half = _HAIR_MM / 2
    if sheet.grid != (1, 1) or flap_from is not None:
        outline = _rectangle(left - half, top - half, right + half, bottom + half)
        _line(figure, page, outline)
    if sheet.place[1] + 1 < sheet.grid[1]:
        for ends in ((top - 7, top - 1), (bottom + 1, bottom + 5)):
            _line(figure, page, [(right - OVERLAP_MM, y) for y in ends], dashed=True)
    if sheet.place[0] + 1 < sheet.grid[0]:
        for ends in ((left - 7, left - 1), (right + 1, right + 7)):
            _line(figure, page, [(x, bottom - OVERLAP_MM) for x in ends], dashed=True)
    if flap_from is not None and sheet.lower[0] < flap_from < sheet.upper[0]:
        x = left + flap_from - sheet.lower[0] + half
        _line(figure, page, [(x, top), (x, bottom)], dashed=True)


def _draw_text(figure: Figure, page: Transform, sheet: Sheet, lines: Sequence[str]) -> None:
    width, height, turn = *sheet.size, 0
    if sheet.beside:  # as below the pattern on a sheet that is then turned to the left
        page = Affine2D(np.array([[0, 1, 0], [-1, 0, height], [0, 0, 1]])) + page
        width, height, turn = height, width, 90
    left, ruler = MARGIN_MM, height - MARGIN_MM
    free_pt = (width - 2 * MARGIN_MM) * _POINTS_PER_MM
    for row, line in enumerate(lines):
        size = min(_TEXT_PT, free_pt / (_LETTER_WIDTH * max(len(line), 1)))
        baseline = height - MARGIN_MM - CAPTION_MM + 7.5 + row * _LINE_MM
        _write(figure, page, (left, baseline), line, size, turn)
    _line(figure, page, [(left, ruler), (left + _CHECK_MM, ruler)], dark=True)
    for x in (left, left + _CHECK_MM):
        _line(figure, page, [(x, ruler - 1.5), (x, ruler + 1.5)], dark=True)
    words = f"measure: this line is {_CHECK_MM:g} mm"
    beside = min(_TEXT_PT, (width - left - _CHECK_MM - 6) * _POINTS_PER_MM / (_LETTER_WIDTH * len(words)))
    _write(figure, page, (left + _CHECK_MM + 2, ruler + 0.9), words, beside, turn)
    upper, x = 2 * MARGIN_MM, MARGIN_MM / 2
    if height < upper + _CHECK_MM + 2 * MARGIN_MM:
        return
    _line(figure, page, [(x, upper), (x, upper + _CHECK_MM)], dark=True)
    for y in (upper, upper + _CHECK_MM):
        _line(figure, page, [(x - 1.5, y), (x + 1.5, y)], dark=True)


def _write(figure: Figure, page: Transform, at: tuple[float, float], text: str, size: float, turn: float) -> None:
    figure.text(*at, text, transform=page, fontsize=size, rotation=turn, rotation_mode="anchor", parse_math=False)


def _line(
    figure: Figure, page: Transform, points: Sequence[tuple[float, float]], dashed: bool = False, dark: bool = False
) -> None:
    x, y = zip(*points, strict=True)
    line = Line2D(x, y, color="black" if dark else _GREY, linewidth=_HAIR_MM * _POINTS_PER_MM, transform=page)
    if dashed:
        line.set_dashes((20, 15))  # widths of the line
    figure.add_artist(line)
