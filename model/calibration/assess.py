"""Everything that can be said about how good a calibration is, from its residuals and one fit to half of the points."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.coverage import Coverage
from fullsphere.model.calibration.ray_errors import RaySigma
from fullsphere.model.calibration.trends import Harmonic, Trend
from fullsphere.model.calibration.verification import Verification
from fullsphere.model.lens import FloatArray


class PointErrors(NamedTuple):
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
    flags: tuple[str, ...]


def assess(calibration: Calibration) -> Assessment:
    """Assess a calibration: verification, trends, coverage, uncertainty, errors by point and by view."""
    raise NotImplementedError
