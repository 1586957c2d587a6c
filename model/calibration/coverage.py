"""Where in the field of view points were seen, and what is therefore extrapolated or cannot be known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.spatial import cKDTree

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.observed import Observed, observed
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_NEAR_DEG = 10.0  # a direction with a point so near is covered: curves of lenses do not bend within less
_DIRECTIONS = 4000
_MUCH_DEG = 2.0  # of the curve extrapolated, that is worth a sentence
_AXIS_DEG = 10.0  # without marks round the axis
_GAP_DEG = 25.0  # a hole worth a sentence
_ONE_DEPTH = 0.03  # spread of the distances along the axis at one angle, as a share, that fixes no place on the axis
_SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


@dataclasses.dataclass(frozen=True)
class Coverage:
    """How the observed points fill the field of view.

    Attributes
    ----------
    observed_theta_deg
        Smallest and largest angle from the axis at which a point was seen.
    half_fov_deg
        Half field of view of the camera.
    near_deg
        The angle within which a direction counts as covered.
    covered
        Share of the field's solid angle, as far as it is in the picture, with a point within `near_deg`.
    extrapolated
        Share of it beyond the largest observed angle.
    gap_deg, gap_theta_deg, gap_phi_deg
        Angle from the loneliest direction of the field to its nearest point, and that direction.
    views
        Number of views.
    flags
        What a reader should know, in whole sentences; empty where nothing is missing.
    """

    observed_theta_deg: tuple[float, float]
    half_fov_deg: float
    near_deg: float
    covered: float
    extrapolated: float
    gap_deg: float
    gap_theta_deg: float
    gap_phi_deg: float
    views: int
    flags: tuple[str, ...]


def coverage(calibration: Calibration) -> Coverage:
    """How the points used fill the field of view of the camera, and what they leave open."""
    points = observed(calibration)
    low, high = calibration.observed_theta_deg
    directions = _directions(calibration.camera)
    theta = np.degrees(np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2]))
    seen = points.rays / np.linalg.norm(points.rays, axis=1, keepdims=True)
    distance = np.degrees(2 * np.arcsin(np.minimum(cKDTree(seen).query(directions)[0] / 2, 1.0)))
    lonely = int(np.argmax(distance))
    found = Coverage(
        (low, high),
        math.degrees(calibration.camera.half_fov),
        _NEAR_DEG,
        float(np.mean(distance <= _NEAR_DEG)),
        float(np.mean(theta > high)),
        float(distance[lonely]),
        float(theta[lonely]),
        math.degrees(math.atan2(directions[lonely, 1], directions[lonely, 0])),
        len(calibration.views),
        (),
    )
    return dataclasses.replace(found, flags=tuple(_flags(found, points)))


def _directions(camera: Camera) -> FloatArray:
    """Unit vectors (n, 3) spread evenly (a Fibonacci spiral) over the field of view, as far as the picture shows it."""
    turn = np.arange(_DIRECTIONS) + 0.5
    z = 1 - turn / _DIRECTIONS * (1 - math.cos(camera.half_fov))
    across, phi = np.sqrt(1 - z**2), turn * math.pi * (3 - math.sqrt(5))
    rays = np.stack([across * np.cos(phi), across * np.sin(phi), z], -1)
    pixels = camera.project(rays)
    shown = np.all((pixels >= -0.5) & (pixels <= np.array(camera.size) - 0.5), axis=1)
    return np.asarray(rays[shown] if shown.any() else rays)


def _flags(found: Coverage, points: Observed) -> list[str]:
    low, high = found.observed_theta_deg
    flags = []
    if found.half_fov_deg > high + _MUCH_DEG and found.extrapolated > 0:
        flags.append(
            f"Points were observed up to {high:.1f} of {found.half_fov_deg:.1f} degrees from the axis: beyond, the "
            f"curve is extrapolated ({100 * found.extrapolated:.0f} % of the field of view)."
        )
    if low > _AXIS_DEG:
        flags.append(
            f"No point within {low:.0f} degrees of the axis: the scale there rests on the lens's formula alone."
        )
    if found.gap_deg > _GAP_DEG and not (low > _AXIS_DEG and found.gap_theta_deg < low):
        side = _SIDES[round(found.gap_phi_deg / 45) % 8]
        flags.append(
            f"A hole in the coverage: no point within {found.gap_deg:.0f} degrees of the direction "
            f"{found.gap_theta_deg:.0f} degrees from the axis towards the {side} of the picture."
        )
    if found.views == 1:
        flags.append(
            "One view of one near target: it cannot tell whether the entrance pupil moves with the angle from the "
            "axis. Directions are right for things as far away as the target; check those far away by another picture."
        )
        if _one_depth(points):
            flags.append(
                "Each angle was seen at one distance only: the target's place along the axis trades against the "
                "curve. Residuals do not show it; trust the stated uncertainty of the curve, or add a view from "
                "elsewhere."
            )
    return flags


def _one_depth(points: Observed) -> bool:
    """Whether points at like angles stand at like distances, so that a shift along the axis acts like a lens.

    A shift dz moves a point by sin(theta)/distance dz in theta; were distance a function of theta alone, no lens that
    is free enough could tell.  The spread of log distance about a smooth function of theta is what could.
    """
    theta = points.theta / points.theta.max()
    smooth = np.polynomial.chebyshev.chebvander(theta, min(6, max(1, len(theta) // 8)))
    distance = np.log(np.linalg.norm(points.rays, axis=1))
    left = distance - smooth @ np.linalg.lstsq(smooth, distance, rcond=None)[0]
    return bool(np.std(left) < _ONE_DEPTH)
