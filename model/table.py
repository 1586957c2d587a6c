"""A camera tabulated: the forward table and the inverse lookup tables, with their measured error.

Of a radially symmetric lens only three functions of one variable are needed, each smooth through theta = 0 and 90
degrees, so that a pixel costs neither arctangent nor sine:

    forward   ray (x, y, z):           g(z) = r(theta)/sin(theta), z = cos(theta);   u = u0 + g x, v = v0 + aspect g y
    inverse   q = x'^2 + y'^2 = r^2:   s(q) = sin(theta)/r, c(q) = cos(theta);       ray = (s x', s y', c)

Where one of them is not smooth, another variable takes its place, at the price of a root: a root of q for the inverse
of an r(theta) that stops growing at the rim or has even powers of theta, and for the forward table of a lens that sees
further than 120 degrees from its axis

              w = cos(theta/2):            h(w) = r(theta)/(2 sin(theta/2));   u = u0 + h x/w, v = v0 + aspect h y/w
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import kernels
from fullsphere.model.camera import Camera
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.tabulation import forward_table, inverse_table

_ROUNDING = {np.dtype(np.float64): 1e-12, np.dtype(np.float32): 2e-7}  # past the rim in z, or of q, still inside
_PROBES = 20_000
_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


class _Pieces(NamedTuple):
    """The tables in one type, flat, as the kernels read them."""

    forward: NDArray[Any]
    inverse_s: NDArray[Any]
    inverse_c: NDArray[Any]


@dataclasses.dataclass(frozen=True)
class RayTable:
    """The fast twin of a Camera, a FastProjection; made by `tabulate`.

    Everything is computed in float64, unless the arrays that are given and those that are asked for are float32: then
    in float32 throughout, faster, with an error of `float32_error_px`.  The same numbers give the same bits however
    they are split into arrays.

    Attributes
    ----------
    camera
        The exact camera.
    error_px
        The largest difference from the exact camera that was measured, in pixels, of `project` and of `unproject`
        followed by the exact `project`, computed in float64.  Rays out of `unproject` are unit to the same accuracy.
    forward, forward_variable
        g over z in [cos(half_fov), 1] (PLAIN), or h over w in [cos(half_fov/2), 1] (HALF_ANGLE), as cubic pieces in
        Horner form (cells, 4).
    inverse_s, inverse_c, inverse_variable
        s and c over q in [0, image_radius^2], as pieces (cells, 4), the cells equal over q (PLAIN), or over a root of
        it counted FROM_AXIS or FROM_RIM.
    """

    camera: Camera
    error_px: float
    forward: FloatArray = dataclasses.field(repr=False)
    inverse_s: FloatArray = dataclasses.field(repr=False)
    inverse_c: FloatArray = dataclasses.field(repr=False)
    forward_variable: int = kernels.PLAIN
    inverse_variable: int = kernels.PLAIN

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        return self.camera.size

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (..., 3) -> pixels (..., 2) of `dtype` (float32 or float64), NaN outside the field of view.

        `rotation` (3, 3) takes the rays into the camera frame first, in the same pass.

        Rays have to be unit, as those of every `unproject` and `window_rays` are: unlike the exact camera the table
        does not divide by their length, and an error of it is an error of the pixel.  What is further from unit than
        5e-6 (zero, infinite and NaN too) is no direction and answered by NaN.
        """
        given, wanted = _checked(rays, 3, dtype)
        pixels = np.empty((*given.shape[:-1], 2), wanted)
        turn = np.eye(3) if rotation is None else np.asarray(rotation, float)
        if turn.shape != (3, 3):
            raise UsageError(f"a rotation is a matrix of shape (3, 3), not {turn.shape}")
        real = given.dtype.type
        half_angle = self.forward_variable == kernels.HALF_ANGLE
        start = math.cos(self.camera.half_fov / 2 if half_angle else self.camera.half_fov)
        kernel = kernels.project_rays_half_angle if half_angle else kernels.project_rays
        kernel(
            given.reshape(-1),
            turn.astype(real).reshape(-1),
            self._pieces(real).forward,
            real(start),
            real(start - _ROUNDING[given.dtype]),
            *self._placement(real),
            pixels.reshape(-1),
        )
        return pixels

    def unproject(self, pixels: ArrayLike, dtype: type = np.float64) -> NDArray[Any]:
        """Pixels (..., 2) -> unit rays (..., 3) of `dtype` (float32 or float64), NaN outside the field of view."""
        given, wanted = _checked(pixels, 2, dtype)
        rays = np.empty((*given.shape[:-1], 3), wanted)
        real = given.dtype.type
        kernels.unproject_pixels(given.reshape(-1), *self._inverse(real), *self._placement(real), rays.reshape(-1))
        return rays

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (rows, columns, 3) of `dtype` of a rectangle of whole pixels, NaN outside the field of view.

        The rectangle may reach past the picture's border: the lens goes on there.
        """
        real = _checked([0.0, 0.0], 2, dtype)[1].type
        u0, v0 = self.camera.centre
        x = np.arange(columns.start, columns.stop) - u0
        y = (np.arange(rows.start, rows.stop) - v0) / self.camera.aspect
        rays = np.empty((y.size, x.size, 3), real)
        kernels.unproject_grid(x.astype(real), y.astype(real), *self._inverse(real), rays)
        return rays

    @cached_property
    def float32_error_px(self) -> float:
        """The largest error of the float32 functions that was measured, in pixels: the twin of `error_px`.

        It holds the rounding of what is returned and of a rotation, but not of what is given: the same float32 rays of
        the field of view, and float32 pixels of the image circle, are put through the exact camera.
        """
        camera = self.camera
        share = np.sqrt((np.arange(_PROBES) + 0.5) / _PROBES)
        phi = _GOLDEN_ANGLE * np.arange(_PROBES)
        theta, r = share * camera.half_fov, share * camera.image_radius
        in_camera = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        from_centre = np.stack([r * np.cos(phi), camera.aspect * r * np.sin(phi)], -1)
        pixels = (from_centre + camera.centre).astype(np.float32)
        errors = [camera.project(self.unproject(pixels, np.float32)) - pixels]
        for turn in np.linalg.qr(np.cos(np.arange(1.0, 37.0)).reshape(4, 3, 3))[0]:  # any four frames
            rays = (in_camera @ turn).astype(np.float32)
            errors.append(self.project(rays, turn, np.float32) - camera.project(rays @ turn.T))
        return float(np.nanmax(np.linalg.norm(errors, axis=-1)))

    @cached_property
    def _float32_pieces(self) -> _Pieces:
        return _Pieces(*(piece.astype(np.float32) for piece in self._pieces(np.float64)))

    def _pieces(self, real: type) -> _Pieces:
        if real is np.float32:
            return self._float32_pieces
        return _Pieces(self.forward.reshape(-1), self.inverse_s.reshape(-1), self.inverse_c.reshape(-1))

    def _inverse(self, real: type) -> tuple[Any, Any, int, Any, Any]:
        """What the kernels want to know of the inverse tables, in one type."""
        pieces, q_max = self._pieces(real), self.camera.image_radius**2
        rounding = 2 * _ROUNDING[np.dtype(real)]
        return pieces.inverse_s, pieces.inverse_c, self.inverse_variable, real(q_max), real(q_max * (1 + rounding))

    def _placement(self, real: type) -> tuple[Any, Any, Any]:
        """The camera's centre and aspect in one type."""
        (u0, v0), aspect = self.camera.centre, self.camera.aspect
        return real(u0), real(v0), real(aspect)


