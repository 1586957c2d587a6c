"""Frames whose pixels were turned upright by a program: back to the way in which their camera holds pictures.

Among the pictures of one lens a turned one has width and height exchanged.  In the camera's orientation it is a frame
like the others, but which way it was turned no file says, and a lens whose centre is not the picture's middle shows
the difference: by twice that distance.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from fullsphere.model.circle import brightest, find_circle
from fullsphere.mosaic.loading import load_pixels, loader_of
from fullsphere.mosaic.orientation_tag import turned_from_stored
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.rim import eight_bit

_USUAL_TURN = 1  # clockwise: undoes a turn to the left, which a camera held with its grip on top is given
_CLEARLY = 0.5  # of the distance to the centre by the other way: what a circle has to come within to decide


def turned_back(frame: Frame, centre_px: tuple[float, float] | None) -> Frame:
    """A frame whose width and height are exchanged as its camera took it.

    The way is that by which the image circle comes to lie at the camera's centre; where no circle is to be seen, or
    both ways do, a quarter turn clockwise.

    Parameters
    ----------
    frame
        As its file holds it.
    centre_px
        The centre of the camera's picture; None if it is not known.
    """
    turn = _USUAL_TURN if centre_px is None else _turn_to(load_pixels(Path(frame.image)), centre_px)
    rotation = turned_from_stored(turn)
    return dataclasses.replace(
        frame,
        size=frame.size[::-1],
        load=loader_of(frame, None, turn),
        turned=turn,
        quarter_turns=(frame.quarter_turns - turn) % 4,
        prior=None if frame.prior is None else rotation @ frame.prior,
        gravity=None if frame.gravity is None else rotation @ frame.gravity,
    )


def _turn_to(pixels: Picture, centre_px: tuple[float, float]) -> int:
    circle = find_circle(brightest([eight_bit(pixels)]))
    if circle is None:
        return _USUAL_TURN
    height, width = pixels.shape[:2]
    u, v = circle.centre
    clockwise = math.dist(centre_px, (height - 1 - v, u))
    anticlockwise = math.dist(centre_px, (v, width - 1 - u))
    if clockwise < _CLEARLY * anticlockwise:
        return 1
    return 3 if anticlockwise < _CLEARLY * clockwise else _USUAL_TURN
