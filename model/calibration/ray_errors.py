"""How well a calibration knows the direction that a pixel looks in."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.grid import pixel_grid, solid_angles
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_GRID = 40  # pixels across the picture over which the common rotation is found


@dataclasses.dataclass(frozen=True, eq=False)
class RaySigma:
    """Standard deviation of ray directions over the picture.

    Attributes
    ----------
    u_px, v_px
        (W,) and (H,) pixels of a grid over the picture.
    relative_rad
        (H, W) after the best common rotation: the errors of directions against each other.  Turning the camera frame
        changes no picture, only what its axis is called, and the poses take it up; this is what matters to whoever
        finds the camera's orientation from its own pictures, and what a report shows.  NaN outside the field of view.
    absolute_rad
        (H, W) against the camera frame of the stated centre: what matters where the camera's axis itself is used.
    """

    u_px: FloatArray
    v_px: FloatArray
    relative_rad: FloatArray
    absolute_rad: FloatArray


def ray_sigma(calibration: Calibration, pixels: ArrayLike, relative: bool = True) -> FloatArray:
    """Standard deviation of the direction that pixels look in, due to the uncertainty of the camera's values.

    Parameters
    ----------
    calibration
        Whose covariance is carried over to rays: at a pixel that stays, J_ray d(ray) + J_values d(values) = 0.
    pixels
        (..., 2).
    relative
        Whether a rotation common to all rays is taken out, the one of least squared angle over the picture's solid
        angle as far as points were observed; otherwise it counts as an error.

    Returns
    -------
    (...,) radians: the root of the expected squared angle between stated and true ray; NaN outside the field of view.
    """
    pixels = np.asarray(pixels, float)
    moved = _ray_by_value(calibration.camera, pixels)
    if relative:
        rays = calibration.camera.unproject(pixels)
        moved = moved - np.cross(_common_rotation(calibration).T, rays[..., None, :]).swapaxes(-1, -2)
    sigma: FloatArray = np.sqrt(np.sum((moved @ calibration.covariance_factor) ** 2, axis=(-2, -1)))
    return sigma


def ray_sigma_map(calibration: Calibration, across: int = 60) -> RaySigma:
    """Both standard deviations on a grid over the picture with `across` pixels along its longer side."""
    u, v, pixels = pixel_grid(calibration.camera.size, across)
    return RaySigma(u, v, ray_sigma(calibration, pixels), ray_sigma(calibration, pixels, relative=False))


def _ray_by_value(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Derivative (..., 3, P) of the unit rays of fixed pixels by the camera's values; NaN outside."""
    rays = camera.unproject(pixels)
    seen = np.asarray(np.isfinite(rays).all(axis=-1))
    inside = np.where(seen[..., None], rays, [0.0, 0.0, 1.0])
    _, by_ray, by_value = camera.project_with_jacobians(inside)
    plane = _tangent_plane(inside)
    moved: FloatArray = -plane @ np.linalg.solve(by_ray @ plane, by_value)
    return np.where(seen[..., None, None], moved, np.nan)


def _tangent_plane(rays: FloatArray) -> FloatArray:
    """Two unit vectors (..., 3, 2) at right angles to each other and to unit rays (..., 3)."""
    away = np.where(np.abs(rays[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(rays, away)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(rays, first)], -1)


def _common_rotation(calibration: Calibration) -> FloatArray:
    """The small rotation (3, P) that a change of each camera value turns all rays by, in the least-squares sense.

    Minimises the sum of w |d_k - omega x ray_k|^2:  sum w (1 - ray ray^T) omega = sum w ray_k x d_k.
    """
    camera = calibration.camera
    pixels = pixel_grid(camera.size, _GRID)[2].reshape(-1, 2)
    rays = camera.unproject(pixels)
    observed = rays[:, 2] >= math.cos(math.radians(calibration.observed_theta_deg[1]))  # false for NaN
    rays, pixels = rays[observed], pixels[observed]
    weights = solid_angles(camera, rays)
    moved = _ray_by_value(camera, pixels)
    system = np.sum(weights) * np.eye(3) - np.einsum("n,ni,nj->ij", weights, rays, rays)
    torque = np.einsum("n,nip->ip", weights, np.cross(rays[:, None, :], moved.swapaxes(1, 2)).swapaxes(1, 2))
    rotation: FloatArray = np.linalg.solve(system, torque)
    return rotation
