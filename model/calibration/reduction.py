"""Rows of a least-squares problem with one pose per view, reduced by QR to what each part needs to know.

The rows of one view, [pose | shared | residual], are triangularised: the rows below the pose columns are all that the
shared unknowns need to know of that view, and the poses follow by back substitution.  Nothing is squared, so the
digits that the nearly interchangeable lens values live on are kept.

The reduction is made in blocks of a fixed number of points: fast as one batch, and small enough that the linear algebra
library keeps to one thread, so that results do not depend on the number of threads.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray

POSE = 6  # unknowns of a view: rotation vector, translation
_BLOCK_ROWS = 128
_NEAREST_SINGULAR = 1e-12  # of the largest singular value: what is less certain is reported as exactly that uncertain


def _upper(rows: FloatArray) -> FloatArray:
    return cast(FloatArray, np.linalg.qr(rows, mode="r"))  # NumPy's own types forget what mode "r" returns


def triangle(rows: FloatArray) -> FloatArray:
    """The upper triangle (K, K) of the QR factorisation of rows (m, K), zero-filled where m < K."""
    missing = max(0, rows.shape[1] - rows.shape[0])
    return _upper(np.pad(rows, ((0, missing), (0, 0))))


def triangles_by_view(rows: FloatArray, view: NDArray[np.intp], views: int) -> FloatArray:
    """Rows (N, 2, K) of all points, sorted by view, -> one triangle per view (V, K, K)."""
    width = rows.shape[-1]
    pieces, owner, count = rows, view, np.bincount(view, minlength=views)
    while True:
        per_block = max(2, _BLOCK_ROWS // pieces.shape[1])
        blocks = -(-count // per_block)
        first_piece, first_block = np.cumsum(count) - count, np.cumsum(blocks) - blocks
        place = np.arange(len(pieces)) - first_piece[owner]
        padded = np.zeros((int(blocks.sum()), per_block, pieces.shape[1], width))
        padded[first_block[owner] + place // per_block, place % per_block] = pieces
        pieces = _upper(padded.reshape(len(padded), -1, width))
        owner, count = np.repeat(np.arange(views), blocks), blocks
        if len(pieces) == views:
            return pieces


def column_norms(triangles: FloatArray) -> FloatArray:
    """Norms (V, K - 1) of the columns, those of the poses view by view and the shared ones over all views."""
    norms: FloatArray = np.sqrt(np.sum(triangles[..., :-1] ** 2, -2))
    norms[:, POSE:] = np.sqrt(np.sum(norms[:, POSE:] ** 2, 0))
    norms[norms == 0] = 1.0  # a column of zeros would leave its unknown undamped
    return norms


def damped(triangles: FloatArray, scale: FloatArray, damping: float) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt rows added: the triangles again, and the triangle (S + 1, S + 1) left for the shared part.

    Each unknown is held by sqrt(damping) times its entry of `scale`, the (V, K - 1) of `column_norms`.
    """
    views, width, _ = triangles.shape
    ballast = np.zeros((views, POSE, width))
    ballast[:, np.arange(POSE), np.arange(POSE)] = math.sqrt(damping) * scale[:, :POSE]
    held = _upper(np.concatenate([triangles, ballast], 1))
    weight = np.pad(np.diag(math.sqrt(damping) * scale[0, POSE:]), ((0, 0), (0, 1)))
    return held, triangle(np.concatenate([held[:, POSE:, POSE:].reshape(-1, width - POSE), weight]))


def pose_steps(held: FloatArray, shared: FloatArray) -> FloatArray:
    """The steps (V, 6) of the poses that go with a step (S,) of the shared unknowns."""
    right = held[:, :POSE, -1] + held[:, :POSE, POSE:-1] @ shared
    steps = np.linalg.solve(held[:, :POSE, :POSE], -right[..., None])[..., 0]
    return np.asarray(steps, np.float64)


def promised_fall(triangles: FloatArray, poses: FloatArray, shared: FloatArray) -> float:
    """By how much the squared residuals fall with a step, if the rows hold.

    |r|^2 - |r + J step|^2, written without the difference of two large numbers.
    """
    whole = np.concatenate([poses, np.broadcast_to(shared, (len(poses), shared.size))], 1)
    change = np.einsum("vij,vj->vi", triangles[..., :-1], whole)
    return -float(np.sum(change * (change + 2 * triangles[..., -1])))


def inverse_factor(triangle: FloatArray) -> FloatArray:
    """F with F F^T = (triangle^T triangle)^-1, by SVD of the triangle with columns scaled to length 1."""
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0] = 1.0
    _, singular, vt = np.linalg.svd(triangle / scale)
    factor: FloatArray = vt.T / np.maximum(singular, _NEAREST_SINGULAR * singular[0]) / scale[:, None]
    return factor
