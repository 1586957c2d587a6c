"""A camera that is turned and carried through a room of points: what it matches, with true parallax."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.links import Evidence
from fullsphere.mosaic.matching import Matches

ROOM = np.array([2.6, 1.4, 3.1])
"""Half of the room's sides, metres."""


def room_points(count: int, seed: int = 0) -> FloatArray:
    """Points (count, 3) in metres, on the walls of the room and on what stands in it."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 3))
    wall = np.abs(points).argmax(1)
    points[np.arange(count), wall] = np.sign(points[np.arange(count), wall]) * rng.choice(
        [1.0, 0.75], count, p=[0.7, 0.3]
    )
    return np.asarray(points * ROOM)


def evidence_of(
    camera: Camera,
    rotations: FloatArray,
    positions: FloatArray,
    points: FloatArray,
    noise_px: float = 0.3,
    wrong: float = 0.1,
    seed: int = 0,
) -> Evidence:
    """Keypoints and matches of frames taken at positions (n, 3): every point that both see, a share of them wrong."""
    rng = np.random.default_rng(seed)
    features, seen = {}, {}
    for k, (rotation, position) in enumerate(zip(rotations, positions, strict=True)):
        pixels = camera.project((points - position) @ rotation.T)
        visible = np.isfinite(pixels[:, 0])
        noisy = np.where(visible[:, None], pixels, 0) + rng.normal(0, noise_px, pixels.shape)
        visible &= np.isfinite(camera.unproject(noisy)[:, 0])
        features[k], seen[k] = Features(noisy, np.zeros((len(points), 128), np.float32)), visible
    matches = {}
    for i, j in itertools.combinations(features, 2):
        first = np.flatnonzero(seen[i] & seen[j])
        second = first.copy()
        swapped = rng.random(len(first)) < wrong
        second[swapped] = rng.permutation(second[swapped])
        if len(first) > 20:
            matches[i, j] = Matches(first, second)
    return Evidence(features, matches)


def pairs_of(groups: Sequence[Sequence[int]]) -> set[tuple[int, int]]:
    """All pairs of frames within the groups."""
    return {pair for group in groups for pair in itertools.combinations(sorted(group), 2)}
