"""Projections that are no lens: equirectangular, cylindrical, Mercator and the 360 x 360 mosaic.

What they have in common is in `separable.py`, the cube map in `cube_map.py`, formulas and spellings in
docs/projections.md.
"""

from __future__ import annotations

import abc
import dataclasses
import math

import numpy as np

from fullsphere.model import surface_kernels as kernels
from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.separable import ROUNDING, Range, SeparableSurface, checked_size

__all__ = [
    "POLE_TO_POLE",
    "WHOLE_CIRCLE",
    "Cylindrical",
    "Equirectangular",
    "Mercator",
    "Mosaic360",
    "Range",
    "SeparableSurface",
]

WHOLE_CIRCLE: Range = (-math.pi, math.pi)
POLE_TO_POLE: Range = (-math.pi / 2, math.pi / 2)


@dataclasses.dataclass(frozen=True)
class Equirectangular(SeparableSurface):
    """Longitude across and latitude down: the whole sphere, or a window of it.

    lon = ((u + 0.5)/W - 0.5) 2 pi to the right, lat = (0.5 - (v + 0.5)/H) pi up,
    ray = (cos lat sin lon, -sin lat, cos lat cos lon): the picture's centre looks along +z.  A window runs evenly over
    its `longitudes` and `latitudes` instead.  Past a pole latitude comes down on the other side.

    Attributes
    ----------
    size
        Width and height in pixels; 2:1 for the whole sphere, free for a window.
    longitudes, latitudes
        The window, radians: longitudes from left to right, at most a circle; latitudes from bottom to top.

    Raises
    ------
    UsageError
        If the size or the window is none.
    """

    size: tuple[int, int]
    longitudes: Range = WHOLE_CIRCLE
    latitudes: Range = POLE_TO_POLE

    def __post_init__(self) -> None:
        _checked_longitudes(self.longitudes)
        _checked_latitudes(self.latitudes, to_the_poles=True)
        width, height = self.size
        if self.whole and (width != 2 * height or not 2 <= width <= MAX_SIDE_PX):
            raise UsageError(
                f"a full equirectangular picture is twice as wide as high and 2 to {MAX_SIDE_PX} px wide, "
                f"not {width} x {height}"
            )
        object.__setattr__(self, "size", checked_size(self.size))

    @property
    def whole(self) -> bool:
        """Whether the picture is the whole sphere."""
        return self.wraps and self.latitudes[1] - self.latitudes[0] >= math.pi - ROUNDING

    @property
    def heights(self) -> Range:
        """Latitudes."""
        return self.latitudes

    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.cos(height), -np.sin(height)


@dataclasses.dataclass(frozen=True)
class _Upright(SeparableSurface):
    """A surface that stands round the vertical axis and ends before the poles, which it images nowhere."""

    size: tuple[int, int]
    hfov: float = 2 * math.pi
    latitudes: Range | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", checked_size(self.size))
        if not 0 < self.hfov <= 2 * math.pi + ROUNDING:
            raise UsageError(f"a horizontal field of view of {math.degrees(self.hfov):.6g} degrees is not in (0, 360]")
        if self.latitudes is not None:
            _checked_latitudes(self.latitudes, to_the_poles=False)

    @property
    def longitudes(self) -> Range:
        return (-self.hfov / 2, self.hfov / 2)

    @property
    def heights(self) -> Range:
        if self.latitudes is None:
            half = self.size[1] / self.size[0] * self.hfov / 2
            return (-half, half)
        bottom, top = self.latitudes
        return (self.height_of(bottom), self.height_of(top))

    @staticmethod
    @abc.abstractmethod
    def height_of(latitude: float) -> float:
        """Height of a latitude in the surface's own measure, where a radian of longitude is 1."""


@dataclasses.dataclass(frozen=True)
class Cylindrical(_Upright):
    """The sphere seen on a cylinder from the middle of its axis: rows count tan(lat), so that uprights stay straight.

    lon = ((u + 0.5)/W - 0.5) hfov; with square pixels tan(lat) = (0.5 - (v + 0.5)/H) hfov H/W.

    Attributes
    ----------
    size
        Width and height in pixels.
    hfov
        Angle from the left border to the right one, radians, at most a circle; the middle column looks along z.
    latitudes
        Latitudes of the lower and the upper border, radians; None for square pixels and the horizon in the middle.

    Raises
    ------
    UsageError
        If a value is out of range.
    """

    _counts = kernels.TANGENT

    @staticmethod
    def height_of(latitude: float) -> float:
        return math.tan(latitude)

    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        horizontal = 1 / np.sqrt(1 + height * height)
        return horizontal, -height * horizontal


@dataclasses.dataclass(frozen=True)
class Mercator(_Upright):
    """Mercator's projection: rows count asinh(tan(lat)), so that angles between curves are kept.

    lon = ((u + 0.5)/W - 0.5) hfov; with square pixels asinh(tan(lat)) = (0.5 - (v + 0.5)/H) hfov H/W.
    Snyder, "Map Projections: a Working Manual" (1987), section 7.  Attributes and errors are those of `Cylindrical`.
    """

    _counts = kernels.MERCATOR

    @staticmethod
    def height_of(latitude: float) -> float:
        return math.asinh(math.tan(latitude))

    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        return 1 / np.cosh(height), -np.tanh(height)


@dataclasses.dataclass(frozen=True)
class Mosaic360(SeparableSurface):
    """The 360 x 360 mosaic: the turn of the arm across, and the circle of rays of each position of it down.

    alpha = (u + 0.5)/W 360 degrees, psi = 180 - (v + 0.5)/H 360 degrees, ray = cos(psi) right + sin(psi) up with
    right = (cos alpha, 0, -sin alpha).  Rows |psi| < 90 are the left eye, looking towards longitude alpha + 90 at
    elevation psi; the rows above and below are the right eye, looking towards alpha - 90 at elevation 180 - psi.  So
    each direction is there twice: `project` answers the left eye's.  Past every border the picture goes round.
    After Bakstein & Pajdla, "An overview of non-central cameras" (CVWW 2001) and their paper of 2002.
    """

    size: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", checked_size(self.size))

    @property
    def longitudes(self) -> Range:
        """Longitudes that the left eye sees at the left and the right border: alpha = 0 looks towards 90 degrees."""
        return (math.pi / 2, math.pi / 2 + 2 * math.pi)

    @property
    def heights(self) -> Range:
        """The angle psi."""
        return WHOLE_CIRCLE

    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.cos(height), -np.sin(height)


def _checked_longitudes(longitudes: Range) -> None:
    left, right = longitudes
    if not (0 < right - left <= 2 * math.pi + ROUNDING and max(abs(left), abs(right)) <= 4 * math.pi):
        raise UsageError(
            f"longitudes {math.degrees(left):.6g} to {math.degrees(right):.6g} degrees: they run to the right, over "
            "at most 360"
        )


def _checked_latitudes(latitudes: Range, to_the_poles: bool) -> None:
    bottom, top = latitudes
    most = math.pi / 2 + ROUNDING if to_the_poles else math.radians(89.99)
    if not -most <= bottom < top <= most:
        limits = "from -90 to 90" if to_the_poles else "and this surface ends before the poles, at 89.99"
        raise UsageError(
            f"latitudes {math.degrees(bottom):.6g} to {math.degrees(top):.6g} degrees: they run upwards, {limits}"
        )
