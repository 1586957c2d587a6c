"""Two frames of a turning arm: by how much it turned between them.

Seen from halfway between the two frames, both rays of a thing turned by half of the turn D, the camera moved sideways,
and so the rays lie in one plane with the x axis:

    p = Ry(-D/2) arm_from_camera x_i,   q = Ry(D/2) arm_from_camera x_j,   p_y q_z - p_z q_y = 0.

With u, v the rays in the arm's frame before they turn, that is A cos(D/2) = B sin(D/2), where A = u_y v_z - v_y u_z and
B = u_y v_x + v_y u_x: each match tells a turn by itself, however near the thing is, and a near one is seen at a greater
angle from the x axis by the second frame (if D > 0).  That q is beyond p keeps its sign right: things lie ahead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

LEAST_AGREE = 12
"""Matches of two frames that have to agree in a turn."""

_LEAST_SHARE = 0.3  # of the matches that have to
_VOTES = 120  # matches whose turns are tried
_ROUNDS = 12


class Rays(NamedTuple):
    """Matches of frames i and j: unit rays (m, 3) in both camera frames, and the noise (m,) of each, radians."""

    first: FloatArray
    second: FloatArray
    noise_first: FloatArray
    noise_second: FloatArray

    def where(self, keep: NDArray[np.bool_]) -> Rays:
        """Those marked in `keep` (m,)."""
        return Rays(*(values[keep] for values in self))


class PairTurn(NamedTuple):
    """By how much the arm turned from one frame to another, radians, and the matches (m,) that agree."""

    turn: float
    sigma: float
    agree: NDArray[np.bool_]


class Plane(NamedTuple):
    """How matches stand to a turn.

    Attributes
    ----------
    off
        p_y q_z - p_z q_y (m,): none for rays that meet.
    noise
        One standard deviation (m,) of it: Sampson's first-order error.
    beyond
        By how much (m,) the second ray is further from the x axis than the first, radians: parallax, positive ahead.
    halves
        p and q (m, 3).
    """

    off: FloatArray
    noise: FloatArray
    beyond: FloatArray
    halves: tuple[FloatArray, FloatArray]


def rays_of(camera: Camera, pixels: FloatArray, sigma_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) of keypoints, and their noise (n,) in radians."""
    rays = camera.unproject(pixels)
    return rays, sigma_px / camera.pixels_per_radian(rays)


def about_y(rays: FloatArray, angles: FloatArray | float) -> FloatArray:
    """Ry(angle) ray of each of the rays (m, 3), by angles (m,) or one for all."""
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([c * rays[:, 0] + s * rays[:, 2], rays[:, 1], c * rays[:, 2] - s * rays[:, 0]], -1)


def plane_of(rays: Rays, mount: FloatArray, turns: FloatArray | float) -> Plane:
    """How matches stand to turns (m,), or one for all, of a camera that is held as `mount` (3, 3) tells."""
    p, q = about_y(rays.first @ mount, -0.5 * turns), about_y(rays.second @ mount, 0.5 * turns)
    off = p[:, 1] * q[:, 2] - p[:, 2] * q[:, 1]
    across_p, across_q = np.hypot(p[:, 1], p[:, 2]), np.hypot(q[:, 1], q[:, 2])
    noise = np.hypot(rays.noise_first * across_q, rays.noise_second * across_p)
    same_side = p[:, 1] * q[:, 1] + p[:, 2] * q[:, 2] > 0
    beyond = np.where(same_side, p[:, 0] * across_q - q[:, 0] * across_p, -1.0) * np.sign(turns)
    return Plane(off, np.maximum(noise, 1e-12), beyond, (p, q))


def slope_by_turn(plane: Plane) -> FloatArray:
    """Derivative (m,) of `off` by the turn."""
    p, q = plane.halves
    return np.asarray(-0.5 * (p[:, 1] * q[:, 0] + p[:, 0] * q[:, 1]))


