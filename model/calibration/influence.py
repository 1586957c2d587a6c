"""How a least-squares fit leans on each point: what it absorbs of the noise, and how well it predicts other points.

With the Jacobian J = Q R of the points fitted, residuals of noise sigma have the covariance sigma^2 (1 - Q Q^T), and
the prediction of a point with Jacobian row j has the covariance sigma^2 (j R^-1) (j R^-1)^T (Hoaglin and Welsch 1978).
Both follow from the rows j R^-1, which are those of Q for the points fitted.  As every view has a pose of its own, a
row has six entries for that and some that all views share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_LOST = 1e-12  # of the largest singular value: a direction that the points do not determine


class Influence(NamedTuple):
    """Rows j R^-1 of N points: `of_pose` (N, 2, 6) belongs to the point's view, `of_shared` (N, 2, S) to all."""

    view: NDArray[np.intp]
    of_pose: FloatArray
    of_shared: FloatArray

    @property
    def prediction(self) -> FloatArray:
        """Covariance (N, 2, 2) of each predicted pixel, for noise of variance 1."""
        poses = self.of_pose @ self.of_pose.swapaxes(1, 2)
        return np.asarray(poses + self.of_shared @ self.of_shared.swapaxes(1, 2))

    def left_after_fit(self, weights: FloatArray) -> FloatArray:
        """Covariance (m, m) of the sums weights (m, N, 2) . residuals, for noise of variance 1 in the points fitted."""
        left: FloatArray = np.einsum("anc,bnc->ab", weights, weights)
        shared = np.einsum("anc,ncs->as", weights, self.of_shared)
        left -= shared @ shared.T
        for view in np.unique(self.view):
            mine = self.view == view
            pose = np.einsum("anc,ncs->as", weights[:, mine], self.of_pose[mine])
            left -= pose @ pose.T
        return left


def influence(
    camera: Camera, rays: FloatArray, view: NDArray[np.intp], used: NDArray[np.bool_], bow: FloatArray
) -> Influence:
    """The influence of points on a fit over all camera values, a pose for each view, and a bow.

    Parameters
    ----------
    camera
        As fitted; it must see all the rays.
    rays
        Predicted rays (N, 3) in camera frames, with their distances.
    view
        (N,) whose pose each belongs to.
    used
        (N,) whether the point was fitted; the others are predicted.
    bow
        (N, 3, B) movement of the rays by further shared unknowns; B may be 0.
    """
    _, by_ray, by_camera = camera.project_with_jacobians(rays)
    shared = np.concatenate([by_camera, by_ray @ bow], -1)
    scale = np.sqrt(np.mean(shared[used] ** 2, axis=(0, 1)))
    shared = shared / np.where(scale > 0, scale, 1.0)
    of_pose = np.zeros((len(rays), 2, 6))
    for each in np.unique(view):
        mine, fitted = view == each, used[view == each]
        centre = rays[mine].mean(0)  # turning about the points' centre moves the picture least
        size = float(np.max(np.abs(rays[mine] - centre)))
        turning = np.cross((rays[mine] - centre)[:, None, :], by_ray[mine])
        pose = np.concatenate([turning, size * by_ray[mine]], -1)
        of_pose[mine], reach = _whitened(pose, fitted)
        taken = np.einsum("ncp,ncs->ps", of_pose[mine][fitted], shared[mine][fitted])
        shared[mine] -= of_pose[mine] @ (reach[:, None] * taken)
    of_shared, reach = _whitened(shared, used)
    return Influence(view, of_pose, of_shared * reach)


def _whitened(rows: FloatArray, fitted: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Rows (n, 2, k) times R^-1 of those fitted; and (k,) 1, or 0 for directions that these do not determine."""
    width = rows.shape[-1]
    scale = np.linalg.norm(rows[fitted].reshape(-1, width), axis=0)
    scaled = rows / np.where(scale > 0, scale, 1.0)
    _, singular, vt = np.linalg.svd(
        np.pad(scaled[fitted].reshape(-1, width), ((0, width), (0, 0))), full_matrices=False
    )
    known = singular > _LOST * singular[0]
    return scaled @ (vt.T * (known / np.where(known, singular, 1.0))), known.astype(float)
