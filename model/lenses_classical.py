"""Lenses by a tangent or a sine of the angle: the classical projections, and those of Bakstein & Pajdla.

The formulas are those of sections 3 and 4 of Bakstein & Pajdla, "Calibration of a fish eye lens with field of view
larger than 180", CVWW 2002; `BaksteinPajdla` is their equation 3.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.radial import HALF_TURN, RIGHT_ANGLE, FloatArray, Lens, length, ratio

_THOBY_LENGTH, _THOBY_ANGLE = 1.47, 0.713


@dataclasses.dataclass(frozen=True)
class _OneLength(Lens):
    """r = f h(theta): the classical projections, which differ in h only."""

    f: float
    parameters = (length("f"),)

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        return (self.radius(theta) / self.f)[..., None]


@dataclasses.dataclass(frozen=True)
class Perspective(_OneLength):
    """r = f tan(theta), theta < 90 degrees: straight lines stay straight."""

    projection = "perspective"
    theta_max = RIGHT_ANGLE

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.tan(theta)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f / np.cos(theta) ** 2


@dataclasses.dataclass(frozen=True)
class Stereographic(_OneLength):
    """r = 2 f tan(theta/2), theta < 180 degrees: angles between curves are kept."""

    projection = "stereographic"
    theta_max = HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return 2 * self.f * np.tan(np.asarray(theta) / 2)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f / np.cos(np.asarray(theta) / 2) ** 2


@dataclasses.dataclass(frozen=True)
class Equidistant(_OneLength):
    """r = f theta, to 180 degrees."""

    projection = "equidistant"
    theta_max = HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.asarray(theta, float)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return np.full(np.shape(theta), self.f)


@dataclasses.dataclass(frozen=True)
class Equisolid(_OneLength):
    """r = 2 f sin(theta/2), to 180 degrees: areas are kept."""

    projection = "equisolid"
    theta_max = HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return 2 * self.f * np.sin(np.asarray(theta) / 2)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.cos(np.asarray(theta) / 2)


@dataclasses.dataclass(frozen=True)
class Orthographic(_OneLength):
    """r = f sin(theta), the paper's sine law, to 90 degrees, where it folds back."""

    projection = "orthographic"
    theta_max = RIGHT_ANGLE

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.sin(theta)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.cos(theta)


@dataclasses.dataclass(frozen=True)
class Thoby(_OneLength):
    """r = 1.47 f sin(0.713 theta), to 126 degrees: M. Thoby's measurement of the Nikkor 10.5 mm, as in PanoTools."""

    projection = "thoby"
    theta_max = RIGHT_ANGLE / _THOBY_ANGLE

    def radius(self, theta: ArrayLike) -> FloatArray:
        return _THOBY_LENGTH * self.f * np.sin(_THOBY_ANGLE * np.asarray(theta))

    def slope(self, theta: ArrayLike) -> FloatArray:
        return _THOBY_LENGTH * _THOBY_ANGLE * self.f * np.cos(_THOBY_ANGLE * np.asarray(theta))


@dataclasses.dataclass(frozen=True)
class ScaledStereographic(Lens):
    """r = a tan(theta/b), theta < 90 b degrees: the paper's first model of the FC-E8."""

    a: float
    b: float
    projection = "scaled-stereographic"
    parameters = (length("a"), ratio("b"))

    @property
    def theta_max(self) -> float:
        return min(self.b * RIGHT_ANGLE, HALF_TURN)

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.a * np.tan(np.asarray(theta) / self.b)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.a / self.b / np.cos(np.asarray(theta) / self.b) ** 2

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float) / self.b
        return np.stack([np.tan(t), -self.a / self.b * t / np.cos(t) ** 2], -1)


@dataclasses.dataclass(frozen=True)
class BaksteinPajdla(Lens):
    """r = a tan(theta/b) + c sin(theta/d): equation 3 of the paper, for lenses beyond 180 degrees.

    The four values are nearly interchangeable (many sets give the same curve): compare curves, never values.
    """

    a: float
    b: float
    c: float
    d: float
    projection = "bakstein-pajdla"
    parameters = (length("a", -1e7), ratio("b"), length("c", -1e7), ratio("d"))

    @cached_property
    def theta_max(self) -> float:
        """The first angle at which dr/dtheta is no longer positive, or the pole of the tangent, or pi."""
        limit = min(self.b * RIGHT_ANGLE, HALF_TURN)
        theta = np.linspace(0.0, limit, 2049)  # the limit too: before a pole of a < 0 the fall is short and steep
        falls = np.flatnonzero(~(self.slope(theta) > 0))
        if falls.size == 0:
            return limit
        low, high = float(theta[max(falls[0] - 1, 0)]), float(theta[falls[0]])
        for _ in range(60):  # bisection: the slope's sign changes once between two neighbouring samples
            middle = (low + high) / 2
            low, high = (middle, high) if self.slope(middle) > 0 else (low, middle)
        return low

    def radius(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        return self.a * np.tan(t / self.b) + self.c * np.sin(t / self.d)

    def slope(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        return self.a / self.b / np.cos(t / self.b) ** 2 + self.c / self.d * np.cos(t / self.d)

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        p, q = np.asarray(theta, float) / self.b, np.asarray(theta, float) / self.d
        return np.stack(
            [np.tan(p), -self.a / self.b * p / np.cos(p) ** 2, np.sin(q), -self.c / self.d * q * np.cos(q)], -1
        )
