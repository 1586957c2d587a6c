"""Projections that are no lens: longitude across, a function of latitude down.

Their rays are separable: ray = (horizontal x, vertical, horizontal z), where (x, z) = (sin lon, cos lon) belongs to
the column and (horizontal, vertical) to the row.  `project` answers positions outside the picture too, half a turn to
either side of its middle column; a picture that goes round the whole circle answers u in [-0.5, W - 0.5).  `unproject`
and `window_rays` follow the sphere past the border, so that a tile with a halo needs no special case.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import surface_kernels as kernels
from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray

Range = tuple[float, float]
"""From and to, in radians: longitudes left and right, latitudes bottom and top."""

WHOLE_CIRCLE: Range = (-math.pi, math.pi)
POLE_TO_POLE: Range = (-math.pi / 2, math.pi / 2)

_ROUNDING = 1e-12  # radians that an angle is off which went through degrees


class SeparableSurface(abc.ABC):
    """What the surfaces of this file have in common; a FastProjection.

    A row counts the `height` of a direction over the horizon: a function of latitude that each surface names.
    """

    size: tuple[int, int]
    _counts: ClassVar[int] = kernels.LATITUDE

    @property
    @abc.abstractmethod
    def longitudes(self) -> Range:
        """Longitudes of the picture's left and right border, radians."""

    @property
    @abc.abstractmethod
    def heights(self) -> Range:
        """Heights of the picture's lower and upper border, in the surface's own measure."""

    @abc.abstractmethod
    def _profile(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The horizontal and the vertical (down) part of unit rays at heights."""

    @property
    def wraps(self) -> bool:
        """Whether the right border is the left one: the picture goes round the whole circle."""
        left, right = self.longitudes
        return right - left >= 2 * math.pi - _ROUNDING

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Rays (..., 3) of any length -> pixels (..., 2) of `dtype`; NaN for no direction, and where rows never end.

        `rotation` (3, 3) takes the rays into the surface's frame first, in the same pass.  Errors are at most 1e-10
        px in a picture 32768 px wide; in float32 7e-4 px in one of 8192 px, for rays 1e-15 to 1e15 long.
        """
        given = contiguous_rays(rays)
        pixels: NDArray[Any] = np.empty((*given.shape[:-1], 2), dtype)
        (left, right), (bottom, top), (width, height) = self.longitudes, self.heights, self.size
        border = width - 0.5
        columns = [
            width / 2 - 0.5,
            width / (right - left),
            *((-0.5, border) if self.wraps else (-np.inf, np.inf)),
            width,
        ]
        per_unit = height / (top - bottom)
        kernels.project_rows(
            given.reshape(-1, 3),
            _turn_to_front((left + right) / 2) @ checked_rotation(rotation),
            self._counts,
            np.array(columns, dtype),
            np.array([height / 2 - 0.5 + (bottom + top) / 2 * per_unit, per_unit], dtype),
            pixels.reshape(-1, 2),
        )
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3); NaN for what is no pixel."""
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        with np.errstate(invalid="ignore"):
            lon = self._longitude(u)
            x, z = np.sin(lon), np.cos(lon)
            horizontal, vertical = self._profile(self._height(v))
        return np.stack([horizontal * x, np.where(np.isnan(x), np.nan, vertical), horizontal * z], -1)

    def column_directions(self, columns: slice) -> FloatArray:
        """(x, z) = (sin lon, cos lon) of whole columns, (w, 2)."""
        lon = self._longitude(np.arange(columns.start, columns.stop, dtype=float))
        return np.stack([np.sin(lon), np.cos(lon)], -1)

    def row_profile(self, rows: slice) -> FloatArray:
        """(horizontal, vertical) of whole rows, (h, 2); vertical is down."""
        return np.stack(self._profile(self._height(np.arange(rows.start, rows.stop, dtype=float))), -1)

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (rows, columns, 3) of `dtype` of a rectangle of whole pixels."""
        directions, profile = self.column_directions(columns), self.row_profile(rows)
        rays: NDArray[Any] = np.empty((len(profile), len(directions), 3), dtype)
        kernels.window_of_rows(directions, profile, rays)
        return rays

    def _longitude(self, u: FloatArray) -> FloatArray:
        left, right = self.longitudes
        return (left + right) / 2 + ((u + 0.5) / self.size[0] - 0.5) * (right - left)

    def _height(self, v: FloatArray) -> FloatArray:
        bottom, top = self.heights
        return (bottom + top) / 2 + (0.5 - (v + 0.5) / self.size[1]) * (top - bottom)


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
        return self.wraps and self.latitudes[1] - self.latitudes[0] >= math.pi - _ROUNDING

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
        if not 0 < self.hfov <= 2 * math.pi + _ROUNDING:
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


def contiguous_rays(rays: ArrayLike) -> NDArray[Any]:
    """Rays as kernels want them: in C order, float32 kept, everything else float64."""
    given = np.asarray(rays)
    return np.ascontiguousarray(given, np.float32 if given.dtype == np.float32 else np.float64)


def checked_rotation(rotation: ArrayLike | None) -> FloatArray:
    """A rotation (3, 3), by default none; UsageError if it is not finite."""
    if rotation is None:
        return np.eye(3)
    turn = np.ascontiguousarray(rotation, np.float64)
    if turn.shape != (3, 3) or not np.isfinite(turn).all():
        raise UsageError("a rotation is 3 x 3 finite numbers")
    return turn


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height as whole numbers; UsageError if they are none of a picture."""
    if not all(1 <= side <= MAX_SIDE_PX and side == int(side) for side in size):
        raise UsageError(f"a picture of {size[0]} x {size[1]}: a side is a whole number of pixels, 1 to {MAX_SIDE_PX}")
    return int(size[0]), int(size[1])


def _checked_longitudes(longitudes: Range) -> None:
    left, right = longitudes
    if not (0 < right - left <= 2 * math.pi + _ROUNDING and max(abs(left), abs(right)) <= 4 * math.pi):
        raise UsageError(
            f"longitudes {math.degrees(left):.6g} to {math.degrees(right):.6g} degrees: they run to the right, over "
            "at most 360"
        )


def _checked_latitudes(latitudes: Range, to_the_poles: bool) -> None:
    bottom, top = latitudes
    most = math.pi / 2 + _ROUNDING if to_the_poles else math.radians(89.99)
    if not -most <= bottom < top <= most:
        limits = "from -90 to 90" if to_the_poles else "and this surface ends before the poles, at 89.99"
        raise UsageError(
            f"latitudes {math.degrees(bottom):.6g} to {math.degrees(top):.6g} degrees: they run upwards, {limits}"
        )


def _turn_to_front(longitude: float) -> FloatArray:
    """The rotation (3, 3) that takes the horizontal direction of a longitude to z."""
    sine, cosine = math.sin(longitude), math.cos(longitude)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