def slopes_by_mount(plane: Plane, turns: FloatArray | float, axes: FloatArray) -> FloatArray:
    """Derivatives (m, k) of `off` by turns of the camera about axes (k, 3) of the arm's frame."""
    p, q = plane.halves
    none = np.zeros(len(p))
    by_p, by_q = np.stack([none, q[:, 2], -q[:, 1]], -1), np.stack([none, -p[:, 2], p[:, 1]], -1)
    u, v = about_y(p, 0.5 * turns), about_y(q, -0.5 * turns)
    by_axis = np.cross(u, about_y(by_p, 0.5 * turns)) + np.cross(v, about_y(by_q, -0.5 * turns))
    return np.asarray(by_axis @ axes.T)


def find_pair_turn(rays: Rays, mount: FloatArray, tolerance: float) -> PairTurn | None:
    """The turn that most matches agree with: by MSAC over the turn of each (Torr & Zisserman 2000), then least squares.

    Parameters
    ----------
    rays
        The matches.
    mount
        camera_from_arm (3, 3), known to a few degrees.
    tolerance
        How many times its noise a match may be off.

    Returns
    -------
    The turn, or None where too few agree.
    """
    if len(rays.first) < LEAST_AGREE:
        return None
    turn = _best_vote(rays, mount, tolerance)
    agree = np.zeros(len(rays.first), bool)
    for _ in range(_ROUNDS):
        plane = plane_of(rays, mount, turn)
        now = _agree(plane, rays, tolerance)
        slope = slope_by_turn(plane) / plane.noise
        weight = np.where(now, 1 / (1 + (plane.off / plane.noise) ** 2), 0.0)
        information = float(weight @ slope**2)
        if information <= 0:
            return None
        step = float(weight @ (slope * plane.off / plane.noise)) / information
        turn -= step
        if np.array_equal(now, agree) and abs(step) < 1e-7:
            break
        agree = now
    if agree.sum() < max(LEAST_AGREE, _LEAST_SHARE * len(agree)):
        return None
    spread = max(1.0, 1.48 * float(np.median(np.abs(plane.off / plane.noise)[agree])))
    return PairTurn(math.remainder(turn, 2 * math.pi), spread / math.sqrt(information), agree)


def _best_vote(rays: Rays, mount: FloatArray, tolerance: float) -> float:
    """The turn of a single match that agrees with most others."""
    u, v = rays.first @ mount, rays.second @ mount
    across = u[:, 1] * v[:, 2] - v[:, 1] * u[:, 2]
    along = u[:, 1] * v[:, 0] + v[:, 1] * u[:, 0]
    telling = np.argsort(-np.hypot(across, along) / (rays.noise_first + rays.noise_second), kind="stable")[:_VOTES]
    half = np.arctan2(across[telling], along[telling])[:, None]
    half = np.where(half > np.pi / 2, half - np.pi, np.where(half < -np.pi / 2, half + np.pi, half))
    c, s = np.cos(half), np.sin(half)
    off = c * across - s * along
    across_p, across_q = np.hypot(u[:, 1], s * u[:, 0] + c * u[:, 2]), np.hypot(v[:, 1], c * v[:, 2] - s * v[:, 0])
    noise2 = (rays.noise_first * across_q) ** 2 + (rays.noise_second * across_p) ** 2
    beyond = np.sign(half) * ((c * u[:, 0] - s * u[:, 2]) * across_q - (c * v[:, 0] + s * v[:, 2]) * across_p)
    cost = np.minimum(off**2 / (tolerance**2 * noise2), 1.0)
    cost[beyond < -tolerance * np.hypot(rays.noise_first, rays.noise_second)] = 1.0
    return float(2 * half[np.argmin(cost.sum(1)), 0])


def _agree(plane: Plane, rays: Rays, tolerance: float) -> NDArray[np.bool_]:
    """Whether each match (m,) agrees and lies ahead."""
    near: NDArray[np.bool_] = np.abs(plane.off) < tolerance * plane.noise
    return near & ahead(plane, rays, tolerance)


def ahead(plane: Plane, rays: Rays, tolerance: float) -> NDArray[np.bool_]:
    """Whether each match (m,) may lie ahead of the camera: parallax of the right sign, but for some of its noise."""
    may: NDArray[np.bool_] = plane.beyond > -tolerance * np.hypot(rays.noise_first, rays.noise_second)
    return may
