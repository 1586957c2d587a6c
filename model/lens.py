"""Radial lens projections r(theta): the distance from the image centre at which a ray is imaged.

Every class is a small frozen value that knows one formula: `radius` (r in pixels), its `slope` dr/dtheta, and
`radius_by_parameter`, the derivatives by the lens's own parameters.  theta is the angle from the optical axis in
radians and may pass 90 degrees wherever the formula allows.  The formulas are those of sections 3 and 4 of Bakstein &
Pajdla, "Calibration of a fish eye lens with field of view larger than 180", CVWW 2002; `BaksteinPajdla` is their
equation 3.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.errors import CameraError

FloatArray = NDArray[np.float64]

_HALF_TURN = math.pi
_RIGHT_ANGLE = math.pi / 2


class Parameter(NamedTuple):
    """A lens parameter: its name in code, its key in files (with the unit), and the open interval of its values."""

    name: str
    key: str
    lower: float
    upper: float

    @property
    def is_length(self) -> bool:
        """Whether the value is in pixels, and so scales with the picture."""
        return self.key.endswith("_px")


def _length(name: str, lower: float = 0.0) -> Parameter:
    return Parameter(name, f"{name}_px", lower, 1e7)


def _ratio(name: str) -> Parameter:
    return Parameter(name, name, 0.0, 1e7)


@dataclasses.dataclass(frozen=True)
class Lens(abc.ABC):
    """A radially symmetric projection; r(0) = 0 and r grows up to `theta_max`.

    A subclass is a frozen dataclass whose fields are its `parameters`, in that order.
    """

    projection: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            value = float(getattr(self, parameter.name))
            object.__setattr__(self, parameter.name, value)
            if not (math.isfinite(value) and parameter.lower < value < parameter.upper):
                raise CameraError(
                    f"{self.projection} lens: {parameter.key} = {value!r} is not between "
                    f"{parameter.lower:g} and {parameter.upper:g}"
                )
        if not self.theta_max > 0:
            raise CameraError(f"{self.projection} lens: r(theta) does not grow from theta = 0 with {self}")

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters' values, in the order of `parameters`."""
        return tuple(getattr(self, p.name) for p in self.parameters)

    def with_values(self, values: ArrayLike) -> Self:
        """The same kind of lens with other values, in the order of `parameters`.

        Raises
        ------
        CameraError
            If a value is not finite, out of bounds, or makes r(theta) fall at the axis.
        """
        return type(self)(*np.asarray(values, float).tolist())

    def scaled(self, factor: float) -> Self:
        """The lens as seen in a picture whose sides are `factor` times as long."""
        return self.with_values(
            [v * factor if p.is_length else v for p, v in zip(self.parameters, self.values, strict=True)]
        )

    @property
    @abc.abstractmethod
    def theta_max(self) -> float:
        """Angle in radians, at most pi, up to which r(theta) is finite and grows."""

    @abc.abstractmethod
    def radius(self, theta: ArrayLike) -> FloatArray:
        """r in pixels at theta (...,) in radians."""

    @abc.abstractmethod
    def slope(self, theta: ArrayLike) -> FloatArray:
        """dr/dtheta in pixels per radian at theta (...,)."""

    @abc.abstractmethod
    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        """dr/dparameter at theta (...,), shape (..., len(parameters))."""


@dataclasses.dataclass(frozen=True)
class _OneLength(Lens):
    """r = f h(theta): the classical projections, which differ in h only."""

    f: float
    parameters = (_length("f"),)

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        return (self.radius(theta) / self.f)[..., None]


@dataclasses.dataclass(frozen=True)
class Perspective(_OneLength):
    """r = f tan(theta), theta < 90 degrees: straight lines stay straight."""

    projection = "perspective"
    theta_max = _RIGHT_ANGLE

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.tan(theta)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f / np.cos(theta) ** 2


