"""Everything that can be said about how good a calibration is, from its residuals and one fit to half of the points."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.coverage import Coverage, coverage
from fullsphere.model.calibration.observability import Weakest, weakest
from fullsphere.model.calibration.observed import observed, reaching
from fullsphere.model.calibration.ray_errors import RaySigma, ray_sigma_map
from fullsphere.model.calibration.trends import Harmonic, Trend, trends
from fullsphere.model.calibration.verification import Verification, verify
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray

_WORSE = 1.1  # times the expected rms of points not fitted, that is worth a sentence
_CHANCE = 1e-3  # a probability that is no chance any more
_NOTICEABLE = 0.25  # of the standard deviation of a coordinate: a systematic part worth a sentence
_LOOSE = 50.0  # times less visible together than one by one: unknowns that trade against each other
_ODD_VIEW = 2.0  # times the rms of all views


@dataclasses.dataclass(frozen=True, eq=False)
class PointErrors:
    """Errors by distinct point of the target (M of them), over the views that used it (Figures 9b and 11a).

    `points` (M, 3) in the target's unit, `count` (M,) of views, `rms_px` (M,), `mean_px` (M, 2) predicted minus
    observed.
    """

    points: FloatArray
    count: NDArray[np.intp]
    rms_px: FloatArray
    mean_px: FloatArray


class ViewErrors(NamedTuple):
    """Errors of one view: points used and rejected, their rms, and the worst point used with its pixel."""

    image: str
    used: int
    rejected: int
    rms_px: float
    worst_px: float
    worst_at_px: tuple[float, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Assessment:
    """How good a calibration is.

    Attributes
    ----------
    calibration
        What was assessed.
    verification
        Half/half verification with its chi-square test; None where half of the points do not determine the camera,
        and `verification_missing` says why.
    trends
        Radial and tangential residual against theta, then both against phi.
    harmonics
        First and second waves of the radial, then of the tangential residual against phi.
    coverage
        Where points were seen.
    ray_sigma
        Standard deviation of ray directions over the picture.
    points, views
        Errors by point of the target and by view.
    weakest
        The combination of lens and poses that the points determine worst.
    flags
        What a reader should know before trusting the calibration, in whole sentences.
    """

    calibration: Calibration
    verification: Verification | None
    verification_missing: str
    trends: tuple[Trend, ...]
    harmonics: tuple[Harmonic, ...]
    coverage: Coverage
    ray_sigma: RaySigma
    points: PointErrors
    views: tuple[ViewErrors, ...]
    weakest: Weakest
    flags: tuple[str, ...]


def assess(calibration: Calibration) -> Assessment:
    """Assess a calibration by its own points: verification, trends, coverage, uncertainty, errors by point and view."""
    missing, verification = "", None
    try:
        verification = verify(calibration)
    except GeometryError as error:
        missing = str(error)
    found, harmonics = trends(calibration)
    covered, points = coverage(calibration), observed(calibration)
    loose = weakest(reaching(calibration.camera, points.theta), points.rays, points.view)
    return Assessment(
        calibration,
        verification,
        missing,
        found,
        harmonics,
        covered,
        ray_sigma_map(calibration),
        point_errors(calibration),
        view_errors(calibration),
        loose,
        (*covered.flags, *_flags(calibration, verification, missing, found, loose)),
    )


def point_errors(calibration: Calibration) -> PointErrors:
    """Errors by distinct point of the target, in the order of its coordinates (z, y, x)."""
    used = np.concatenate(calibration.used)
    marks = np.concatenate([view.points_on_target for view in calibration.views])[used]
    residuals = np.concatenate(calibration.residuals_px)[used]
    points, place = np.unique(marks[:, ::-1], axis=0, return_inverse=True)
    place = place.reshape(-1)
    count = np.bincount(place)
    mean = np.stack([np.bincount(place, component) for component in residuals.T], -1) / count[:, None]
    rms = np.sqrt(np.bincount(place, np.sum(residuals**2, -1)) / count)
    return PointErrors(points[:, ::-1], count, rms, mean)


def view_errors(calibration: Calibration) -> tuple[ViewErrors, ...]:
    """Errors of each view, in the order of the views."""
    rows = []
    for view, residuals, used in zip(calibration.views, calibration.residuals_px, calibration.used, strict=True):
        distance = np.where(used, np.hypot(*residuals.T), 0.0)
        worst = int(np.argmax(distance))
        count = int(np.count_nonzero(used))
        u, v = view.pixels[worst].tolist()
        rms = math.sqrt(float(np.sum(distance**2)) / count)
        rows.append(ViewErrors(view.image, count, len(used) - count, rms, float(distance[worst]), (u, v)))
    return tuple(rows)


def _flags(
    calibration: Calibration, verification: Verification | None, missing: str, found: tuple[Trend, ...], loose: Weakest
) -> list[str]:
    flags = [f"{loose.text[0].upper()}{loose.text[1:]}."] if loose.hidden > _LOOSE else []
    if verification is None:
        flags.append(f"Not verified on points of its own: {missing}.")
    elif verification.verify_rms_px > _WORSE * verification.expected_verify_rms_px:
        flags.append(
            f"Points that were not fitted are predicted to {verification.verify_rms_px:.3f} px rms, and "
            f"{verification.expected_verify_rms_px:.3f} px is what noise alone would give."
        )
    flags += [
        f"The {trend.part} residual follows {trend.against}: {trend.largest_px:+.3f} px on average round "
        f"{trend.at_deg:.0f} degrees, which noise does not explain (p = {trend.p_value:.1g})."
        for trend in found
        if trend.p_value < _CHANCE and abs(trend.largest_px) > _NOTICEABLE * calibration.sigma_px
    ]
    flags += [
        f"{view.image} fits worse than the others: {view.rms_px:.3f} px rms."
        for view in view_errors(calibration)
        if view.rms_px > _ODD_VIEW * calibration.rms_px
    ]
    return flags
