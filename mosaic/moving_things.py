"""Things that moved between the frames: matches of one place that went astray together, where nothing stood still."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.parallax import Parallax

_STILL_PX = 6.0  # a match nearer than this to its place is of something that stood still
_FURTHEST = math.radians(15)  # what went further is more likely a wrong match
_NEIGHBOURS = math.radians(6)
_ONE_THING = math.radians(20)
_ALIKE = 0.3  # share of the distance by which neighbours of one thing may differ
_LEAST = 8  # matches of one thing
_OFF_PLANE = 3.0  # standard deviations from the plane in which near things shift when the camera does


class MovingThing(NamedTuple):
    """A thing that moved between frames: its direction (3,) in the world, how far in radians, its matches."""

    frames: tuple[int, ...]
    direction: FloatArray
    moved: float
    matches: int


def moving_things(
    evidence: Evidence,
    cameras: Sequence[Camera],
    rotations: Mapping[int, FloatArray],
    parallax: Mapping[Pair, Parallax],
) -> list[MovingThing]:
    """The things that moved between the frames of pairs, those with most matches first.

    Parameters
    ----------
    evidence
        Keypoints and matches, those that no rotation explains among them.
    cameras
        Of the solution.
    rotations
        camera_from_world (3, 3) of the registered frames.
    parallax
        Of the pairs to look at.  Near things shift too when the camera does, but along with its step.
    """
    found = []
    for pair, one in parallax.items():
        if pair[0] in rotations and pair[1] in rotations:
            found += _between(evidence, cameras, rotations, pair, one)
    return _merged(sorted(found, key=lambda thing: (-thing.matches, thing.frames)))


def _merged(things: Sequence[MovingThing]) -> list[MovingThing]:
    """Things seen beside each other, in whatever frames, as one: somebody who walks is never in the same place."""
    merged: list[MovingThing] = []
    for thing in things:
        for k, other in enumerate(merged):
            if thing.direction @ other.direction > math.cos(_ONE_THING):
                frames = tuple(sorted({*thing.frames, *other.frames}))
                merged[k] = other._replace(frames=frames, matches=other.matches + thing.matches)
                break
        else:
            merged.append(thing)
    return sorted(merged, key=lambda thing: -thing.matches)


def _between(
    evidence: Evidence, cameras: Sequence[Camera], rotations: Mapping[int, FloatArray], pair: Pair, parallax: Parallax
) -> list[MovingThing]:
    matches, rays, pixel = evidence.matches[pair], [], []
    for frame, which in zip(pair, (matches.first, matches.second), strict=True):
        camera = cameras[evidence.camera_of.get(frame, 0)]
        ray = camera.unproject(evidence.features[frame].pixels[which])
        pixel.append(1 / camera.pixels_per_radian(ray))
        rays.append(ray)
    seen = np.isfinite(rays[0][:, 0]) & np.isfinite(rays[1][:, 0])
    in_i, in_j, spans = rays[0][seen], rays[1][seen], np.hypot(*pixel)[seen]
    a = in_i @ rotations[pair[0]]
    step = in_j @ rotations[pair[1]] - a
    far = np.linalg.norm(step, axis=1)
    still = far < max(_STILL_PX, 3 * parallax.size_px) * spans
    moved = ~still & (far < _FURTHEST) & ~_along_step(in_i, in_j, spans, parallax)
    return _clusters(pair, a, step, far, still, moved)


def _along_step(in_i: FloatArray, in_j: FloatArray, spans: FloatArray, parallax: Parallax) -> NDArray[np.bool_]:
    """Matches (n,) that a step of the camera explains, where there was one."""
    if parallax.gain <= 0 or parallax.size_px < parallax.sigma_px:  # a step that half of the matches know nothing of
        return np.zeros(len(in_i), bool)
    off = np.cross(in_i @ parallax.turn.T, in_j) @ parallax.direction
    return np.asarray(np.abs(off) < _OFF_PLANE * max(parallax.sigma_px, 0.5) * spans)


def _clusters(
    pair: Pair,
    a: FloatArray,
    step: FloatArray,
    far: FloatArray,
    still: NDArray[np.bool_],
    moved: NDArray[np.bool_],
) -> list[MovingThing]:
    """Matches that moved alike beside each other, the largest group first, until what is left is too little."""
    found: list[MovingThing] = []
    left = np.flatnonzero(moved)
    while len(left) >= _LEAST:
        near = np.linalg.norm(a[left, None] - a[left], axis=-1) < _NEIGHBOURS
        alike = np.linalg.norm(step[left, None] - step[left], axis=-1) < _ALIKE * far[left]
        together = near & alike
        middle = int(together.sum(1).argmax())
        members = left[together[middle]]
        if len(members) < _LEAST:
            break
        centre = a[members].mean(0)
        reach = np.median(np.linalg.norm(a[members] - centre, axis=1))
        beside = np.linalg.norm(a[still] - centre, axis=1) < reach
        if beside.sum() < 0.5 * len(members):
            direction = centre / np.linalg.norm(centre)
            found.append(MovingThing(pair, direction, float(np.median(far[members])), len(members)))
        left = np.setdiff1d(left, members)
    return found