@dataclasses.dataclass(frozen=True)
class Stereographic(_OneLength):
    """r = 2 f tan(theta/2), theta < 180 degrees: angles between curves are kept."""

    projection = "stereographic"
    theta_max = _HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return 2 * self.f * np.tan(np.asarray(theta) / 2)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f / np.cos(np.asarray(theta) / 2) ** 2


@dataclasses.dataclass(frozen=True)
class Equidistant(_OneLength):
    """r = f theta, to 180 degrees."""

    projection = "equidistant"
    theta_max = _HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.asarray(theta, float)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return np.full(np.shape(theta), self.f)


@dataclasses.dataclass(frozen=True)
class Equisolid(_OneLength):
    """r = 2 f sin(theta/2), to 180 degrees: areas are kept."""

    projection = "equisolid"
    theta_max = _HALF_TURN

    def radius(self, theta: ArrayLike) -> FloatArray:
        return 2 * self.f * np.sin(np.asarray(theta) / 2)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.cos(np.asarray(theta) / 2)


@dataclasses.dataclass(frozen=True)
class Orthographic(_OneLength):
    """r = f sin(theta), the paper's sine law, to 90 degrees, where it folds back."""

    projection = "orthographic"
    theta_max = _RIGHT_ANGLE

    def radius(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.sin(theta)

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f * np.cos(theta)


@dataclasses.dataclass(frozen=True)
class ScaledStereographic(Lens):
    """r = a tan(theta/b), theta < 90 b degrees: the paper's first model of the FC-E8."""

    a: float
    b: float
    projection = "scaled-stereographic"
    parameters = (_length("a"), _ratio("b"))

    @property
    def theta_max(self) -> float:
        return min(self.b * _RIGHT_ANGLE, _HALF_TURN)

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
    parameters = (_length("a", -1e7), _ratio("b"), _length("c", -1e7), _ratio("d"))

    @cached_property
    def theta_max(self) -> float:
        """The first angle at which dr/dtheta is no longer positive, or the pole of the tangent, or pi."""
        limit = min(self.b * _RIGHT_ANGLE, _HALF_TURN)
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


LENSES: dict[str, type[Lens]] = {
    lens.projection: lens
    for lens in (
        Perspective,
        Stereographic,
        Equidistant,
        Equisolid,
        Orthographic,
        ScaledStereographic,
        BaksteinPajdla,
    )
}
"""Every lens by its name in files and on the command line."""


def angle_of_radius(lens: Lens, radius: ArrayLike, theta_limit: float) -> FloatArray:
    """theta in [0, theta_limit] with r(theta) = radius, by Newton steps kept inside a bracket.

    Parameters
    ----------
    lens
        A lens whose r(theta) grows on [0, theta_limit].
    radius
        Distances from the image centre in pixels, any shape.
    theta_limit
        Largest angle looked for, radians, at most `lens.theta_max`.

    Returns
    -------
    Angles in radians with the shape of `radius`; NaN where the radius is negative or beyond r(theta_limit) by more
    than rounding (1e-12 of it).
    """
    r = np.asarray(radius, float)
    nodes = np.linspace(0.0, theta_limit, 257)
    heights = np.maximum.accumulate(lens.radius(nodes))
    r_limit = heights[-1]
    inside = (r >= 0) & (r <= r_limit * (1 + 1e-12))
    target = np.where(inside, np.minimum(r, r_limit), 0.0)
    cell = np.clip(np.searchsorted(heights, target, side="right") - 1, 0, nodes.size - 2)
    low, high = nodes[cell], nodes[cell + 1]
    theta = np.interp(target, heights, nodes)
    for _ in range(80):
        error = lens.radius(theta) - target
        low, high = np.where(error <= 0, theta, low), np.where(error >= 0, theta, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = theta - error / lens.slope(theta)
        usable = (newton >= low) & (newton <= high)
        following = np.where(error == 0, theta, np.where(usable, newton, (low + high) / 2))
        settled = (np.abs(following - theta) <= 1e-15 * theta) | (np.abs(error) <= 4e-16 * target)
        theta = following
        if settled.all():
            break
    return np.where(inside, theta, np.nan)