def _checked(values: ArrayLike, last: int, dtype: type) -> tuple[NDArray[Any], np.dtype[Any]]:
    """Rays or pixels (..., last) as they will be computed with, and the type of the answer."""
    wanted = np.dtype(dtype)
    if wanted not in _ROUNDING:
        raise UsageError(f"rays and pixels are float32 or float64, not {wanted}")
    given = np.asarray(values)
    if given.shape[-1:] != (last,):
        raise UsageError(f"an array of {'rays' if last == 3 else 'pixels'} ends in {last} values, not {given.shape}")
    single = given.dtype == np.float32 and wanted == np.float32
    return np.ascontiguousarray(given, np.float32 if single else np.float64), wanted


def tabulate(camera: Camera, tolerance_px: float = 1e-8) -> RayTable:
    """Tabulate a camera, refining until the measured error is within `tolerance_px`.

    Lenses with odd r(theta), seen to 195 degrees (perspective to 150) on 4000 px, take 256 to 2048 cells to the 1e-8 px
    of the default.

    Raises
    ------
    ResourceError
        If 65536 cells do not reach the tolerance; the message says what was reached.
    UsageError
        If the tolerance is not a positive number.
    """
    if not tolerance_px > 0:
        raise UsageError(f"the tolerance of a table is more than 0 px, not {tolerance_px:g}")
    forward = forward_table(camera, tolerance_px)
    inverse = inverse_table(camera, tolerance_px)
    s, c = (np.ascontiguousarray(pieces) for pieces in np.hsplit(inverse.pieces, 2))
    return RayTable(
        camera, max(forward.error_px, inverse.error_px), forward.pieces, s, c, forward.variable, inverse.variable
    )
