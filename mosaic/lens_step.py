"""A step of a lens's values that moves its curve, not only its values, as a linear fit asks.

Sets of values far apart give nearly the same curve (Bakstein-Pajdla's four, most of all), along a valley of the error
that is bent in the values and straight in the curve.  A step along the tangent leaves the valley's floor soon, and a
descent then goes down it in hundreds of short steps.  Here the step is taken in the curve, and the values follow:
the parameter effects' part of the curvature is gone (Bates & Watts, J. R. Statist. Soc. B 42, 1980, section 2).
"""

from __future__ import annotations

import numpy as np

from fullsphere.model.errors import CameraError
from fullsphere.model.lens import FloatArray, Lens

_ANGLES = 40
_STEPS = 12
_ENOUGH = 1e-4  # of the step's own length, both in the curve: nearer than this the values need not follow
_WITHIN = 0.999  # of the domain: near a pole the curve tells nothing


def lens_moved(lens: Lens, step: FloatArray, half_fov: float) -> FloatArray:
    """Values (P,) whose curve is nearest to the lens's own plus what `step` (P,) of its values adds to first order.

    Compared are angles up to `half_fov`.  Where no lens is nearer, the values are those of the plain step.
    """
    values = np.array(lens.values)
    plain: FloatArray = values + step
    if np.count_nonzero(step) < 2:  # one value has no valley to keep to
        return plain
    theta = np.linspace(0, min(half_fov, _WITHIN * lens.theta_max), _ANGLES + 1)[1:]
    by_value = lens.radius_by_parameter(theta)
    change = by_value @ step
    wanted = lens.radius(theta) + change
    enough = _ENOUGH * float(np.linalg.norm(change))
    free = step != 0
    best, damping, off = values, 1e-9, change
    for _ in range(_STEPS):
        columns = by_value[:, free]
        scale = 1 / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        left, strength, right = np.linalg.svd(columns * scale, full_matrices=False)
        towards = left.T @ off
        follow = scale * ((towards * strength / (strength**2 + damping)) @ right)
        tried = best.copy()
        tried[free] += follow
        moved = _with_values(lens, tried, theta[-1])
        left_over = None if moved is None else wanted - moved.radius(theta)
        if moved is None or left_over is None or not np.linalg.norm(left_over) < np.linalg.norm(off):
            damping *= 100
            if damping > 1:
                break
            continue
        gained = float(np.linalg.norm(off) - np.linalg.norm(left_over))
        best, off, damping = tried, left_over, max(damping / 10, 1e-12)
        by_value = moved.radius_by_parameter(theta)
        if gained < enough:
            break
    simple = _with_values(lens, plain, theta[-1])
    nearer = simple is None or np.linalg.norm(off) < np.linalg.norm(wanted - simple.radius(theta))
    return best if nearer else plain


def _with_values(lens: Lens, values: FloatArray, reaching: float) -> Lens | None:
    try:
        moved = lens.with_values(values)
    except CameraError:
        return None
    return moved if moved.theta_max > reaching else None
