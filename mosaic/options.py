"""What may be asked of a registration."""

from __future__ import annotations

import dataclasses
from typing import Literal

from fullsphere.model.lens import FloatArray

AUTO = "auto"
"""The name of no lens in particular: the one that fits."""

Order = Literal["any", "ring", "sweep"]
"""How the frames follow one another: not at all, along a closed turn, along an open or winding sweep."""

LevelFrom = Literal["auto", "cameras", "verticals", "gravity", "none"]
"""What tells which way is up: the cameras' x axes, vertical lines in the scene, gravity as the files told it."""


@dataclasses.dataclass(frozen=True)
class Levelling:
    """How the world of a mosaic is turned upright.

    Attributes
    ----------
    source
        What tells which way is up; "auto" takes the best that there is.
    turn
        A rotation (3, 3) given by hand, applied after levelling: levelled_from_world is multiplied by it from the left.
    centre_yaw_deg
        Longitude, in the mosaic as it would be otherwise, that comes to the panorama's middle.
    """

    source: LevelFrom = "auto"
    turn: FloatArray | None = dataclasses.field(default=None, repr=False, compare=False)
    centre_yaw_deg: float = 0.0


@dataclasses.dataclass(frozen=True)
class Options:
    """What may be asked of a registration.

    Attributes
    ----------
    order
        How the frames follow one another: limits which pairs are looked at first when frames are many.
    levelling
        How the world is turned upright.
    lens
        Name of the lens fitted where the camera is estimated from the frames, as in camera.json; `AUTO` for the one of
        Bakstein & Pajdla's and Kannala & Brandt's that fits.
    refine
        Whether a given camera is adjusted too, held by what its calibration knows of it.
    """

    order: Order = "any"
    levelling: Levelling = Levelling()
    lens: str = AUTO
    refine: bool = False


DEFAULT = Options()
"""What is asked for where nothing is said."""
