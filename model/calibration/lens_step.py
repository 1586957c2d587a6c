"""The best lens, centre and aspect by rows in which the lens appears as its curve only.

The pixels depend on the lens values through r(theta) alone, and on r(theta) linearly.  A linearisation of the points in
the curve (odd Chebyshev polynomials), centre, aspect and poses, reduced to a dozen rows, therefore stays good while the
lens values travel far; following them there costs nothing beside another pass over the points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration import reduction
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError
from fullsphere.model.lens import FloatArray

FRAME = 3
"""Centre u, centre v, aspect: the camera's values after the lens's."""

_TERMS = 8  # T1 to T15: a real curve to 1e-6 px
_STEPS = 100
_FIRST_DAMPING, _LEAST_DAMPING = 1e-6, 1e-24  # of squared columns: 1e-24 frees condition 1e12

_ODD = 2 * np.arange(_TERMS) + 1
_NODES = np.cos(math.pi / 2 * (np.arange(2 * _TERMS) + 0.5) / (2 * _TERMS))  # in (0, 1), where the T are well apart


def odd_polynomials(t: FloatArray) -> FloatArray:
    """T1, T3, ..., T15 at t (n,) in [0, 1]: (n, 8)."""
    values: FloatArray = np.cos(_ODD * np.arccos(t)[:, None])
    return values


_FROM_NODES = np.linalg.pinv(odd_polynomials(_NODES))


def best_camera(
    camera: Camera, columns: NDArray[np.intp], small: FloatArray, little: float
) -> tuple[Camera, FloatArray]:
    """Levenberg-Marquardt over the free values of a camera, from that camera.

    Parameters
    ----------
    camera
        The camera at which the rows were linearised, its `half_fov` the angle at which the polynomials reach t = 1.
    columns
        Those of `camera.values` that are free.
    small
        (S + 1, S + 1) rows over [curve | centre, aspect | others | residual]; others are linear unknowns that are no
        values of the camera.
    little
        The search ends with no more than this to gain in the squared rows.

    Returns
    -------
    The best camera, and the step (S,) of curve, centre, aspect and others.
    """
    others = small.shape[1] - 1 - _TERMS - FRAME
    at = _Trial.of(camera, camera, small, np.zeros(others))
    columns = np.concatenate([columns, camera.values.size + np.arange(others)])
    damping, lift, scale = _FIRST_DAMPING, 2.0, np.zeros(columns.size)
    for _ in range(_STEPS if columns.size else 0):
        slopes = at.slopes[:, columns]
        scale = np.maximum(scale, np.sqrt(np.sum(slopes**2, 0)))
        ballast = np.diag(math.sqrt(damping) * np.where(scale > 0, scale, 1.0))
        upper = reduction.triangle(
            np.concatenate([np.column_stack([slopes, at.residuals]), np.pad(ballast, ((0, 0), (0, 1)))])
        )
        step = np.asarray(np.linalg.solve(upper[:-1, :-1], -upper[:-1, -1]), np.float64)
        change = slopes @ step
        promise = -float(np.sum(change * (change + 2 * at.residuals)))
        if promise <= little:
            break
        trial = _moved(at, columns, step, camera, small)
        if trial is None or not trial.cost < at.cost:
            damping, lift = damping * lift, lift * 2
            continue
        trust = 2 * (at.cost - trial.cost) / promise - 1
        damping, lift = max(damping * max(1 / 5, 1 - trust**3), _LEAST_DAMPING), 2.0
        at = trial
    return at.camera, at.step


class _Trial(NamedTuple):
    """A camera tried on the reduced rows: its step from the present one, the rows' residuals, and their slopes."""

    camera: Camera
    step: FloatArray  # (S,)
    residuals: FloatArray  # (S + 1,)
    slopes: FloatArray  # (S + 1, P + others)

    @property
    def cost(self) -> float:
        return float(np.sum(self.residuals**2))

    @classmethod
    def of(cls, camera: Camera, present: Camera, small: FloatArray, others: FloatArray) -> _Trial:
        nodes = _NODES * present.half_fov
        curve = _FROM_NODES @ (camera.lens.radius(nodes) - present.lens.radius(nodes))
        step = np.concatenate([curve, camera.values[-FRAME:] - present.values[-FRAME:], others])
        by_curve = small[:, :_TERMS] @ (_FROM_NODES @ camera.lens.radius_by_parameter(nodes))
        slopes = np.concatenate([by_curve, small[:, _TERMS:-1]], 1)
        residuals = small[:, :-1] @ step + small[:, -1]
        return cls(camera, step, residuals, slopes)


def _moved(
    at: _Trial, columns: NDArray[np.intp], step: FloatArray, present: Camera, small: FloatArray
) -> _Trial | None:
    """The trial a step further; None where the values are no camera."""
    count, values = at.camera.values.size, np.concatenate([at.camera.values, at.step[_TERMS + FRAME :]])
    values[columns] += step
    try:
        return _Trial.of(at.camera.with_values(values[:count]), present, small, values[count:])
    except CameraError:
        return None
