"""Lenses by one or two spheres before a pinhole: the unified camera and its descendants.

With s = sin(theta) and c = cos(theta) each is r = f s/D(theta), and D has a pole or r a summit where the field ends.
"""

from __future__ import annotations

import abc
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.radial import HALF_TURN, FloatArray, Lens, length, ratio


class _Unified(Lens):
    """r = f s/D, D = alpha d + (1 - alpha) c, d = sqrt(beta s^2 + c^2), for one sphere (beta = 1) or an ellipsoid."""

    f: float
    alpha: float

    @property
    @abc.abstractmethod
    def _beta(self) -> float: ...

    @property
    def theta_max(self) -> float:
        """The pole, where D = 0, for alpha <= 1/2, else the summit of r, where alpha c + (1 - alpha) d = 0."""
        nearer = max(self.alpha, 1 - self.alpha)
        tangent = math.sqrt(abs(2 * self.alpha - 1) / self._beta)
        return HALF_TURN - math.atan2(tangent, 1 - nearer)

    def _terms(self, theta: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        t = np.asarray(theta, float)
        s, c = np.sin(t), np.cos(t)
        d = np.sqrt(self._beta * s * s + c * c)
        return s, c, d, self.alpha * d + (1 - self.alpha) * c

    def radius(self, theta: ArrayLike) -> FloatArray:
        s, _, _, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):  # at the pole
            return self.f * s / denominator

    def slope(self, theta: ArrayLike) -> FloatArray:
        _, c, d, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.f * (1 - self.alpha + self.alpha * c / d) / denominator**2


@dataclasses.dataclass(frozen=True)
class UnifiedCamera(_Unified):
    """r = f sin(theta)/(alpha + (1 - alpha) cos(theta)): 0 < alpha < 1, at 1/2 stereographic to 180 degrees.

    Geyer & Daniilidis, "A unifying theory for central panoramic systems", ECCV 2000; Mei & Rives, ICRA 2007, write
    xi = alpha/(1 - alpha) and multiply f by 1 + xi.  This form is that of Usenko et al., 3DV 2018.
    """

    f: float
    alpha: float
    projection = "ucm"
    parameters = (length("f"), ratio("alpha", upper=1.0))

    @property
    def _beta(self) -> float:
        return 1.0

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        s, c, _, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([s / denominator, -self.f * s * (1 - c) / denominator**2], -1)


@dataclasses.dataclass(frozen=True)
class EnhancedUnifiedCamera(_Unified):
    """r = f sin(theta)/(alpha d + (1 - alpha) cos(theta)), d = sqrt(beta sin^2(theta) + cos^2(theta)), 0 < alpha < 1.

    Khomutenko, Garcia & Martinet, "An enhanced unified camera model", IEEE RA-L 2016.
    """

    f: float
    alpha: float
    beta: float
    projection = "eucm"
    parameters = (length("f"), ratio("alpha", upper=1.0), ratio("beta"))

    @property
    def _beta(self) -> float:
        return self.beta

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        s, c, d, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_denominator = -self.f * s / denominator**2
            return np.stack(
                [s / denominator, by_denominator * (d - c), by_denominator * self.alpha * s * s / (2 * d)], -1
            )


@dataclasses.dataclass(frozen=True)
class DoubleSphere(Lens):
    """r = f sin(theta)/(alpha d + (1 - alpha) z), z = xi + cos(theta), d = sqrt(sin^2(theta) + z^2), 0 < alpha < 1.

    Usenko, Demmel & Cremers, "The double sphere camera model", 3DV 2018; -1 < xi < 1.
    """

    f: float
    xi: float
    alpha: float
    projection = "double-sphere"
    parameters = (length("f"), ratio("xi", -1.0, 1.0), ratio("alpha", upper=1.0))

    @property
    def theta_max(self) -> float:
        """Where the second sphere sees its pole (alpha <= 1/2) or summit: at psi with cos(psi) = -w.

        theta = psi + arcsin(xi sin(psi)), from tan(psi) = s/(xi + c).  The article's bound
        cos(theta) = -(w + xi)/sqrt(2 w xi + xi^2 + 1) is another angle unless xi = 0 or w = 1, some degrees short of
        this one or beyond it.
        """
        larger = max(self.alpha, 1 - self.alpha)
        psi = math.acos(-(1 - larger) / larger)
        return min(psi + math.asin(self.xi * math.sin(psi)), HALF_TURN)

    def _terms(self, theta: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        t = np.asarray(theta, float)
        s, z = np.sin(t), self.xi + np.cos(t)
        d = np.hypot(s, z)
        return s, z, d, self.alpha * d + (1 - self.alpha) * z

    def radius(self, theta: ArrayLike) -> FloatArray:
        s, _, _, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):  # at the pole
            return self.f * s / denominator

    def slope(self, theta: ArrayLike) -> FloatArray:
        _, z, d, denominator = self._terms(theta)
        turn = 1 + self.xi * (z - self.xi)
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.f * turn * (1 - self.alpha + self.alpha * z / d) / denominator**2

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        s, z, d, denominator = self._terms(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_denominator = -self.f * s / denominator**2
            by_xi = by_denominator * (1 - self.alpha + self.alpha * z / d)
            return np.stack([s / denominator, by_xi, by_denominator * (d - z)], -1)
