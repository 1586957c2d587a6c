"""Yaw, pitch and roll: how people say how a camera is turned.

With x to the right, y down and z forward, world_from_camera = Ry(yaw) Rx(pitch) Rz(roll): yaw to the right, pitch up,
roll clockwise.
"""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.lens import FloatArray

_UPRIGHT = 1e-9  # of cos(pitch): less is straight up or down, where yaw and roll are one


def rotation_of_angles(yaw_deg: float, pitch_deg: float, roll_deg: float) -> FloatArray:
    """world_from_camera (3, 3) of angles in degrees."""
    (a, p), (b, q), (c, r) = ((math.cos(x), math.sin(x)) for x in map(math.radians, (yaw_deg, pitch_deg, roll_deg)))
    return np.array(
        [
            [a * c + p * q * r, p * q * c - a * r, p * b],
            [b * r, b * c, -q],
            [a * q * r - p * c, p * r + a * q * c, a * b],
        ]
    )


def angles_of_rotation(world_from_camera: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch, roll in degrees of a rotation (3, 3): in (-180, 180], [-90, 90], (-180, 180].

    Straight up and down it is all yaw, and the roll is 0.
    """
    m = np.asarray(world_from_camera, float)
    level = math.hypot(m[1, 0], m[1, 1])  # cos(pitch)
    pitch = math.atan2(-m[1, 2], level)
    if level < _UPRIGHT:
        yaw, roll = math.atan2(-m[2, 0], m[0, 0]), 0.0
    else:
        yaw, roll = math.atan2(m[0, 2], m[2, 2]), math.atan2(m[1, 0], m[1, 1])
    return math.degrees(yaw), math.degrees(pitch), math.degrees(roll)
