"""Pairs of frames -> links: which keypoints are the same thing, and the rotation between the two cameras."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.kernels import two_best

RATIO = 0.72  # Lowe's test: the best match is nearer than this times the second best
HELD_BACK = 5  # one match in so many is never used in a fit
MIN_INLIERS = 12  # chance agreement with a rotation to a hundredth of the sphere's area does not reach it
_TRIALS = 600
_JUDGES = 300  # matches that are enough to choose among the trials by
_BLOCK = 256  # rows of the similarity matrix at a time: they stay in the processor's cache


class Matches(NamedTuple):
    """Indices (n,) of the keypoints matched in each of two frames."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]

    def where(self, keep: NDArray[np.bool_]) -> Matches:
        """Those marked in `keep` (n,)."""
        return Matches(self.first[keep], self.second[keep])


NO_MATCHES = Matches(np.empty(0, np.intp), np.empty(0, np.intp))


class RotationFit(NamedTuple):
    """A rotation (3, 3) that takes the rays of one frame into the other's, and the matches (n,) that agree with it."""

    rotation: FloatArray
    inliers: NDArray[np.bool_]


def match_features(a: Features, b: Features) -> Matches:
    """Mutually best matches that pass the ratio test both ways, by one product of the descriptors."""
    if len(a) < 2 or len(b) < 2:
        return NO_MATCHES
    count, other = len(a), len(b)
    best_of_row, rows = np.zeros(count, np.intp), np.full((count, 2), -2, np.float32)
    best_of_column, columns = np.zeros(other, np.intp), np.full((other, 2), -2, np.float32)
    words, transposed = a.descriptors.astype(np.float32, copy=False), np.ascontiguousarray(b.descriptors.T, np.float32)
    for start in range(0, count, _BLOCK):
        similarity = words[start : start + _BLOCK] @ transposed
        two_best(similarity, start, best_of_row, rows, best_of_column, columns)
    mutual = best_of_column[best_of_row] == np.arange(count)
    first = np.flatnonzero(mutual & _clear(rows) & _clear(columns)[best_of_row])
    return Matches(first, best_of_row[first])


def held_back(pixels: FloatArray) -> NDArray[np.bool_]:
    """Whether each keypoint (n, 2) is kept from every fit: one in five, by its place in the picture alone.

    So the choice depends on no order, no thread and no other keypoint, and a keypoint is held back against all frames.
    The finalizer of SplitMix64 (Steele, Lea & Flood, OOPSLA 2014) over the position in 1/256 px.
    """
    steps = np.round(256 * pixels).astype(np.int64).astype(np.uint64)
    mixed = _mixed(_mixed(steps[:, 0]) ^ steps[:, 1])
    held: NDArray[np.bool_] = mixed % np.uint64(HELD_BACK) == 0
    return held


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    x = x + np.uint64(0x9E3779B97F4A7C15)  # wraps round, as it should
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _clear(two: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether the best of two similarities (n, 2) is clearly nearer than the second (distance^2 = 2 - 2 s)."""
    clear: NDArray[np.bool_] = (1 - two[:, 0]) < RATIO**2 * (1 - two[:, 1])
    return clear


def fit_rotation(rays_a: FloatArray, rays_b: FloatArray, tolerance: FloatArray, seed: int) -> RotationFit | None:
    """The rotation most matches agree with: b = R a, by two-ray RANSAC with the MSAC cost, then by least squares.

    Parameters
    ----------
    rays_a, rays_b
        Unit rays (n, 3) of the matches in the two camera frames.
    tolerance
        Angle (n,) in radians to which each match must agree.
    seed
        Of the random trials.

    Returns
    -------
    The fit, or None when fewer than `MIN_INLIERS` matches agree.  Torr & Zisserman 2000 (MSAC); Kabsch 1976.
    """
    n = len(rays_a)
    if n < MIN_INLIERS:
        return None
    limit = 2 * np.sin(tolerance / 2)  # the chord of the angle: no arc cosine, exact for small and large angles
    candidates = _two_ray_rotations(rays_a, rays_b, limit, np.random.default_rng(seed))
    if len(candidates) == 0:
        return None
    judges = slice(None, None, -(-n // _JUDGES))
    products = (rays_b[judges, :, None] * rays_a[judges, None, :]).reshape(-1, 9)
    chord2 = 2 - 2 * candidates.reshape(-1, 9) @ products.T  # |b - R a|^2 of unit rays, as one matrix product
    rotation = candidates[np.minimum(chord2 / limit[judges] ** 2, 1.0).sum(1).argmin()]
    inliers = np.zeros(n, bool)
    for _ in range(20):
        now = np.linalg.norm(rays_a @ rotation.T - rays_b, axis=1) < limit
        if now.sum() < MIN_INLIERS:
            return None
        if np.array_equal(now, inliers):
            break
        inliers = now
        rotation = best_rotation(rays_a[inliers], rays_b[inliers], 1 / limit[inliers] ** 2)
    return RotationFit(rotation, inliers)


def best_rotation(rays_a: FloatArray, rays_b: FloatArray, weight: FloatArray) -> FloatArray:
    """The rotation R (3, 3) that minimises sum of weight |b - R a|^2 (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((weight[:, None] * rays_b).T @ rays_a)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation: FloatArray = u @ sign @ vt
    return rotation


def _two_ray_rotations(a: FloatArray, b: FloatArray, limit: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Rotations (t, 3, 3) that carry two random rays of `a` exactly as near as can be onto their partners in `b`.

    Pairs whose angle differs between the frames by more than the tolerance, and pairs too close to fix a rotation, are
    dropped before anything is counted.
    """
    pick = rng.integers(0, len(a), (8 * _TRIALS, 2))
    chord_a = np.linalg.norm(a[pick[:, 0]] - a[pick[:, 1]], axis=1)
    chord_b = np.linalg.norm(b[pick[:, 0]] - b[pick[:, 1]], axis=1)
    apart = (chord_a > 0.1) & (chord_a < 1.95)
    rigid = np.abs(chord_a - chord_b) < limit[pick].sum(1)
    pick = pick[apart & rigid][:_TRIALS]
    return _triads(b[pick[:, 0]], b[pick[:, 1]]) @ np.swapaxes(_triads(a[pick[:, 0]], a[pick[:, 1]]), 1, 2)


def _triads(p: FloatArray, q: FloatArray) -> FloatArray:
    """Orthonormal frames (t, 3, 3), as columns, that treat both rays alike: sum, difference and their normal."""
    along, across = p + q, q - p
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([along, across, np.cross(along, across)], -1)
