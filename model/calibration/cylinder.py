"""A ChArUco strip rolled into a tube, to be photographed along the tube's axis: one photo shows it at all angles."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.calibration.board import Placement
from fullsphere.model.calibration.boards import CharucoBoard, marker_dictionary
from fullsphere.model.errors import UsageError

_DICTIONARIES = ("DICT_5X5_50", "DICT_5X5_100", "DICT_5X5_250", "DICT_5X5_1000")
"""The fewer markers a dictionary has, the less alike they are."""


def cylinder(
    radius_mm: float,
    length_mm: float,
    square_mm: float,
    marker_mm: float,
    dictionary: str | None = None,
    part: float = 1.0,
) -> CharucoBoard:
    """A ChArUco board for the inside of a tube, or of part of one.

    The target's frame has the tube's axis for its z axis: the point (x, y) of the paper is at
    (R cos(x/R), R sin(x/R), y), seen from inside x runs to the right when z points down.  Squares are made a little
    larger or smaller, so that a whole number fills the arc; round a whole tube an even one, so that black and white
    alternate across the seam.  On the seam itself are no marks.

    Parameters
    ----------
    radius_mm, length_mm
        Of the tube's printed inner face; as many rows of squares as fit the length.
    square_mm, marker_mm
        Sides wanted of a square and its marker.
    dictionary
        OpenCV's name of the marker dictionary; by default the smallest of 5 x 5 modules that has markers enough.
    part
        Share of the full turn that is covered: 1 for a tube, 0.5 for half of it.

    Raises
    ------
    UsageError
        If the numbers describe no tube, or ask for more markers than there are.
    """
    for what, value in (("radius", radius_mm), ("length", length_mm), ("square", square_mm)):
        if not 0 < value < 1e6:
            raise UsageError(f"cylinder: a {what} of {value:g} mm is none")
    if not 0 < part <= 1:
        raise UsageError(f"cylinder: {part:g} is no share of a turn")
    step = 2 if part == 1 else 1
    arc = 2 * math.pi * radius_mm * part
    around = step * round(arc / square_mm / step)
    if around < 4:
        raise UsageError(f"cylinder: squares of {square_mm:g} mm are too large for a radius of {radius_mm:g} mm")
    side = arc / around
    along = math.floor(length_mm / side * (1 + 1e-9))
    if along < 2:
        raise UsageError(f"cylinder: a length of {length_mm:g} mm holds no two rows of squares of {side:.4g} mm")
    return CharucoBoard(
        around,
        along,
        side,
        marker_mm * side / square_mm,
        dictionary=dictionary or _smallest_dictionary(around * along // 2),
        placement=Placement(
            np.array([[0, 0, 1, radius_mm], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float), radius_mm
        ),
    )


def _smallest_dictionary(markers: int) -> str:
    for name in _DICTIONARIES:
        if markers <= len(marker_dictionary(name).bytesList):
            return name
    raise UsageError(f"cylinder: {markers} markers are more than the 1000 there are; use larger squares")
