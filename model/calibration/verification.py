"""The paper's verification (section 6): fitted to one half of the points, judged by the other."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fullsphere.model.calibration.bow import bow_shapes
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.influence import influence
from fullsphere.model.calibration.observed import reaching
from fullsphere.model.calibration.points import Sightings, View
from fullsphere.model.calibration.solve import solve
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray

_BINS, _POINTS_PER_BIN = 10, 3  # fewer bins where there would be fewer points in each
_FEWEST = 6  # points of a view that fix its pose, on any target


@dataclasses.dataclass(frozen=True, eq=False)
class ChiSquare:
    """Normalised squared residuals against the chi-square distribution with 2 degrees of freedom (Figure 11b).

    Attributes
    ----------
    values
        (n,) squared residuals of the verification half, each measured by the covariance that noise and the fit's own
        uncertainty give it there; (du^2 + dv^2)/sigma^2, as the paper has it, where there are many points.
    edges
        (B + 1,) of B bins that chance fills alike, -2 ln(1 - j/B); the last is infinite.  Ten bins, fewer where that
        would leave less than three points to each.
    counts
        (B,) points in each bin; `expected` (one number) is what chance gives each.
    statistic, freedom, p_value
        Pearson's statistic, less what the uncertainty of sigma adds to it; its degrees of freedom; and the
        probability of so large a one by chance.
    """

    values: FloatArray
    edges: FloatArray
    counts: NDArray[np.intp]
    expected: float
    statistic: float
    freedom: int
    p_value: float


@dataclasses.dataclass(frozen=True, eq=False)
class Verification:
    """What a fit to one half of the points says about both halves.

    Attributes
    ----------
    fit_points, verify_points
        Number of points in each half.
    fit_rms_px, verify_rms_px
        sqrt(mean(du^2 + dv^2)) on each half.
    expected_fit_rms_px, expected_verify_rms_px
        The same for independent noise of the size that the fit to all points found: smaller where the fit adapts to
        the noise, larger on points it never saw.
    sigma_px
        Standard deviation of a coordinate by the fit half.
    chi_square
        The test of the verification half's residuals.
    """

    fit_points: int
    verify_points: int
    fit_rms_px: float
    verify_rms_px: float
    expected_fit_rms_px: float
    expected_verify_rms_px: float
    sigma_px: float
    chi_square: ChiSquare

    @property
    def ratio(self) -> float:
        """Rms of the verification half over that of the fit half."""
        return self.verify_rms_px / self.fit_rms_px


def verify(calibration: Calibration, seed: int = 0) -> Verification:
    """Fit the calibration's lens to a random half of the points of each view and judge it by the other half.

    As in the paper the halves are of points, so that lens and poses are judged together.  Rejected points take no
    part; a view with too few points for two halves is fitted whole.

    Raises
    ------
    GeometryError
        If half of the points do not determine the camera.
    """
    used = [_used(view, chosen) for view, chosen in zip(calibration.views, calibration.used, strict=True)]
    fitted = _halves([len(view.pixels) for view in used], seed)
    if all(half.all() for half in fitted):
        raise GeometryError(f"verification: no view has {2 * _FEWEST} points, which two halves need")
    half = Sightings.of(_used(view, chosen) for view, chosen in zip(used, fitted, strict=True))
    whole, in_half = Sightings.of(used), np.concatenate(fitted)
    shapes = np.zeros((whole.count, 0)) if calibration.bow_mm is None else bow_shapes(whole.points)
    solution = solve(half, calibration.camera, calibration.poses, shapes=shapes[in_half])

    bending = solution.poses.camera_from_target[whole.view][:, :, 2:] * shapes[:, None, :]
    rays = whole.rays(solution.poses) + bending @ solution.bow
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    try:
        camera = reaching(solution.camera, theta)
    except CameraError as error:
        raise GeometryError(f"verification: fitted to half of the points the lens ends too soon ({error})") from error
    residuals = camera.project(rays) - whole.pixels
    spread = influence(camera, rays, whole.view, in_half, bending).prediction

    unknowns = 6 * len(used) + len(camera.values) + bending.shape[-1]
    freedom = 2 * half.count - unknowns
    sigma = math.sqrt(float(np.sum(residuals[in_half] ** 2)) / freedom)
    other = ~in_half
    covariance = sigma**2 * (np.eye(2) + spread[other])
    normalised = np.einsum("ni,nij,nj->n", residuals[other], np.linalg.inv(covariance), residuals[other])
    return Verification(
        half.count,
        int(other.sum()),
        _rms(residuals[in_half]),
        _rms(residuals[other]),
        calibration.sigma_px * math.sqrt(freedom / half.count),
        calibration.sigma_px * math.sqrt(2 + float(np.mean(np.trace(spread[other], axis1=1, axis2=2)))),
        sigma,
        chi_square(normalised, freedom),
    )


def chi_square(values: FloatArray, freedom: int) -> ChiSquare:
    """Pearson's test that values (n,) are chi-square with 2 degrees of freedom, measured by an estimated variance.

    Were sigma known, the B counts would have the covariance n (diag(1/B) - 1/B^2).  A sigma estimated from
    `freedom` other residuals moves all of them along g = d(expected)/d(ln sigma^2), by a standard deviation of
    sqrt(2/freedom); the statistic is taken in the sum of both, and so keeps its B - 1 degrees of freedom.
    """
    count = len(values)
    bins = min(_BINS, max(3, count // _POINTS_PER_BIN))
    expected, tails = count / bins, 1 - np.arange(bins + 1) / bins
    with np.errstate(divide="ignore"):
        edges = 0.0 - 2 * np.log(tails)
    counts = np.bincount(np.minimum(np.searchsorted(edges, values, side="right") - 1, bins - 1), minlength=bins)
    excess = counts - expected
    slope = np.pad(tails[1:-1] * edges[1:-1] / 2, 1)  # of the tail beyond each edge, by ln sigma^2
    moved = count * (slope[:-1] - slope[1:])
    plain, along, size = excess @ excess / expected, excess @ moved / expected, moved @ moved / expected
    statistic = float(plain - along**2 / (freedom / 2 + size))  # Sherman-Morrison
    return ChiSquare(values, edges, counts, expected, statistic, bins - 1, float(stats.chi2.sf(statistic, bins - 1)))


def _used(view: View, chosen: NDArray[np.bool_]) -> View:
    return View(view.image, view.points_on_target[chosen], view.pixels[chosen])


def _halves(counts: list[int], seed: int) -> list[NDArray[np.bool_]]:
    """Which points of each view are fitted: a random half, at least as many as fix a pose; all where that is most."""
    rng = np.random.default_rng(seed)
    chosen = []
    for count in counts:
        fitted = np.ones(count, bool)
        if count >= 2 * _FEWEST:
            fitted[rng.permutation(count)[: count // 2]] = False
        chosen.append(fitted)
    return chosen


def _rms(residuals: FloatArray) -> float:
    return math.sqrt(float(np.mean(np.sum(residuals**2, -1))))
