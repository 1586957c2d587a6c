"""Where a camera or drone noted that it looked: yaw, pitch and roll in the XMP packet of a picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from fullsphere.model.image_library import ImageSpec, attribute_of, opened


class ToldPose(NamedTuple):
    """Yaw to the right, pitch up and roll clockwise in degrees: world_from_camera = Ry(yaw) Rx(pitch) Rz(roll).

    `yaw_deg` is None where only the plumb line is known.  A compass yaw counts from north.
    """

    yaw_deg: float | None
    pitch_deg: float
    roll_deg: float


_GIMBAL_ROLL = "drone-dji:GimbalRollDegree"
_HALF_TURN_DEG = 179.0  # other programs take a gimbal's roll of +-180 for 0: as it stands, it would turn up into down

# Yaw, pitch, roll as Google's Photo Sphere metadata and DJI's drones name them; both have the signs of ToldPose.
# Google: heading clockwise from north, pitch up, and "as roll increases, the horizon rotates counterclockwise".
# DJI (manual of the Mavic 3E): the axes north, east, down, turned in the order ZYX.
_NAMES = (
    ("GPano:PoseHeadingDegrees", "GPano:PosePitchDegrees", "GPano:PoseRollDegrees"),
    ("drone-dji:GimbalYawDegree", "drone-dji:GimbalPitchDegree", _GIMBAL_ROLL),
)


def told_pose(path: Path) -> ToldPose | None:
    """The pose of the upright picture that a file tells; None if it tells none.

    A pose is taken only with its pitch and roll: a heading alone says nothing about up.  That of a drone which notes
    its gimbal upside down is not taken.

    Raises
    ------
    InputError
        If the file cannot be opened as a picture.
    """
    with opened(Path(path), by_region=True) as (_, spec):
        for names in _NAMES:
            yaw, pitch, roll = (_degrees(spec, name) for name in names)
            if pitch is None or roll is None or abs(pitch) > 90:
                continue
            if names[2] != _GIMBAL_ROLL or abs(roll) < _HALF_TURN_DEG:
                return ToldPose(yaw, pitch, roll)
    return None


def _degrees(spec: ImageSpec, name: str) -> float | None:
    """An angle from a header, which is untrusted: a number, or its text."""
    value = attribute_of(spec, name)
    if not isinstance(value, int | float | str):
        return None
    try:
        degrees = float(value)
    except (ValueError, OverflowError):
        return None
    return degrees if math.isfinite(degrees) and abs(degrees) <= 360 else None
