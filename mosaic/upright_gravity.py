"""Up from what files or people told of it beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.upright_cameras import Upright, across

_FURTHEST = math.radians(15.0)  # half of what was told must agree as well
_TOLD = math.radians(0.7)  # how well cameras know it
_ROUNDS = 20


def up_from_gravity(frames: Sequence[Frame]) -> Upright | None:
    """The up that most registered frames were told; None if none was, or they contradict each other.

    Each frame's way to the ground, turned into the common world, is one vote; their middle is found by least squares
    with Cauchy's weights, which single wrong ones hardly move.
    """
    told = [_down(frame) for frame in frames]
    downs = np.array([down for down in told if down is not None])
    if len(downs) == 0:
        return None
    middle = downs[int(np.argmin(np.arccos(np.clip(downs @ downs.T, -1, 1)).sum(1)))]
    for _ in range(_ROUNDS):
        off = np.arccos(np.clip(downs @ middle, -1, 1))
        mean = (downs / (1 + (off / (2 * _TOLD)) ** 2)[:, None]).sum(0)
        middle = mean / np.linalg.norm(mean)
    off = np.arccos(np.clip(downs @ middle, -1, 1))
    if float(np.median(off)) > _FURTHEST:
        return None
    sides = downs @ across(middle).T
    scatter = 1.48 * float(np.median(np.abs(sides))) if len(downs) > 1 else 0.0
    return Upright(-middle, math.degrees(math.sqrt(2) * max(scatter, _TOLD) / math.sqrt(len(downs))))


def _down(frame: Frame) -> FloatArray | None:
    """The way to the ground (3,) in the common world as the frame was told it."""
    if frame.camera_from_world is None:
        return None
    gravity = frame.gravity
    if gravity is None and frame.prior is not None:
        gravity = frame.prior[:, 1]
    return None if gravity is None else np.asarray(frame.camera_from_world.T @ gravity)
