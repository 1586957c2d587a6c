"""Which way is up, and where the panorama's middle looks: the page of verbs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.options import Levelling
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.upright_cameras import Upright, up_from_cameras
from fullsphere.mosaic.upright_gravity import up_from_gravity
from fullsphere.mosaic.upright_light import lighter_side
from fullsphere.mosaic.upright_lines import up_from_lines

_WORST_SIGMA_DEG = 25.0  # of up from the cameras: beyond it they tell nothing
_REACH_DEG, _REACH_OF_GRAVITY_DEG = 25.0, 6.0  # how far from the first idea of up lines may meet
_DEFAULT = Levelling()


class Levelled(NamedTuple):
    """A levelled world.

    Attributes
    ----------
    levelled_from_world
        Rotation (3, 3) that takes rays of the world as it was into the levelled one.
    source
        What up was found by: "vertical-lines", "gravity", "camera-x-axes", "by-hand" or "none".
    sigma_deg
        Root mean square of the tilt to be expected, degrees; None where nothing tells.
    """

    levelled_from_world: FloatArray
    source: str
    sigma_deg: float | None


def level(
    frames: Sequence[Frame],
    cameras: Sequence[Camera],
    levelling: Levelling = _DEFAULT,
    executor: Executor | None = None,
) -> Levelled:
    """Turn the world of registered frames upright.

    The levelled world looks along the first registered frame's optical axis at longitude zero.  Where nothing tells
    which way is up, or nobody asks, it is that frame's own.

    Parameters
    ----------
    frames
        Those that are registered count; some are opened where lines are looked for.
    cameras
        That took them.
    levelling
        What is asked for.
    executor
        Where frames are worked on side by side.

    Raises
    ------
    GeometryError
        If there is no registered frame, or what was asked for does not tell which way is up.
    """
    placed = [frame for frame in frames if frame.registered]
    if not placed:
        raise GeometryError("there is no registered frame to level the mosaic by")
    first = placed[0].camera_from_world
    assert first is not None
    upright, source = _upright(placed, cameras, levelling, executor)
    turn = first.copy() if upright is None else _standing(upright.up, first)
    if levelling.turn is not None:
        turn, source = levelling.turn @ turn, "by-hand" if upright is None else source
    return Levelled(_about_up(-levelling.centre_yaw_deg) @ turn, source, None if upright is None else upright.sigma_deg)


def _upright(
    placed: Sequence[Frame], cameras: Sequence[Camera], levelling: Levelling, executor: Executor | None
) -> tuple[Upright | None, str]:
    """Up and what it was found by; None where nothing tells."""
    asked = levelling.source
    if asked == "none":
        return None, "none"
    told = None if asked == "cameras" else up_from_gravity(placed)
    if asked == "gravity":
        if told is None:
            raise GeometryError(
                "no frame tells where the ground is, or they contradict each other; give their angles (--prior), "
                "or level by --level auto"
            )
        return told, "gravity"
    held = _held(placed, cameras)
    if asked != "cameras":
        near, reach = (held.up, _REACH_DEG) if told is None else (told.up, _REACH_OF_GRAVITY_DEG)
        lines = up_from_lines(placed, cameras, near, reach, executor)
        if lines is not None:
            return lines, "vertical-lines"
        if asked == "verticals":
            raise GeometryError(
                "there are too few upright lines in the frames to level the mosaic by; try --level cameras, or give "
                "the first frame's orientation by hand (--level YAW,PITCH,ROLL)"
            )
    if told is not None:
        return told, "gravity"
    if held.sigma_deg < _WORST_SIGMA_DEG:
        return held, "camera-x-axes"
    if asked == "cameras":
        raise GeometryError(
            "the cameras' axes do not tell which way is up; try --level verticals, or give the first frame's "
            "orientation by hand (--level YAW,PITCH,ROLL)"
        )
    return None, "none"


def _held(placed: Sequence[Frame], cameras: Sequence[Camera]) -> Upright:
    """Up from how the cameras were held; what they leave open, an up and its opposite, is told by the light."""
    rotations = [frame.camera_from_world for frame in placed if frame.camera_from_world is not None]
    held = up_from_cameras(rotations, [frame.quarter_turns for frame in placed])
    if held.opposite:
        return held._replace(up=lighter_side(placed, cameras, held.up), opposite=False)
    return held


def _standing(up: FloatArray, first: FloatArray) -> FloatArray:
    """The rotation (3, 3) into a world whose y axis points away from `up`, with the first camera's axis before it."""
    y = -up
    z = first[2] - (first[2] @ y) * y
    if np.linalg.norm(z) < 1e-3:  # the first camera looks straight up or down: its own top or bottom edge leads instead
        z = math.copysign(1.0, first[2] @ y) * -first[1]
        z = z - (z @ y) * y
    z /= np.linalg.norm(z)
    return np.stack([np.cross(y, z), y, z])


def _about_up(yaw_deg: float) -> FloatArray:
    """The rotation that adds to longitudes."""
    cosine, sine = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
