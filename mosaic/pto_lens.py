"""The lens of a Hugin project, exactly as libpano has it: what its pictures are compared with.

With the ideal projection r(theta) = F h(theta) of its type, R = r/half of the picture's shorter side, and the source
radius half (a R^3 + b R^2 + c R + 1 - a - b - c) R; then the picture is shifted by (d, e) and sheared by (g, t).
Formula: PanoTools wiki, "Lens correction model"; agrees with Hugin's `pano_trafo` to 0.001 px.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.errors import CameraError
from fullsphere.model.lens import (
    Equidistant,
    Equisolid,
    FloatArray,
    Lens,
    Orthographic,
    Perspective,
    Stereographic,
    Thoby,
    angle_of_radius,
)
from fullsphere.model.radial import first_root, growing_inverse

TYPES: dict[int, Callable[[float], Lens]] = {
    0: Perspective,
    2: Equidistant,
    3: Equidistant,
    8: Orthographic,
    10: Stereographic,
    20: Thoby,
    21: Equisolid,
}
"""The ideal projections by their number f; 2 is a circular fisheye and 3 one that fills the picture."""

CIRCULAR = (2, 20)
"""Types whose crop is a circle."""

_NEARLY_ALL = 1 - 1e-9  # of the angles of the ideal projection
_FLATTEST = math.radians(89.9)  # of an ordinary lens: its radius is finite there


@dataclasses.dataclass(frozen=True)
class PanoToolsLens:
    """A Projection: picture size, type f, horizontal field of view v of the whole width, and a, b, c, d, e, g, t.

    Raises
    ------
    CameraError
        If the values describe no lens whose radius grows from the axis on.
    """

    size: tuple[int, int]
    kind: int
    hfov_deg: float
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    e: float = 0.0
    g: float = 0.0
    t: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in TYPES:
            raise CameraError(f"f{self.kind} is no lens; known are f{', f'.join(map(str, TYPES))}")
        if (self.kind == 0 and not 0 < self.hfov_deg < 180) or not 0 < self.hfov_deg <= 1000:
            raise CameraError(f"v{self.hfov_deg:g} is no horizontal field of view of f{self.kind}")
        if not self.focal_px > 0:
            raise CameraError(f"v{self.hfov_deg:g} is wider than f{self.kind} can image")
        if not self._inner > 0:
            raise CameraError(f"a, b and c sum up to {self.a + self.b + self.c:g}: the picture would be turned over")
        if abs(self.g * self.t) >= self.size[0] * self.size[1]:
            raise CameraError("g and t shear the picture to a line")

    @classmethod
    def of_focal(cls, size: tuple[int, int], kind: int, focal_px: float, **values: float) -> PanoToolsLens:
        """By the focal length F of the ideal projection; raises CameraError if the whole width has no angle then."""
        unit = TYPES[kind](1.0)
        half_width = size[0] / 2 / focal_px
        if kind in (2, 3):
            half_angle = half_width
        else:
            limit = min(unit.theta_max, _FLATTEST) if kind == 0 else unit.theta_max * _NEARLY_ALL
            half_angle = float(angle_of_radius(unit, half_width, limit))
        if not half_angle > 0:
            raise CameraError(f"f{kind}: a focal length of {focal_px:g} px has no angle for {size[0]} px")
        return cls(size, kind, 2 * math.degrees(half_angle), **values)

    @property
    def focal_px(self) -> float:
        """F of the ideal projection in pixels."""
        return float(self.size[0] / 2 / TYPES[self.kind](1.0).radius(math.radians(self.hfov_deg) / 2))

    @property
    def half_side(self) -> float:
        """Half of the shorter side in pixels: where the ideal radius stays what it is."""
        return min(self.size) / 2

    @property
    def axis_px(self) -> tuple[float, float]:
        """The pixel on the optical axis."""
        u, v = self._pixels(np.zeros(2))
        return float(u), float(v)

    @property
    def _inner(self) -> float:
        return 1 - self.a - self.b - self.c

    @property
    def ideal(self) -> Lens:
        """The projection that a, b and c bend."""
        return TYPES[self.kind](self.focal_px)

    @cached_property
    def theta_max(self) -> float:
        """The angle in radians up to which the radius grows."""
        ideal = self.ideal
        most = _FLATTEST if self.kind == 0 else ideal.theta_max * _NEARLY_ALL
        turning = self.half_side * first_root([n * k / self._inner for n, k in ((2, self.c), (3, self.b), (4, self.a))])
        return float(angle_of_radius(ideal, turning, most)) if turning < ideal.radius(most) else most

    def radius(self, theta: ArrayLike) -> FloatArray:
        """r in pixels of the picture at theta (...,) in radians."""
        return self._bent(self.ideal.radius(theta))

    def angle(self, radius: ArrayLike) -> FloatArray:
        """theta in radians of r (...,) in pixels; NaN where no ray is imaged."""
        limit = float(self.ideal.radius(self.theta_max))
        ideal = growing_inverse(self._bent, self._slope, radius, limit)
        return angle_of_radius(self.ideal, np.minimum(ideal, limit), self.theta_max)

    def project(self, rays: ArrayLike) -> FloatArray:
        """Rays (..., 3) -> pixels (..., 2) of the whole picture, NaN past `theta_max`."""
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        inside = theta <= self.theta_max
        r = np.where(inside, self.radius(np.where(inside, theta, 0)), np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            gain = np.where(rho > 0, r / rho, 0.0 * r)
        return self._pixels(np.stack([gain * x, gain * y], -1))

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of the whole picture -> unit rays (..., 3), NaN where no ray is imaged."""
        centred = np.asarray(pixels, float) - self._middle
        x, y = np.moveaxis(centred @ np.linalg.inv(self._shear).T - np.array([self.d, self.e]), -1, 0)
        r = np.hypot(x, y)
        theta = self.angle(r)
        with np.errstate(invalid="ignore", divide="ignore"):
            s = np.where(r > 0, np.sin(theta) / r, 0.0 * theta)
        return np.stack([s * x, s * y, np.cos(theta)], -1)

    def _bent(self, ideal: ArrayLike) -> FloatArray:
        R = np.asarray(ideal, float) / self.half_side
        return np.asarray(self.half_side * R * (self._inner + R * (self.c + R * (self.b + R * self.a))))

    def _slope(self, ideal: FloatArray) -> FloatArray:
        R = ideal / self.half_side
        return np.asarray(self._inner + R * (2 * self.c + R * (3 * self.b + R * 4 * self.a)))

    def _pixels(self, from_axis: FloatArray) -> FloatArray:
        return np.asarray((from_axis + np.array([self.d, self.e])) @ self._shear.T + self._middle)

    @property
    def _middle(self) -> FloatArray:
        return (np.array(self.size) - 1) / 2

    @property
    def _shear(self) -> FloatArray:
        return np.array([[1.0, self.g / self.size[1]], [self.t / self.size[0], 1.0]])
