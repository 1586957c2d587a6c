"""The camera of Bakstein & Pajdla: a spherical retina behind a radially symmetric lens.

`Projection` is what every picture in fullsphere is, a map between pixels and unit rays; `Camera` is the exact one for
a fisheye (or ordinary) frame.  Equations are numbered as in the paper (CVWW 2002).
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.errors import CameraError
from fullsphere.model.lens import FloatArray, Lens, angle_of_radius

MAX_SIDE_PX = 1 << 20
"""The longest side of a picture that fullsphere will describe."""

_ROUNDING = 1e-12  # radians past half_fov or theta_max that are still rounding, 1e-9 px for any real lens


@runtime_checkable
class Projection(Protocol):
    """A map between the pixels of one picture and unit rays in its own frame (x right, y down, z forward)."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        ...

    def project(self, rays: ArrayLike) -> FloatArray:
        """Rays (..., 3) -> pixels (..., 2), NaN outside the field of view."""
        ...

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3), NaN outside the field of view."""
        ...


@runtime_checkable
class FastProjection(Projection, Protocol):
    """A projection whose functions are compiled loops over arrays: what pictures are resampled with.

    As with every projection a position outside the picture's rectangle is the caller's question: `project` answers
    it wherever the projection goes on past the border.
    """

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Rays (..., 3) -> pixels (..., 2) of `dtype` (float32 or float64), NaN outside the field of view.

        `rotation` (3, 3) takes the rays into the projection's frame first, in the same pass.
        """
        ...

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (rows, columns, 3) of `dtype` of a rectangle of whole pixels, NaN where it looks nowhere.

        The rectangle may reach past the picture's border, as far as the projection goes on there.
        """
        ...


class ProjectionJacobians(NamedTuple):
    """Pixels (..., 2) and their derivatives by the ray (..., 2, 3) and by the camera's parameters (..., 2, P)."""

    pixels: FloatArray
    d_pixel_d_ray: FloatArray
    d_pixel_d_parameter: FloatArray


