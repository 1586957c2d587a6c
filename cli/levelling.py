"""`--level` and `--centre-yaw`: how the world of a mosaic is turned upright."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fullsphere.mosaic.options import Levelling

_SPELLING = "auto, cameras, verticals, gravity, none, or YAW,PITCH,ROLL in degrees"


def add_level_arguments(parser: Any) -> None:
    """Declare what says which way is up."""
    parser.add_argument(
        "--level",
        default="auto",
        metavar="HOW",
        help="what up is found by: upright lines of the scene (verticals), what the files tell (gravity), how the "
        "cameras were held (cameras), the best of these (auto), nothing (none); or the first frame's "
        "YAW,PITCH,ROLL in degrees, --level=-30,5,0 if it begins with a minus (default: %(default)s)",
    )
    parser.add_argument(
        "--centre-yaw",
        type=float,
        default=0.0,
        metavar="DEG",
        help="longitude that comes to the panorama's middle, to the right of where the first frame looks "
        "(default: %(default)s)",
    )


def levelling_of(args: argparse.Namespace) -> Levelling:
    """What the arguments ask for.

    Raises
    ------
    UsageError
        If `--level` is none of its words and no three angles, or `--centre-yaw` is no angle.
    """
    from typing import get_args

    from fullsphere.model.errors import UsageError
    from fullsphere.mosaic.options import LevelFrom, Levelling

    if not math.isfinite(args.centre_yaw):
        raise UsageError(f"--centre-yaw {args.centre_yaw} is no angle; give degrees")
    for source in get_args(LevelFrom):
        if args.level == source:
            return Levelling(source, centre_yaw_deg=args.centre_yaw)
    return Levelling("none", _by_hand(args.level), args.centre_yaw)


def _by_hand(text: str) -> Any:
    """The rotation (3, 3) of a camera's rays into a level world."""
    import numpy as np

    from fullsphere.model.errors import UsageError
    from fullsphere.model.yaw_pitch_roll import rotation_of_angles

    try:
        angles = [float(angle) for angle in text.split(",")]
    except ValueError:
        angles = []
    if len(angles) != 3 or not np.all(np.isfinite(angles)):
        raise UsageError(f"--level {text!r} is not known; it is {_SPELLING}")
    return rotation_of_angles(*angles)
