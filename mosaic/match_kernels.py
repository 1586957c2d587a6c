"""The compiled loop over matches of a bundle adjustment."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.kernels import compiled


@compiled
def whiten(
    ray_i: np.ndarray,
    ray_j: np.ndarray,
    by_ray_i: np.ndarray,
    by_ray_j: np.ndarray,
    turns: np.ndarray,
    turn_of: np.ndarray,
    off: np.ndarray,
    by_parameter_i: np.ndarray,
    by_parameter_j: np.ndarray,
    residual: np.ndarray,
    by_i: np.ndarray,
    by_j: np.ndarray,
    by_camera_i: np.ndarray,
    by_camera_j: np.ndarray,
) -> None:
    """Whitened residuals of matches and their derivatives, from those of the two projections.

    A = d u_j / d u_i carries the noise of the first keypoint over; W is lower triangular with W (I + A A^T) W^T = I.

    Parameters
    ----------
    ray_i, ray_j
        Rays (m, 3) of the first keypoint in both camera frames.
    by_ray_i, by_ray_j
        d pixel / d ray (m, 2, 3) there.
    turns, turn_of
        Different rotations (t, 3, 3) from the first camera frame to the second, and which one (m,) is each match's.
    off
        Projected minus observed pixel (m, 2) in the second frame.
    by_parameter_i, by_parameter_j
        d pixel / d camera value (m, 2, P) of both cameras.
    residual, by_i, by_j, by_camera_i, by_camera_j
        Where the results go: (m, 2), (m, 2, 3) by small turns of the frames, and (m, 2, P).
    """
    through = np.empty((2, 3))
    carried = np.empty((2, 2))
    for m in range(ray_i.shape[0]):
        turn = turns[turn_of[m]]
        ji, jj = by_ray_i[m], by_ray_j[m]
        for a in range(2):
            for b in range(3):
                through[a, b] = jj[a, 0] * turn[0, b] + jj[a, 1] * turn[1, b] + jj[a, 2] * turn[2, b]
        # The ray of a fixed pixel: J is blind along the ray, so its pseudo-inverse moves the ray on the sphere only.
        g00 = ji[0, 0] * ji[0, 0] + ji[0, 1] * ji[0, 1] + ji[0, 2] * ji[0, 2]
        g01 = ji[0, 0] * ji[1, 0] + ji[0, 1] * ji[1, 1] + ji[0, 2] * ji[1, 2]
        g11 = ji[1, 0] * ji[1, 0] + ji[1, 1] * ji[1, 1] + ji[1, 2] * ji[1, 2]
        determinant = g00 * g11 - g01 * g01
        for a in range(2):
            t0 = through[a, 0] * ji[0, 0] + through[a, 1] * ji[0, 1] + through[a, 2] * ji[0, 2]
            t1 = through[a, 0] * ji[1, 0] + through[a, 1] * ji[1, 1] + through[a, 2] * ji[1, 2]
            carried[a, 0] = (t0 * g11 - t1 * g01) / determinant
            carried[a, 1] = (t1 * g00 - t0 * g01) / determinant
        c00 = 1 + carried[0, 0] * carried[0, 0] + carried[0, 1] * carried[0, 1]
        c10 = carried[0, 0] * carried[1, 0] + carried[0, 1] * carried[1, 1]
        c11 = 1 + carried[1, 0] * carried[1, 0] + carried[1, 1] * carried[1, 1]
        first = math.sqrt(c00)
        mixed = c10 / first
        second = math.sqrt(c11 - mixed * mixed)
        w00, w10, w11 = 1 / first, -mixed / (first * second), 1 / second

        residual[m, 0] = w00 * off[m, 0]
        residual[m, 1] = w10 * off[m, 0] + w11 * off[m, 1]
        for b in range(3):
            p, q = (b + 1) % 3, (b + 2) % 3  # column b of a matrix times [v]x takes its columns p and q
            i0 = through[0, p] * ray_i[m, q] - through[0, q] * ray_i[m, p]
            i1 = through[1, p] * ray_i[m, q] - through[1, q] * ray_i[m, p]
            j0 = jj[0, p] * ray_j[m, q] - jj[0, q] * ray_j[m, p]
            j1 = jj[1, p] * ray_j[m, q] - jj[1, q] * ray_j[m, p]
            by_i[m, 0, b] = w00 * i0
            by_i[m, 1, b] = w10 * i0 + w11 * i1
            by_j[m, 0, b] = -w00 * j0
            by_j[m, 1, b] = -(w10 * j0 + w11 * j1)
        for b in range(by_parameter_i.shape[2]):
            i0 = carried[0, 0] * by_parameter_i[m, 0, b] + carried[0, 1] * by_parameter_i[m, 1, b]
            i1 = carried[1, 0] * by_parameter_i[m, 0, b] + carried[1, 1] * by_parameter_i[m, 1, b]
            by_camera_i[m, 0, b] = -w00 * i0
            by_camera_i[m, 1, b] = -(w10 * i0 + w11 * i1)
        for b in range(by_parameter_j.shape[2]):
            j0, j1 = by_parameter_j[m, 0, b], by_parameter_j[m, 1, b]
            by_camera_j[m, 0, b] = w00 * j0
            by_camera_j[m, 1, b] = w10 * j0 + w11 * j1


@compiled
def turned(rays: np.ndarray, turns: np.ndarray, turn_of: np.ndarray, result: np.ndarray) -> None:
    """Rays (m, 3), each turned by that of the rotations (t, 3, 3) which `turn_of` (m,) names, into `result` (m, 3)."""
    for m in range(rays.shape[0]):
        turn = turns[turn_of[m]]
        x, y, z = rays[m]
        for a in range(3):
            result[m, a] = turn[a, 0] * x + turn[a, 1] * y + turn[a, 2] * z
