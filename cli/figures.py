"""How figures look and how they become bytes: one style for all of them, the same bytes for the same values.

Only matplotlib's objects are used, never its global state (`pyplot`), and nobody's `matplotlibrc` changes a figure.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.errors import UsageError

Format = Literal["svg", "png", "pdf"]

BLUE, ORANGE, GREEN, RED, SKY, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7"
"""Colours that stay apart for the colour-blind and in grey (Okabe and Ito 2008)."""

INK, FAINT = "#222222", "#8a8a8a"
COLOURS = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
"""Line styles to go with `COLOURS`, so that no line is told by its colour alone."""

DENSE = 1200
"""More marks than this are drawn as a picture inside the vector figure, which would be megabytes otherwise."""

_STYLE: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 12,
    "axes.titlesize": 12,
    "legend.fontsize": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
    "hatch.linewidth": 0.6,
    "image.cmap": "viridis",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "fullsphere",  # else identifiers in the file are random
    "svg.fonttype": "path",
}

_METADATA: dict[str, dict[str, None]] = {  # no date, no version: they would change the bytes
    "svg": {"Date": None, "Creator": None, "Type": None, "Format": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
_DOTS_PER_INCH = 150


@dataclasses.dataclass(frozen=True, eq=False)
class Drawing:
    """A figure with the words that go with it.

    Attributes
    ----------
    name
        Stem of its files.
    title
        What it shows.
    caption
        How to read it, in plain sentences.
    figure
        The matplotlib figure.
    """

    name: str
    title: str
    caption: str
    figure: Figure

    def encoded(self, format_: Format) -> bytes:
        """The figure as the content of a file."""
        buffer = io.BytesIO()
        with styled():
            if self.figure.get_layout_engine() is not None:  # once: the same in every format
                self.figure.draw_without_rendering()
                self.figure.set_layout_engine(None)
            self.figure.savefig(buffer, format=format_, dpi=_DOTS_PER_INCH, metadata=_METADATA[format_])
        return buffer.getvalue()


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Draw in the style of all figures; whatever was set before holds again afterwards."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def shown_light(light: NDArray[np.floating[Any]], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Light (h, w, 3) as 8-bit codes, bright enough to be looked at where it is seen (h, w)."""
    white = max(float(np.percentile(light[seen], 99)), 1e-6) if seen.any() else 1.0
    codes: NDArray[np.uint8] = encoded_from_linear(np.minimum(light / np.float32(white), 1), np.uint8)
    return codes


def blank(width_in: float = 6.4, height_in: float = 4.2) -> tuple[Figure, Axes]:
    """A new figure with one pair of axes, inside `styled`."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.add_subplot()


def file_format(path: Path) -> Format:
    """The format that a figure's file name asks for.

    Raises
    ------
    UsageError
        If it is none that figures are written in.
    """
    formats: dict[str, Format] = {".svg": "svg", ".png": "png", ".pdf": "pdf"}
    if path.suffix.lower() not in formats:
        raise UsageError(f"{path}: a figure ends in .png, .pdf or .svg; give it one of these endings")
    return formats[path.suffix.lower()]


def write_figure(path: Path, drawing: Drawing, overwrite: bool) -> None:
    """Write one figure in the format that the name's ending says.

    Raises
    ------
    UsageError
        If the ending says none.
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    from fullsphere.model.files import output_errors, replacing

    content = drawing.encoded(file_format(path))
    with replacing(path, overwrite) as temporary, output_errors(path):
        temporary.write_bytes(content)
