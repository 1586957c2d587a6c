"""What the choice of a lens formula adds to an uncertainty.

A covariance tells what errors of matches do under one formula.  Where matches do not reach, the formula alone fixes
the curve, and another that fits them as well fixes it elsewhere; where they do, a formula that cannot follow the true
curve bends the orientations.  Both show in the difference between two fits.  It is added to the first one's variance
in proportion to how likely the second is beside it, exp(-(difference of the robust cost) / (2 variance)) (Akaike
weights and variance between models: Burnham & Anderson 2002, sections 2.9 and 4.3).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.adjust import spread_px
from fullsphere.mosaic.solution import Solution

_ANGLES = 60  # at which curves are compared


def gain(one: Solution, other: Solution) -> float:
    """How much better the other solution fits the same matches, in variances of a keypoint's coordinate.

    Robust costs are compared, with the scale of the first one's spread.
    """
    residuals = [np.concatenate(solution.adjustment.residuals_px) for solution in (one, other)]
    variance = max(spread_px(residuals[0]) ** 2, 1e-12)
    first, second = (float(np.log1p(r**2 / variance).sum()) for r in residuals)
    return first - second


def with_lens_spread(one: Solution, other: Solution) -> Solution:
    """The first solution, its uncertainty such that it covers another one of the same frames with another lens."""
    share = math.exp(min(gain(one, other), 0.0) / 2)
    adjusted, group = one.adjustment, one.group
    sigma = adjusted.sigma.copy()
    world = np.swapaxes(adjusted.rotations[group], 1, 2) @ other.adjustment.rotations[group]
    turns = Rotation.from_matrix(world)
    off = (turns.mean().inv() * turns).magnitude()
    sigma[group] = np.sqrt(sigma[group] ** 2 + share * off**2)
    covariances = tuple(
        covariance + share * _between(camera, another) if covariance.any() else covariance
        for covariance, camera, another in zip(
            adjusted.covariances, adjusted.cameras, other.adjustment.cameras, strict=True
        )
    )
    return one._replace(adjustment=adjusted._replace(sigma=sigma, covariances=covariances))


def _between(camera: Camera, other: Camera) -> FloatArray:
    """Covariance (P, P) of a camera's values that makes another camera, of another lens, one standard deviation off.

    Of the difference of the curves, what the camera's own formula can follow is one direction of its values; what it
    cannot is shared out evenly among all curves that it can take, so that the variance is right on the whole.
    """
    theta = np.linspace(0, min(camera.half_fov, other.half_fov), _ANGLES + 1)[1:]
    own = len(camera.lens.values)
    apart = np.asarray(other.lens.radius(theta)) - camera.lens.radius(theta)
    by_value = np.asarray(camera.lens.radius_by_parameter(theta)).reshape(len(theta), own)
    scale = 1 / np.maximum(np.linalg.norm(by_value, axis=0), 1e-300)
    left, strength, right = np.linalg.svd(by_value * scale, full_matrices=False)
    good = strength > 1e-9 * strength[0]
    into_values = scale[:, None] * right[good].T / strength[good]  # of curves that are orthonormal over theta
    step = np.concatenate([into_values @ (left[:, good].T @ apart), other.values[-3:] - camera.values[-3:]])
    covariance = np.outer(step, step)
    rest = float(np.sum((apart - left[:, good] @ (left[:, good].T @ apart)) ** 2))
    covariance[:own, :own] += rest / int(good.sum()) * into_values @ into_values.T
    return covariance
