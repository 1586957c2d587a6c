"""The pose of a target before a known camera, from rays: linear, and right past 90 degrees.

A point R X + t lies along its ray x when x cross (R X + t) = 0, which never divides by z.
"""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.calibration.points import Poses, Sightings, is_flat
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray


def linear_poses(sightings: Sightings, camera: Camera) -> Poses:
    """The pose of each view for a known camera, from rays: linear, so a start for `descend`, not its end."""
    rays = camera.unproject(sightings.pixels)
    found = [_pose(points, x) for points, x in zip(*map(sightings.split, (sightings.points, rays)), strict=True)]
    return Poses(np.array([rotation for rotation, _ in found]), np.array([translation for _, translation in found]))


def _pose(points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation with rays (n, 3) along R points + t; rays that are NaN do not count.

    Minimises the sum of |x cross (A y + t)|^2 over all 3 x 4 matrices [A t], y the points along the axes of their own
    spread; A is then replaced by the nearest rotation and t by the best for it.  Points on a plane have no third
    axis: two columns of A are found and the third is their cross product.
    """
    mean = points.mean(0)
    axes = np.linalg.svd(points - mean, full_matrices=False)[2]
    axes *= np.sign(np.linalg.det(axes))
    spread = (points - mean) @ axes.T
    unit = math.sqrt(float(np.mean(spread**2)))
    known = 2 if is_flat(points) else 3
    y = np.column_stack([spread[:, :known] / unit, np.ones(len(points))])
    seen = np.asarray(np.isfinite(rays).all(1))
    x = np.where(seen[:, None], rays, 0.0)
    across = seen[:, None, None] * np.eye(3) - x[:, :, None] * x[:, None, :]  # |x cross p|^2 = p . across p
    moments = across.reshape(-1, 9).T @ (y[:, :, None] * y[:, None, :]).reshape(len(y), -1)
    moments = moments.reshape(3, 3, known + 1, known + 1).transpose(0, 2, 1, 3).reshape(3 * known + 3, -1)
    form = np.linalg.eigh(moments)[1][:, 0].reshape(3, known + 1)
    if np.sum(x * (y @ form.T)) < 0:  # the points stand along their rays, not opposite
        form = -form
    rotation = _nearest_rotation(form[:, :known])
    turned = rotation[:, :known] @ y[:, :known].T
    translation = -np.linalg.lstsq(across.sum(0), np.einsum("nij,jn->i", across, turned), rcond=None)[0]
    whole = rotation @ axes
    return whole, translation * unit - whole @ mean


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a (3, 3) matrix, or nearest in its first two columns to a (3, 2) matrix."""
    u, _, vt = np.linalg.svd(matrix, full_matrices=False)
    if matrix.shape[1] == 2:
        first = u @ vt
        return np.column_stack([first, np.cross(first[:, 0], first[:, 1])])
    rotation: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rotation
