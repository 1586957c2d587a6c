"""What the frames of a turning arm show: keypoints as rays, and matches of two frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.allowed import allowed_pixels
from fullsphere.mosaic.circular_fit import MatchedPair
from fullsphere.mosaic.circular_motion import Rays, find_pair_turn, rays_of
from fullsphere.mosaic.features import Features, find_features
from fullsphere.mosaic.matching import held_back, match_features
from fullsphere.mosaic.project import Frame, Picture

_KEYPOINTS, _FOR_FRAMES = 700, 180  # of a frame, where there are no more frames; then fewer, all in all more
_FEWEST = 100
_BYTES = 1 << 28  # of the descriptors of all frames
_BYTES_PER_KEYPOINT = 340


class View(NamedTuple):
    """A frame's keypoints: features, unit rays (n, 3), their noise (n,) in radians, which (n,) no fit may see."""

    features: Features
    rays: FloatArray
    noise: FloatArray
    held: NDArray[np.bool_]


class FoundPair(NamedTuple):
    """A pair of frames, and the turn from the first to the second by itself, radians, with its standard deviation."""

    matched: MatchedPair
    turn: float
    sigma: float

    @property
    def ends(self) -> tuple[int, int]:
        """The two frames."""
        return self.matched.i, self.matched.j


def keypoints_for(frames: int) -> int:
    """How many keypoints of a frame are kept, so that all of them fit into memory together."""
    enough = _KEYPOINTS * math.sqrt(min(1.0, _FOR_FRAMES / frames))
    return max(_FEWEST, int(min(enough, _BYTES / _BYTES_PER_KEYPOINT / frames)))


def view(frame: Frame, picture: Picture, camera: Camera, most: int) -> View:
    """The keypoints of a frame.

    Raises
    ------
    InputError
        If the picture is not of the camera's size.
    """
    if picture.shape[1::-1] != camera.size:
        this, that = (f"{w} x {h}" for w, h in (picture.shape[1::-1], camera.size))
        raise InputError(f"{frame.id}: is {this} pixels, the camera is for {that}; give the camera of these frames")
    return view_of(camera, find_features(picture, allowed_pixels(frame, picture, camera), most, camera))


def view_of(camera: Camera, features: Features) -> View:
    """Keypoints as rays; those outside the field of view are left out."""
    rays, noise = rays_of(camera, features.pixels, features.sigma_px)
    seen = np.isfinite(rays[:, 0])
    features = features.where(seen)
    return View(features, rays[seen], noise[seen], held_back(features.pixels))


def pair_of(views: Mapping[int, View], i: int, j: int, mount: FloatArray, tolerance: float) -> FoundPair | None:
    """What two frames have in common, and the turn between them; None if nothing.

    Parameters
    ----------
    views
        By the frames' indices.
    i, j
        The two.
    mount
        camera_from_arm (3, 3), known to a few degrees.
    tolerance
        How many times its noise a match may be off.
    """
    one, other = views[i], views[j]
    first, second = match_features(one.features, other.features)
    rays = Rays(one.rays[first], other.rays[second], one.noise[first], other.noise[second])
    held = one.held[first] | other.held[second]
    found = find_pair_turn(rays, mount, tolerance)
    if found is None:
        return None
    agree = found.agree
    matched = MatchedPair(i, j, rays.where(agree), first[agree], second[agree], held[agree])
    return FoundPair(matched, found.turn, found.sigma)
