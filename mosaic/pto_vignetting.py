"""Vignetting by Hugin's polynomial in the radius, and by ours in the angle.

Hugin's lens passes Va + Vb q + Vc q^2 + Vd q^3 of the light, q the squared distance from the pixel (Vx, Vy) beside the
middle, in halves of the picture's diagonal.
"""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.pto_lens import PanoToolsLens

_DARKEST = 0.02  # of the light: less is no vignetting but the dark beyond the image circle


def vignetting_of(coefficients: tuple[float, float, float, float], lens: PanoToolsLens, half_fov: float) -> FloatArray:
    """(w1, w2) of 2^(w1 s + w2 s^2), s = (theta/half_fov)^2, nearest to (Va, Vb, Vc, Vd)."""
    theta, q = _samples(lens, half_fov)
    va, vb, vc, vd = coefficients
    if va <= 0:
        return np.zeros(2)
    passed = 1 + q * (vb + q * (vc + q * vd)) / va
    lit = passed > _DARKEST
    s = (theta[lit] / half_fov) ** 2
    return np.asarray(np.linalg.lstsq(np.stack([s, s * s], -1), np.log2(passed[lit]), rcond=None)[0]) + 0.0


def coefficients_of(vignetting_ev: tuple[float, float], camera: Camera, lens: PanoToolsLens) -> FloatArray:
    """(Vb, Vc, Vd) with Va = 1 nearest to 2^(w1 s + w2 s^2) of a camera."""
    theta, q = _samples(lens, camera.half_fov)
    s = (theta / camera.half_fov) ** 2
    passed = np.exp2(vignetting_ev[0] * s + vignetting_ev[1] * s * s)
    return np.asarray(np.linalg.lstsq(np.stack([q, q * q, q**3], -1), passed - 1, rcond=None)[0]) + 0.0


def _samples(lens: PanoToolsLens, half_fov: float) -> tuple[FloatArray, FloatArray]:
    """Angles within the field of view and the squared radii at which the lens images them."""
    theta = np.linspace(0.01, 1, 60) * min(half_fov, lens.theta_max)
    half_diagonal = math.hypot(*lens.size) / 2
    return theta, (lens.radius(theta) / half_diagonal) ** 2
