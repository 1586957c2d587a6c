"""The pose of a target before a known camera, from rays: linear, and right past 90 degrees.

A point R X + t lies along its ray x when x cross (R X + t) = 0, which never divides by z.  Where many
points may be wrong, the pose with the least median angle among those of small random subsets is taken (Rousseeuw 1984).
"""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.calibration.points import Poses, Sightings, is_flat
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_SUBSETS, _SUBSET = 60, 7  # at 40 % wrong points, 4 in 5 times one of the subsets is all right; at 20 % always
_NEAR = 2.5  # times 1.48 times the median: a normal deviation of 2.5 sigma


def linear_poses(sightings: Sightings, camera: Camera, robust: bool = False) -> Poses:
    """The pose of each view for a known camera, from rays: linear, so a start for `descend`, not its end.

    With `robust`, up to almost half of a view's points may be wrong.
    """
    rays = camera.unproject(sightings.pixels)
    pose = _median_pose if robust else _least_squares_pose
    found = [pose(points, x) for points, x in zip(*map(sightings.split, (sightings.points, rays)), strict=True)]
    return Poses(np.array([rotation for rotation, _ in found]), np.array([translation for _, translation in found]))


def _least_squares_pose(points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    rotations, translations = _poses(points, rays, np.ones((1, len(points))))
    return rotations[0], translations[0]


def _median_pose(points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The pose of the random subset whose median angle over all points is least, refined on the points near it."""
    count = len(points)
    rng = np.random.default_rng(0)
    chosen = rng.permuted(np.tile(np.arange(count) < _SUBSET, (_SUBSETS, 1)), axis=1)
    weights = np.concatenate([np.ones((1, count)), chosen])
    for _ in range(3):
        rotations, translations = _poses(points, rays, weights)
        angles = _angles(points, rays, rotations, translations)
        medians = np.median(angles, axis=1)
        best = int(np.argmin(medians))
        weights = (angles[best] <= max(_NEAR * 1.48 * medians[best], 1e-12))[None].astype(float)
        if np.count_nonzero(weights) < _SUBSET:
            break
    return rotations[best], translations[best]


def _angles(points: FloatArray, rays: FloatArray, rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """Angles (s, n) in radians between the rays and the points placed by s poses; pi where a ray is NaN."""
    placed = np.einsum("sij,nj->sni", rotations, points) + translations[:, None]
    across = np.linalg.norm(np.cross(rays[None], placed), axis=-1)
    angles: FloatArray = np.nan_to_num(np.arctan2(across, np.sum(rays * placed, -1)), nan=math.pi)
    return angles


def _poses(points: FloatArray, rays: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (s, 3, 3) and translations (s, 3) with rays (n, 3) along R points + t, for s sets of weights (s, n).

    Minimises the sum of |x cross (A y + t)|^2 over all 3 x 4 matrices [A t], y the points along the axes of their own
    spread; A is then replaced by the nearest rotation and t by the best for it.  Points on a plane have no third
    axis: two columns of A are found and the third is their cross product.  Rays that are NaN do not count.
    """
    mean = points.mean(0)
    axes = np.linalg.svd(points - mean, full_matrices=False)[2]
    axes *= np.sign(np.linalg.det(axes))
    spread = (points - mean) @ axes.T
    unit = math.sqrt(float(np.mean(spread**2)))
    known = 2 if is_flat(points) else 3
    y = np.column_stack([spread[:, :known] / unit, np.ones(len(points))])
    seen = np.asarray(np.isfinite(rays).all(1))
    x, counts = np.where(seen[:, None], rays, 0.0), weights * seen
    across = np.eye(3) - x[:, :, None] * x[:, None, :]  # |x cross p|^2 = p . across p
    outer = (across[:, :, None, :, None] * (y[:, :, None] * y[:, None, :])[:, None, :, None, :]).reshape(len(y), -1)
    width = 3 * (known + 1)
    moments = (counts @ outer).reshape(-1, width, width)
    form = np.linalg.eigh(moments)[1][:, :, 0].reshape(-1, 3, known + 1)
    behind = np.einsum("sn,ni,sij,nj->s", counts, x, form, y) < 0  # the points stand opposite to their rays
    form = np.where(behind[:, None, None], -form, form)
    rotation = _nearest_rotations(form[:, :, :known])
    turned = np.einsum("sij,nj->sni", rotation[:, :, :known], y[:, :known])
    whole = (counts @ across.reshape(-1, 9)).reshape(-1, 3, 3)
    pulled = np.einsum("sn,nij,snj->si", counts, across, turned)
    translation = -(np.linalg.pinv(whole, hermitian=True) @ pulled[..., None])[..., 0]
    rotation = rotation @ axes
    return rotation, translation * unit - rotation @ mean


def _nearest_rotations(matrices: FloatArray) -> FloatArray:
    """The rotations nearest to (s, 3, 3) matrices, or nearest in their first two columns to (s, 3, 2) matrices."""
    u, _, vt = np.linalg.svd(matrices, full_matrices=False)
    if matrices.shape[-1] == 2:
        first = u @ vt
        return np.concatenate([first, np.cross(first[..., 0], first[..., 1])[..., None]], -1)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotations: FloatArray = u @ vt
    return rotations
