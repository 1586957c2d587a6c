"""Whether residuals hold anything systematic: their radial and tangential parts against theta and phi.

A fit absorbs part of the noise, and what it leaves in a bin is smaller than the plain standard error.  The exact
covariance of the means (see `influence`) is used, so that the p-values are right for small sets too.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.influence import Influence, influence
from fullsphere.model.calibration.observed import Observed, observed, reaching
from fullsphere.model.lens import FloatArray

_POINTS_PER_BIN = 12  # at least, on average; with more points there are more bins
_THETA_BINS, _PHI_BINS = 18, 12  # at most
_FEWEST = 0.25  # of the average: a bin with fewer points joins its neighbour
_ABSORBED = 1e-6  # of the largest variance: what the fit took up altogether
_PARTS = ("radial", "tangential")


@dataclasses.dataclass(frozen=True, eq=False)
class Bins:
    """Means over bins of an angle, B of them.

    `edges_deg` (B, 2), `centre_deg` (B,) the mean angle of the bin's points, `count` (B,), `mean_px` (B,), and
    `error_px` (B,) the standard deviation that chance alone gives the mean, what the fit absorbed counted.
    """

    edges_deg: FloatArray
    centre_deg: FloatArray
    count: NDArray[np.intp]
    mean_px: FloatArray
    error_px: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Trend:
    """One part of the residual (predicted minus observed) against one angle.

    Attributes
    ----------
    part, against
        "radial" or "tangential"; "theta" or "phi".
    bins
        Means and their errors.
    p_value
        Probability that chance alone gives bin means so large together.
    largest_px, at_deg
        The bin mean of largest size (with its sign), and where.
    """

    part: str
    against: str
    bins: Bins
    p_value: float
    largest_px: float
    at_deg: float


class Harmonic(NamedTuple):
    """cos_px cos(n phi) + sin_px sin(n phi) in one part of the residual; `error_px` of either, and a p-value."""

    part: str
    order: int
    cos_px: float
    sin_px: float
    error_px: float
    p_value: float

    @property
    def amplitude_px(self) -> float:
        """Size of the wave."""
        return float(np.hypot(self.cos_px, self.sin_px))


def trends(calibration: Calibration) -> tuple[tuple[Trend, ...], tuple[Harmonic, ...]]:
    """Radial and tangential residual against theta, both against phi; and their first two waves round the axis."""
    points, fit = _fit(calibration)
    found = [
        _trend(points, fit, calibration.sigma_px, part, against) for against in ("theta", "phi") for part in _PARTS
    ]
    waves = [wave for part in _PARTS for wave in _harmonics(points, fit, calibration.sigma_px, part)]
    return tuple(found), tuple(waves)


def radial_trend(calibration: Calibration) -> Trend:
    """The radial residual against theta: what the lens's formula cannot follow."""
    return _trend(*_fit(calibration), calibration.sigma_px, "radial", "theta")


def _fit(calibration: Calibration) -> tuple[Observed, Influence]:
    points = observed(calibration)
    camera, every = reaching(calibration.camera, points.theta), np.ones(len(points.theta), bool)
    return points, influence(camera, points.rays, points.view, every, points.bow)


def _trend(points: Observed, fit: Influence, sigma: float, part: str, against: str) -> Trend:
    if against == "theta":
        angle = np.degrees(points.theta)
        low, high, most = float(angle.min()), float(angle.max()), _THETA_BINS
    else:
        angle = np.degrees(points.phi)
        low, high, most = -180.0, 180.0, _PHI_BINS
    edges = _edges(angle, np.linspace(low, high, min(most, max(3, len(angle) // _POINTS_PER_BIN)) + 1))
    place = np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, len(edges) - 2)
    inside = place == np.arange(len(edges) - 1)[:, None]
    count = inside.sum(1)
    share = inside / count[:, None]
    weights = share[:, :, None] * _direction(points, part)
    mean = np.einsum("bnc,nc->b", weights, points.residuals)
    covariance = sigma**2 * fit.left_after_fit(weights)
    bins = Bins(
        np.stack([edges[:-1], edges[1:]], -1),
        share @ angle,
        count,
        mean,
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
    )
    largest = int(np.argmax(np.abs(mean)))
    return Trend(part, against, bins, _p_value(mean, covariance), float(mean[largest]), float(bins.centre_deg[largest]))


def _harmonics(points: Observed, fit: Influence, sigma: float, part: str) -> list[Harmonic]:
    """Least squares of one part on 1, cos phi, sin phi, cos 2 phi, sin 2 phi."""
    phi = points.phi
    waves = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)])
    weights = (np.linalg.pinv(waves @ waves.T) @ waves)[:, :, None] * _direction(points, part)
    values = np.einsum("bnc,nc->b", weights, points.residuals)
    covariance = sigma**2 * fit.left_after_fit(weights)
    found = []
    for order in (1, 2):
        pair = slice(2 * order - 1, 2 * order + 1)
        error = float(np.sqrt(max(np.trace(covariance[pair, pair]) / 2, 0.0)))
        cos, sin = values[pair].tolist()
        found.append(Harmonic(part, order, cos, sin, error, _p_value(values[pair], covariance[pair, pair])))
    return found


def _direction(points: Observed, part: str) -> FloatArray:
    return points.outward if part == "radial" else points.across


def _edges(angle: FloatArray, edges: FloatArray) -> FloatArray:
    """The edges without those that leave a bin nearly empty."""
    least = _FEWEST * len(angle) / (len(edges) - 1)
    kept = [float(edges[0])]
    for edge in edges[1:-1]:
        if np.sum((angle >= kept[-1]) & (angle < edge)) >= least:
            kept.append(float(edge))
    while len(kept) > 1 and np.sum(angle >= kept[-1]) < least:
        kept.pop()
    return np.array([*kept, float(edges[-1])])


def _p_value(values: FloatArray, covariance: FloatArray) -> float:
    """Chi-square probability of values so large, in the directions that the fit left any noise in."""
    variance, axes = np.linalg.eigh(covariance)
    left = variance > _ABSORBED * max(float(variance[-1]), 0.0)
    if not left.any():
        return 1.0
    statistic = float(np.sum((axes.T @ values)[left] ** 2 / variance[left]))
    return float(stats.chi2.sf(statistic, int(left.sum())))