@dataclasses.dataclass(frozen=True)
class Camera:
    """A lens, where its axis meets the picture, and how much of the sphere it sees.

    Attributes
    ----------
    lens
        The radial projection r(theta), in pixels.
    size
        Width and height of the picture in pixels.
    centre
        Pixel (u0, v0) on the optical axis; the centre of the first pixel is (0, 0).
    half_fov
        Largest angle from the optical axis that is imaged, radians.
    aspect
        Height of a pixel step over its width, v = v0 + aspect y'; 1 for square pixels (1/beta of the paper).

    Raises
    ------
    CameraError
        If a value is not finite or out of range, or r(theta) does not grow up to `half_fov`.
    """

    lens: Lens
    size: tuple[int, int]
    centre: tuple[float, float]
    half_fov: float = dataclasses.field(kw_only=True)
    aspect: float = 1.0

    def __post_init__(self) -> None:
        width, height = self.size
        if not all(1 <= side <= MAX_SIDE_PX and side == int(side) for side in self.size):
            raise CameraError(f"camera: image size {width} x {height} is not between 1 and {MAX_SIDE_PX} pixels a side")
        u0, v0 = self.centre
        if not (abs(u0) <= 10 * MAX_SIDE_PX and abs(v0) <= 10 * MAX_SIDE_PX):
            raise CameraError(f"camera: centre ({u0}, {v0}) is not near a picture")
        if not 0.1 < self.aspect < 10:
            raise CameraError(f"camera: aspect {self.aspect} is not between 0.1 and 10")
        if not 0 < self.half_fov <= self.lens.theta_max + _ROUNDING:
            raise CameraError(
                f"camera: half field of view {math.degrees(self.half_fov):.6g} degrees is not between 0 and "
                f"{math.degrees(self.lens.theta_max):.6g}, where the {self.lens.projection} lens stops growing"
            )
        if not 0 < self.image_radius < 10 * MAX_SIDE_PX:
            raise CameraError(
                f"camera: the {self.lens.projection} lens images {math.degrees(self.half_fov):.6g} degrees at "
                f"{self.image_radius:.4g} px; state a smaller field of view"
            )
        object.__setattr__(self, "size", (int(width), int(height)))
        object.__setattr__(self, "centre", (float(u0), float(v0)))
        object.__setattr__(self, "aspect", float(self.aspect))
        object.__setattr__(self, "half_fov", float(self.half_fov))

    def project(self, rays: ArrayLike) -> FloatArray:
        """Rays (..., 3) of any length in the camera frame -> pixels (..., 2), equations 3 to 6 of the paper.

        NaN where a ray is further than `half_fov` from the axis, or is no direction (zero or NaN).  A pixel may lie
        outside the picture's rectangle.
        """
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        inside = (theta <= self.half_fov + _ROUNDING) & ((rho > 0) | (z > 0))
        r = self.lens.radius(np.where(inside, theta, 0.0))  # equation 3
        with np.errstate(invalid="ignore", divide="ignore"):
            cos_phi, sin_phi = np.where(rho > 0, (x / rho, y / rho), 0.0)
        u = self.centre[0] + r * cos_phi  # equations 4 and 5 through K, equation 6
        v = self.centre[1] + self.aspect * r * sin_phi
        return np.where(inside[..., None], np.stack([u, v], -1), np.nan)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3) in the camera frame; the inverse of `project`.

        NaN further from the centre than r(half_fov).
        """
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        x, y = u - self.centre[0], (v - self.centre[1]) / self.aspect  # K^-1, equation 1
        r = np.hypot(x, y)
        theta = angle_of_radius(self.lens, r, self.half_fov)
        with np.errstate(invalid="ignore", divide="ignore"):
            s = np.where(r > 0, np.sin(theta) / r, np.where(np.isnan(theta), np.nan, 0.0))
        return np.stack([s * x, s * y, np.cos(theta)], -1)

    @property
    def image_radius(self) -> float:
        """Radius r(half_fov) in pixels of the circle that the camera images."""
        return float(self.lens.radius(self.half_fov))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The lens's parameter keys, then centre and aspect: the order of `values` and of the Jacobians."""
        return (*(p.key for p in self.lens.parameters), "centre_u_px", "centre_v_px", "aspect")

    @property
    def values(self) -> FloatArray:
        """All intrinsic values (P,), in the order of `parameter_names`."""
        return np.array([*self.lens.values, *self.centre, self.aspect])

    def with_values(self, values: ArrayLike, half_fov: float | None = None) -> Self:
        """The camera with other intrinsic values (P,); raises CameraError if they describe none."""
        *lens_values, u0, v0, aspect = np.asarray(values, float).tolist()
        return dataclasses.replace(
            self,
            lens=self.lens.with_values(lens_values),
            centre=(u0, v0),
            aspect=aspect,
            half_fov=self.half_fov if half_fov is None else half_fov,
        )

    def project_with_jacobians(self, rays: ArrayLike) -> ProjectionJacobians:
        """`project` and its derivatives.

        With x = rho cos(phi), y = rho sin(phi), n^2 = rho^2 + z^2 and g = r/rho,
        d(g x) = g dx + cos(phi) (r' z/n^2 - g) drho - r' x/n^2 dz, and g -> r'(0)/z on the axis.
        Derivatives are by the ray as given (not normalised); they are NaN where the pixel is.
        """
        ray = np.asarray(rays, float)
        x, y, z = np.moveaxis(ray, -1, 0)
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        inside = (theta <= self.half_fov + _ROUNDING) & ((rho > 0) | (z > 0))
        theta = np.where(inside, theta, 0.0)
        r, slope = self.lens.radius(theta), self.lens.slope(theta)
        with np.errstate(invalid="ignore", divide="ignore"):
            cos_phi, sin_phi = np.where(rho > 0, (x / rho, y / rho), 0.0)
            g = np.where(rho > 0, r / rho, slope / z)
            n2 = rho**2 + z**2
            bend = slope * z / n2 - g
            along = slope / n2
            zero = np.zeros_like(g)
            d_radius = np.stack([cos_phi, sin_phi, zero], -1)  # d rho / d ray
            d_u = np.stack([g, zero, -along * x], -1) + (cos_phi * bend)[..., None] * d_radius
            d_v = np.stack([zero, g, -along * y], -1) + (sin_phi * bend)[..., None] * d_radius

        by_lens = self.lens.radius_by_parameter(theta)
        one = np.ones_like(g)[..., None]
        d_u_d_parameter = np.concatenate([cos_phi[..., None] * by_lens, one, 0 * one, 0 * one], -1)
        d_v_d_parameter = np.concatenate(
            [self.aspect * sin_phi[..., None] * by_lens, 0 * one, one, (r * sin_phi)[..., None]], -1
        )
        pixels = np.stack([self.centre[0] + r * cos_phi, self.centre[1] + self.aspect * r * sin_phi], -1)
        outside = ~inside
        jacobians = ProjectionJacobians(
            pixels, np.stack([d_u, self.aspect * d_v], -2), np.stack([d_u_d_parameter, d_v_d_parameter], -2)
        )
        for array in jacobians:
            array[outside] = np.nan
        return jacobians

    def pixels_per_radian(self, rays: ArrayLike) -> FloatArray:
        """Pixels that a radian spans at rays (..., 3): the smaller of the radial (r') and tangential (r/sin theta)."""
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        with np.errstate(invalid="ignore", divide="ignore"):
            tangential = np.where(theta > 1e-9, self.lens.radius(theta) / np.sin(theta), self.lens.slope(0.0))
        return np.minimum(self.lens.slope(theta), tangential)

    def scaled(self, factor: float) -> Self:
        """The camera of the same picture resampled to `factor` times its sides.

        The centre c becomes (c + 0.5) factor - 0.5, lengths grow by the factor, and the sides are rounded to whole
        pixels.  Legitimate for every picture that holds the whole of the calibrated one at another size, resized or
        binned, with its proportions kept.  A camera's other formats are often cut before they are scaled (video,
        16:9): say `cropped` first, or calibrate anew.  Focus and zoom change the lens itself.

        Raises
        ------
        CameraError
            If the factor is not a positive number, or no pixel is left or too many are.
        """
        if not (math.isfinite(factor) and factor > 0):
            raise CameraError(f"camera: a picture cannot be scaled by {factor}; the factor is a number above 0")
        width, height = (round(side * factor) for side in self.size)
        if min(width, height) < 1:
            raise CameraError(f"camera: scaled by {factor:g}, {self.size[0]} x {self.size[1]} pixels leave none")
        u0, v0 = self.centre
        return dataclasses.replace(
            self,
            lens=self.lens.scaled(factor),
            size=(width, height),
            centre=((u0 + 0.5) * factor - 0.5, (v0 + 0.5) * factor - 0.5),
        )

    def cropped(self, left: int, top: int, width: int, height: int) -> Self:
        """The camera of the rectangle of the picture that starts at pixel (left, top).

        The rectangle may reach past the picture's border, as one does that was padded, but has to share a pixel with
        it.  Legitimate where pixels were cut off or added and none resampled.  The field of view stays what it was:
        what lies outside the rectangle is the caller's question, as in `project`.

        Raises
        ------
        CameraError
            If a number is not whole, or the rectangle is empty or beside the picture.
        """
        for number in (left, top, width, height):
            if not (math.isfinite(number) and number == int(number)):
                raise CameraError(f"camera: a crop is of whole pixels; {number} is not a whole number")
        across, down = self.size
        if not (width > 0 and height > 0 and -width < left < across and -height < top < down):
            raise CameraError(
                f"camera: a crop of {width} x {height} pixels from ({left}, {top}) on has none in common with the "
                f"picture of {across} x {down}"
            )
        u0, v0 = self.centre
        return dataclasses.replace(self, size=(int(width), int(height)), centre=(u0 - left, v0 - top))
