"""Lenses by a polynomial: of the angle, of its tangent, or of the radius."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.radial import (
    HALF_TURN,
    RIGHT_ANGLE,
    FloatArray,
    Lens,
    coefficient,
    first_root,
    growing_inverse,
    length,
)

_FARTHEST = 1e4  # focal lengths from the centre: where a formula that grows without end is cut off


def _polynomial(x: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    """c0 + c1 x + c2 x^2 + ..."""
    return np.asarray(np.polynomial.polynomial.polyval(x, coefficients), np.float64)


def _odd(x: FloatArray, higher: Sequence[float]) -> FloatArray:
    """x + k1 x^3 + k2 x^5 + ..."""
    return x * _polynomial(x * x, [1.0, *higher])


def _odd_slope(x: FloatArray, higher: Sequence[float]) -> FloatArray:
    """1 + 3 k1 x^2 + 5 k2 x^4 + ..."""
    return _polynomial(x * x, [1.0, *_of_slope(higher)])


def _of_slope(higher: Sequence[float]) -> list[float]:
    return [(2 * n + 3) * k for n, k in enumerate(higher)]


@dataclasses.dataclass(frozen=True)
class KannalaBrandt(Lens):
    """r = f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9), as far as it grows.

    Kannala & Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye lenses",
    PAMI 2006, with f taken out as in OpenCV's fisheye module, whose k1 to k4 these are.
    """

    f: float
    k1: float
    k2: float
    k3: float
    k4: float
    projection = "kannala-brandt"
    parameters = (length("f"), *map(coefficient, ("k1", "k2", "k3", "k4")))

    @cached_property
    def theta_max(self) -> float:
        """The first angle at which dr/dtheta vanishes, or pi."""
        return min(math.sqrt(first_root(_of_slope(self.values[1:]))), HALF_TURN)

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * _odd(np.asarray(theta, float), self.values[1:])

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f * _odd_slope(np.asarray(theta, float), self.values[1:])

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        return np.stack([self.radius(t) / self.f, *(self.f * t**n for n in (3, 5, 7, 9))], -1)


@dataclasses.dataclass(frozen=True)
class Brown(Lens):
    """r = f (x + k1 x^3 + k2 x^5 + k3 x^7), x = tan(theta) < infinity, as far as it grows: ordinary lenses.

    The radial terms of Brown, "Close-range camera calibration", Photogrammetric Engineering 1971, in the form of
    OpenCV, whose k1, k2 and k3 these are.
    """

    f: float
    k1: float
    k2: float
    k3: float
    projection = "brown"
    parameters = (length("f"), *map(coefficient, ("k1", "k2", "k3")))

    @cached_property
    def theta_max(self) -> float:
        """The first angle at which dr/dtheta vanishes, or 90 degrees."""
        return min(math.atan(math.sqrt(first_root(_of_slope(self.values[1:])))), RIGHT_ANGLE)

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * _odd(np.tan(np.asarray(theta, float)), self.values[1:])

    def slope(self, theta: ArrayLike) -> FloatArray:
        x = np.tan(np.asarray(theta, float))
        return np.asarray(self.f * _odd_slope(x, self.values[1:]) * (1 + x * x))

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        x = np.tan(np.asarray(theta, float))
        return np.stack([_odd(x, self.values[1:]), *(self.f * x**n for n in (3, 5, 7))], -1)


@dataclasses.dataclass(frozen=True)
class Scaramuzza(Lens):
    """tan(theta) = r/w(r), w(r) = a0 + a2 r^2 + a3 r^3 + a4 r^4: the pixel's ray is (x', y', w), as far as theta grows.

    Scaramuzza, Martinelli & Siegwart, "A flexible technique for accurate omnidirectional camera calibration and
    structure from motion", ICVS 2006.  The signs are those of an axis that leaves the camera, a0 > 0;
    OCamCalib states all four with the other sign.  r(theta) has no formula: it is found from theta(r), and its
    derivatives are those of the implicit function.
    """

    a0: float
    a2: float
    a3: float
    a4: float
    projection = "scaramuzza"
    parameters = (length("a0"), coefficient("a2", -1), coefficient("a3", -2), coefficient("a4", -3))

    @cached_property
    def _shape(self) -> tuple[float, ...]:
        """w(r) = a0 h(r/a0): the coefficients of h, by power of x = r/a0."""
        return (1.0, 0.0, self.a2 * self.a0, self.a3 * self.a0**2, self.a4 * self.a0**3)

    @cached_property
    def _part_max(self) -> float:
        """Where theta stops growing, as the part x/(1 + x), which is finite for any x = r/a0."""
        _, _, c2, c3, c4 = self._shape
        x = min(first_root([0.0, -c2, -2 * c3, -3 * c4]), _FARTHEST)  # dtheta/dx vanishes with h - x h'
        return x / (1 + x)

    @cached_property
    def theta_max(self) -> float:
        """The angle at which theta(r) stops growing, and dr/dtheta is infinite; or that at r = 10000 a0."""
        return float(self._theta(np.asarray(self._part_max)))

    def _theta(self, part: FloatArray) -> FloatArray:
        x = part / (1 - part)
        return np.arctan2(x, _polynomial(x, self._shape))

    def _theta_slope(self, part: FloatArray) -> FloatArray:
        x = part / (1 - part)
        _, _, c2, c3, c4 = self._shape
        h = _polynomial(x, self._shape)
        growth = _polynomial(x, [1.0, 0.0, -c2, -2 * c3, -3 * c4])  # h - x h'
        return growth / (x * x + h * h) * (1 + x) ** 2

    def radius(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        part = growing_inverse(self._theta, self._theta_slope, np.abs(t), self._part_max)
        return np.asarray(np.copysign(self.a0 * part / (1 - part), t))

    def _solved(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """r, and 1/-dE/dr for the equation E(r, theta) = w(r) sin(theta) - r cos(theta) = 0."""
        r = np.abs(self.radius(theta))
        w_slope = _polynomial(r, [0.0, 2 * self.a2, 3 * self.a3, 4 * self.a4])
        with np.errstate(divide="ignore"):  # infinite where theta stops growing
            return r, 1 / np.maximum(np.cos(theta) - w_slope * np.sin(np.abs(theta)), 0.0)

    def slope(self, theta: ArrayLike) -> FloatArray:
        r, gain = self._solved(np.asarray(theta, float))
        w = _polynomial(r, [self.a0, 0.0, self.a2, self.a3, self.a4])
        return np.asarray(np.hypot(r, w) * gain)  # dE/dtheta = w cos + r sin = the length of the ray (r, w)

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        r, gain = self._solved(t)
        return np.stack([np.sin(t) * gain * r**n for n in (0, 2, 3, 4)], -1)
