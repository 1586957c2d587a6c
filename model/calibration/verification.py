"""The paper's verification: fitted to one half of the points, judged by the other."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class ChiSquare:
    """Normalised squared residuals against the chi-square distribution with 2 degrees of freedom (Figure 11b).

    Attributes
    ----------
    values
        (n,) normalised squared residuals of the verification half.
    edges
        (11,) of ten bins that chance fills alike; the last is infinite.
    counts
        (10,) points in each bin; `expected` (one number) is what chance gives each.
    statistic, freedom, p_value
        Pearson's statistic, its degrees of freedom, and the probability of so large a one by chance.
    ks_p_value
        The same by the Kolmogorov-Smirnov test, which needs no bins.
    """

    values: FloatArray
    edges: FloatArray
    counts: NDArray[np.intp]
    expected: float
    statistic: float
    freedom: int
    p_value: float
    ks_p_value: float


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
        The same for independent noise of the fit's sigma: smaller than sqrt(2) sigma where the fit adapts to the
        noise, larger on points it never saw.
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
