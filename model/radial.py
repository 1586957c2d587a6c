"""What a radial lens projection r(theta) is: the distance from the image centre at which a ray is imaged.

A lens is a small frozen value that knows one formula: `radius` (r in pixels), its `slope` dr/dtheta, and
`radius_by_parameter`, the derivatives by the lens's own parameters.  theta is the angle from the optical axis in
radians and may pass 90 degrees wherever the formula allows.  The lenses themselves stand in the `lenses_` modules,
their table in `lens.py`.
"""

from __future__ import annotations

import abc
import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.errors import CameraError

FloatArray = NDArray[np.float64]

HALF_TURN = math.pi
RIGHT_ANGLE = math.pi / 2

_LIMIT = 1e7  # of the size of any value
_NEARLY_REAL = 1e-7  # of a root's size: a double root is computed as a pair so far off the real axis


class Parameter(NamedTuple):
    """A lens parameter: its name in code, its key in files (with the unit), and the open interval of its values."""

    name: str
    key: str
    lower: float
    upper: float

    @property
    def length_power(self) -> int:
        """Power of a pixel that the value counts in, by its key: 1 of `f_px`, -3 of `a4_per_px3`, 0 of a number.

        A value grows by this power of the factor by which the picture does.
        """
        unit = re.fullmatch(r".*?(_per)?_px(\d*)", self.key)
        return 0 if unit is None else int(unit[2] or 1) * (-1 if unit[1] else 1)

    @property
    def is_length(self) -> bool:
        """Whether the value is in pixels; r(theta) is linear in the lengths of a lens together."""
        return self.length_power == 1


def length(name: str, lower: float = 0.0) -> Parameter:
    """A parameter in pixels."""
    return Parameter(name, f"{name}_px", lower, _LIMIT)


def ratio(name: str, lower: float = 0.0, upper: float = _LIMIT) -> Parameter:
    """A parameter that is a number: above zero unless told otherwise."""
    return Parameter(name, name, lower, upper)


def coefficient(name: str, length_power: int = 0) -> Parameter:
    """A parameter of either sign, in a negative power of pixels: a coefficient of a polynomial."""
    unit = "" if length_power == 0 else "_per_px" if length_power == -1 else f"_per_px{-length_power}"
    return Parameter(name, name + unit, -_LIMIT, _LIMIT)


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
        return self.with_values([v * factor**p.length_power for p, v in zip(self.parameters, self.values, strict=True)])

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
    return growing_inverse(lens.radius, lens.slope, radius, theta_limit)


def growing_inverse(
    function: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    values: ArrayLike,
    limit: float,
) -> FloatArray:
    """Where in [0, limit] a growing function with function(0) = 0 has the values; NaN where a value is not reached.

    Newton steps kept inside a bracket.  A value beyond function(limit) by rounding (1e-12 of it) is at the limit.
    """
    value = np.asarray(values, float)
    nodes = np.linspace(0.0, limit, 257)
    heights = np.maximum.accumulate(function(nodes))
    highest = heights[-1]
    inside = (value >= 0) & (value <= highest * (1 + 1e-12))
    target = np.where(inside, np.minimum(value, highest), 0.0)
    cell = np.clip(np.searchsorted(heights, target, side="right") - 1, 0, nodes.size - 2)
    low, high = nodes[cell], nodes[cell + 1]
    at = np.interp(target, heights, nodes)
    for _ in range(80):
        error = function(at) - target
        low, high = np.where(error <= 0, at, low), np.where(error >= 0, at, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = at - error / slope(at)
        usable = (newton >= low) & (newton <= high)
        following = np.where(error == 0, at, np.where(usable, newton, (low + high) / 2))
        settled = (np.abs(following - at) <= 1e-15 * at) | (np.abs(error) <= 4e-16 * target)
        at = following
        if settled.all():
            break
    return np.where(inside, at, np.nan)


def first_root(coefficients: Sequence[float]) -> float:
    """The least positive x with 1 + c1 x + c2 x^2 + ... = 0 for coefficients (c1, c2, ...), or infinity.

    1/x is a root of the reversed polynomial, whose leading coefficient is 1 whatever the others are.
    """
    reciprocal = np.roots([1.0, *coefficients])
    real = reciprocal.real[np.abs(reciprocal.imag) <= _NEARLY_REAL * np.abs(reciprocal)]
    largest = float(np.max(real, initial=0.0))
    return 1 / largest if largest > 1e-300 else math.inf
