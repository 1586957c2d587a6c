"""Whether residuals hold anything systematic: their radial and tangential parts against theta and phi."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray


class Bins(NamedTuple):
    """Means over bins of an angle, B of them, those without points left out.

    `edges_deg` (B, 2), `centre_deg` (B,) the mean angle of the bin's points, `count` (B,), `mean_px` (B,), and
    `error_px` (B,) the standard deviation that chance alone gives the mean (what the fit absorbed counted).
    """

    edges_deg: FloatArray
    centre_deg: FloatArray
    count: NDArray[np.intp]
    mean_px: FloatArray
    error_px: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Trend:
    """One part of the residual against one angle.

    Attributes
    ----------
    part, against
        "radial" or "tangential"; "theta" or "phi".
    bins
        Means and their errors.
    p_value
        Probability that chance alone gives bin means so large together.
    largest_px, at_deg
        The largest bin mean (with its sign) among the well-filled bins, and where.
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
