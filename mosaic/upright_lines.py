"""Up from upright lines of the scene: edges of walls, doors and windows, posts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.line_segments import Segments, find_segments
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.upright_cameras import Upright, across

_STEP = math.radians(1.0)  # between the directions that are tried
_FIRST_SCALE, _LAST_SCALE, _SHRINK = math.radians(1.2), math.radians(0.25), 0.85
_LONGEST = math.radians(12.0)  # a longer segment weighs no more
_NEAR_UP = math.cos(math.radians(25.0))  # lines seen as near to up or down tell little, and ceilings' lines deceive
_END = 1.0e-3  # radians: how far the ends of a segment are off
_TRUE = math.radians(0.15)  # how upright the uprights are that people build
_SHARP, _AROUND = math.radians(0.5), (math.radians(1.5), math.radians(8.0))
_CONTRAST = 5.0  # how much denser lines must be at up than around it
_FEWEST = 20
_SECTORS = 12
_WORST_SIGMA_DEG = 0.5


class Meeting(NamedTuple):
    """Where upright lines meet.

    Attributes
    ----------
    upright
        The direction, and how well it is known.
    lines
        How many lines lean from it by half a degree at most.
    contrast
        How much denser such lines are than those that lean by several degrees: some 1 where nothing stands upright.
    """

    upright: Upright
    lines: int
    contrast: float

    @property
    def certain(self) -> bool:
        """Whether so many lines meet, so sharply, that it is no chance."""
        return self.lines >= _FEWEST and self.contrast >= _CONTRAST and self.upright.sigma_deg <= _WORST_SIGMA_DEG


def up_from_lines(
    frames: Sequence[Frame],
    cameras: Sequence[Camera],
    near: FloatArray,
    reach_deg: float,
    executor: Executor | None = None,
) -> Upright | None:
    """The direction that upright lines of the scene meet in; None where there are too few of them.

    Parameters
    ----------
    frames
        Registered frames.
    cameras
        That took them.
    near
        Unit vector (3,) in their world: up as well as it is known.
    reach_deg
        How far from there to search.
    executor
        Where frames are worked on side by side.
    """
    meeting = meeting_of(find_segments(frames, cameras, near, executor), near, math.radians(reach_deg))
    return meeting.upright if meeting is not None and meeting.certain else None


def meeting_of(segments: Segments, near: FloatArray, reach: float) -> Meeting | None:
    """The direction within `reach` (radians) of `near` that most segments point to; None if there are hardly any.

    Each segment votes for the directions that lie on its great circle; the best is refined by least squares over the
    angles between segments and the way up at their middles, with Geman-McClure weights of shrinking width.
    """
    if len(segments.lengths) < _FEWEST:
        return None
    weight = np.minimum(segments.lengths, _LONGEST)
    upright = _refined(_voted(segments, weight, near, reach), segments)
    lean, telling = _lean(segments, upright.up[None])
    off = np.where(telling[0], np.abs(lean[0]), math.pi)
    sharp, around = off < _SHARP, (off > _AROUND[0]) & (off < _AROUND[1])
    density = (weight[around].sum() + _LONGEST) / (_AROUND[1] - _AROUND[0])  # one long line more, for where are none
    return Meeting(upright, int(sharp.sum()), float(weight[sharp].sum() / _SHARP / density))


def _lean(segments: Segments, ups: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Angles (m, n) at their middles between segments and the way to each up (m, 3), and whether they tell."""
    along = np.cross(segments.normals, segments.middles)
    sine, cosine = ups @ segments.normals.T, ups @ along.T
    lean = np.arctan(sine / np.where(np.abs(cosine) < 1e-12, 1e-12, cosine))
    return lean, np.abs(ups @ segments.middles.T) < _NEAR_UP


def _voted(segments: Segments, weight: FloatArray, near: FloatArray, reach: float) -> FloatArray:
    """The direction (3,) with most votes, of a grid about `near`."""
    steps = np.arange(-int(reach / _STEP), int(reach / _STEP) + 1) * _STEP
    a, b = (side.ravel() for side in np.meshgrid(steps, steps))
    within = np.hypot(a, b) <= reach
    ups = near + np.tan(np.stack([a[within], b[within]], -1)) @ across(near)
    ups /= np.linalg.norm(ups, axis=-1, keepdims=True)
    lean, _ = _lean(segments, near[None])
    hopeful = np.abs(lean[0]) < 1.5 * reach + _FIRST_SCALE  # further from the poles lines turn less than up does
    few, weight = Segments(*(part[hopeful] for part in segments)), weight[hopeful]
    along = np.cross(few.normals, few.middles)
    votes = []
    for some in np.array_split(ups, 1 + len(ups) * len(weight) // 200_000):
        tangent = (some @ few.normals.T) / (some @ along.T)
        share = np.maximum(0.0, 1 - (tangent / _FIRST_SCALE) ** 2)
        share[np.abs(some @ few.middles.T) > _NEAR_UP] = 0.0
        votes.append(share @ weight)
    return np.asarray(ups[int(np.argmax(np.concatenate(votes)))])


def _refined(up: FloatArray, segments: Segments) -> Upright:
    known = 1 / (2 * (_END / segments.lengths) ** 2 + _TRUE**2)
    along = np.cross(segments.normals, segments.middles)
    scale = _FIRST_SCALE
    while True:
        for _ in range(4):
            sides = across(up)
            lean, telling = (values[0] for values in _lean(segments, up[None]))
            sine, cosine = segments.normals @ up, along @ up
            slope = (segments.normals * cosine[:, None] - along * sine[:, None]) @ sides.T  # of atan(sine / cosine)
            slope /= np.maximum(cosine**2 + sine**2, 1e-12)[:, None]
            weight = np.where(telling, known / (1 + (lean / scale) ** 2) ** 2, 0.0)
            normal = (slope * weight[:, None]).T @ slope + np.eye(2)
            step = -np.linalg.solve(normal, slope.T @ (weight * lean))
            step *= min(1.0, scale / max(float(np.linalg.norm(step)), 1e-12))
            up = up + step @ sides
            up /= np.linalg.norm(up)
        if scale == _LAST_SCALE:
            break
        scale = max(scale * _SHRINK, _LAST_SCALE)
    covariance = _clustered(slope * weight[:, None], lean, segments.middles @ sides.T, normal)
    return Upright(up, math.degrees(math.sqrt(float(np.trace(covariance)))))


def _clustered(pull: FloatArray, lean: FloatArray, aside: FloatArray, normal: FloatArray) -> FloatArray:
    """Covariance (2, 2) of up: lines of one direction share what is wrong with it, a wall that leans for one.

    Their sums scatter, not they: White's estimate for clusters, which are the sectors that `aside` (n, 2) lies in.
    Few sectors scatter little by chance: to each comes the lean that the lines of a sector may have in common.
    """
    turn = np.arctan2(aside[:, 1], aside[:, 0]) / (2 * math.pi)
    sector = np.floor(turn * _SECTORS).astype(int) % _SECTORS
    inverse = np.linalg.inv(normal)
    own, common = pull * lean[:, None], pull * _TRUE
    sums = np.stack([part[sector == k].sum(0) for k in range(_SECTORS) for part in (own, common)])
    return np.asarray(inverse @ (sums.T @ sums + normal) @ inverse)
