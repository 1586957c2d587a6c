"""Calibration from known points: measurements -> camera, with what is known about its errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.linear_pose import linear_poses
from fullsphere.model.calibration.observability import weakest
from fullsphere.model.calibration.points import LeftOut, Poses, Sightings, View
from fullsphere.model.calibration.reduction import inverse_factor
from fullsphere.model.calibration.robust import Fit, robust_fit
from fullsphere.model.calibration.solve import descend
from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle, within_circle
from fullsphere.model.errors import GeometryError, UsageError
from fullsphere.model.lens import LENSES, FloatArray, Lens, angle_of_radius

Progress = Callable[[Iterable[Any]], Iterable[Any]]
"""Wraps an iterable and shows how far it has come."""

_HOPELESS = 0.02  # rms as a share of the picture's longer side: wrong points, or a lens of another kind
_UNDETERMINED = 0.05  # sigma of r at the outermost point as a share of r: the lens is not observable


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """A camera found from known points, and how well.

    Attributes
    ----------
    camera
        Lens, centre, aspect and field of view.
    views
        The views of the target, V of them, without those left out.
    poses
        `camera_from_target` (V, 3, 3) and `translation` (V, 3), in the target's unit.
    residuals_px
        Predicted minus observed, one (n, 2) array per view, rejected points too; NaN where the lens
        images none.
    used
        One boolean array (n,) per view: false for the points that were rejected.
    left_out
        Views that had to be left out altogether, with the reason.
    sigma_px
        Standard deviation of a coordinate: sqrt(squared residuals / degrees of freedom), points used.
    bow_mm
        How far the middle of the board stands off the plane of its edges along its x and along its y axis, towards
        +z, mm; None where it was taken as flat.
    observed_theta_deg
        Smallest and largest angle from the axis at which a point was seen; beyond, the curve is extrapolated.
    covariance_factor
        (P, F) matrix F with covariance = F F^T of `camera.parameter_names`, poses marginalised, scaled by the residual
        variance (degrees of freedom counted).  Errors of anything that follows from the camera are `norm(J @ F)` by
        row: the four values of a Bakstein-Pajdla lens are nearly interchangeable, and J @ covariance @ J^T loses
        every digit.
    """

    camera: Camera
    views: tuple[View, ...]
    poses: Poses
    residuals_px: tuple[FloatArray, ...]
    used: tuple[NDArray[np.bool_], ...]
    left_out: tuple[LeftOut, ...]
    observed_theta_deg: tuple[float, float]
    covariance_factor: FloatArray
    sigma_px: float
    bow_mm: tuple[float, float] | None = None

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the views."""
        return tuple(view.image for view in self.views)

    @property
    def covariance(self) -> FloatArray:
        """(P, P) in the order of `camera.parameter_names`; for a curve's errors use `covariance_factor`."""
        covariance: FloatArray = self.covariance_factor @ self.covariance_factor.T
        return covariance

    def within(self, circle: ImageCircle | None) -> Calibration:
        """The calibration with the camera's field of view ended at the image circle, where it reached further."""
        return dataclasses.replace(self, camera=within_circle(self.camera, circle))

    @property
    def rms_px(self) -> float:
        """sqrt(mean(du^2 + dv^2)) over the points used."""
        return _rms(np.concatenate(self.residuals_px)[np.concatenate(self.used)])

    @property
    def rms_with_rejected_px(self) -> float:
        """The same over all points of the views, those rejected too if the lens images them at all."""
        residuals = np.concatenate(self.residuals_px)
        return _rms(residuals[np.isfinite(residuals).all(1)])

    @property
    def points(self) -> int:
        """Number of points used, over all views."""
        return int(sum(map(np.count_nonzero, self.used)))

    @property
    def rejected(self) -> int:
        """Number of points of the views that were not used."""
        return sum(map(len, self.used)) - self.points


@dataclasses.dataclass(frozen=True, eq=False)
class Curve:
    """r(theta) sampled: angles (n,) in degrees, radii and their standard deviations (n,) in pixels."""

    theta_deg: FloatArray
    r_px: FloatArray
    sigma_px: FloatArray


def calibrate(
    views: Sequence[View],
    image_size: tuple[int, int],
    lens: str | type[Lens] = "bakstein-pajdla",
    *,
    half_fov: float | None = None,
    centre: tuple[float, float] | None = None,
    bow: bool = False,
    reject: bool = True,
    progress: Progress = iter,
) -> Calibration:
    """Calibrate a camera from one or several views of one rigid target.

    Points more than six standard deviations from where the camera sees them take no part, nor do views of which fewer
    than half the points agree with the others: both are named in the result.  From a single view pixels are taken as
    square unless their aspect deviates from 1 by ten standard deviations.

    Parameters
    ----------
    views
        Where each picture shows the known points.
    image_size
        Width and height of the pictures in pixels.
    lens
        Kind of lens, by class or by its name in files.
    half_fov
        Field of view of the resulting camera in radians from the axis.  Without it: to the largest circle round the
        centre that fits the picture, or the outermost point where that is further; and only to the outermost point
        where the fitted curve does not grow as far as that circle.
    centre
        A candidate for the image centre, as of a visible image circle; it may be wrong.
    bow
        Whether the board, flat but for that, may be bowed; see the module `bow`.
    reject
        Whether wrong points and views are rejected; False is plain least squares over everything.
    progress
        Wraps the starts that are tried.

    Raises
    ------
    GeometryError
        If the points do not determine the camera: too few, on a line, not what the pictures show, not convergent.
    UsageError
        If there is no such lens.
    CameraError
        If `image_size` or `half_fov` make no camera.
    """
    kind = _kind(lens)
    _check_inside(Sightings.of(views), image_size)
    fit = robust_fit(views, image_size, kind, centre=centre, bow=bow, reject=reject, progress=progress)
    _check_fit(fit)
    calibration = _described(fit, half_fov)
    _check_determined(calibration, fit)
    return calibration


def curve_of(calibration: Calibration) -> Curve:
    """The lens's curve in whole degrees over the field of view, with the uncertainty that the covariance gives it."""
    theta_deg = np.arange(math.floor(math.degrees(calibration.camera.half_fov) + 1e-9) + 1.0)
    radius = calibration.camera.lens.radius(np.radians(theta_deg))
    return Curve(theta_deg, radius, _sigma_of_radius(calibration, np.radians(theta_deg)))


def locate(views: Sequence[View], camera: Camera) -> tuple[Poses, tuple[FloatArray, ...]]:
    """Where the target stands in each view before a known camera: the poses of least squared error, camera fixed.

    Returns
    -------
    The poses, and predicted minus observed pixels, one (n, 2) array per view.

    Raises
    ------
    GeometryError
        If the camera cannot see the points where the pictures show them.
    """
    sightings = Sightings.of(views)
    solution = descend(sightings, camera, linear_poses(sightings, camera), free=())
    return solution.poses, sightings.split(solution.residuals)


def _sigma_of_radius(calibration: Calibration, theta: FloatArray) -> FloatArray:
    by_parameter = calibration.camera.lens.radius_by_parameter(theta)
    sigma: FloatArray = np.linalg.norm(by_parameter @ calibration.covariance_factor[: by_parameter.shape[-1]], axis=-1)
    return sigma


def _rms(residuals: FloatArray) -> float:
    return math.sqrt(float(np.mean(np.sum(residuals**2, -1))))


def _kind(lens: str | type[Lens]) -> type[Lens]:
    if not isinstance(lens, str):
        return lens
    if lens not in LENSES:
        raise UsageError(f"there is no lens {lens!r}; the lenses are {', '.join(LENSES)}")
    return LENSES[lens]


def _described(fit: Fit, half_fov: float | None) -> Calibration:
    solution = fit.solution
    rays = fit.rays[fit.used]
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    lowest, highest = float(theta.min()), float(theta.max())
    chosen = _field_of_view(solution.camera, highest) if half_fov is None else half_fov
    return Calibration(
        dataclasses.replace(solution.camera, half_fov=chosen),
        fit.views,
        solution.poses,
        fit.sightings.split(fit.residuals),
        fit.sightings.split(fit.used),
        fit.left_out,
        (math.degrees(lowest), math.degrees(highest)),
        _factor(fit),
        fit.sigma_px,
        (float(solution.bow[0]), float(solution.bow[1])) if solution.bow.size else None,
    )


def _factor(fit: Fit) -> FloatArray:
    """The covariance factor; a value that was not solved for is certain."""
    names = fit.solution.camera.parameter_names
    factor = np.zeros((len(names), len(fit.free)))
    factor[[names.index(name) for name in fit.free]] = inverse_factor(fit.solution.triangle) * fit.sigma_px
    return factor


def _field_of_view(camera: Camera, observed: float) -> float:
    """Half the field of view that the picture and the points speak for; see `calibrate`."""
    (width, height), (u0, v0) = camera.size, camera.centre
    rim = min(u0, width - 1 - u0, v0 / camera.aspect, (height - 1 - v0) / camera.aspect) + 0.5
    if rim <= float(camera.lens.radius(observed)):
        return observed
    reached = float(angle_of_radius(camera.lens, rim, camera.lens.theta_max * (1 - 1e-6)))
    return observed if math.isnan(reached) else max(observed, reached)


def _check_inside(sightings: Sightings, image_size: tuple[int, int]) -> None:
    outside = np.any((sightings.pixels < -0.5) | (sightings.pixels > np.array(image_size) - 0.5), axis=1)
    if outside.any():
        first = int(np.flatnonzero(outside)[0])
        u, v = sightings.pixels[first]
        raise GeometryError(
            f"{sightings.images[sightings.view[first]]}: the point at ({u:g}, {v:g}) lies outside the picture of "
            f"{image_size[0]} x {image_size[1]} pixels; check the image size"
        )


def _check_fit(fit: Fit) -> None:
    solution = fit.solution
    if solution.rms_px > _HOPELESS * max(solution.camera.size):
        distance = np.where(fit.used, np.hypot(*fit.residuals.T), 0.0)
        worst = int(np.argmax(distance))
        u, v = fit.sightings.pixels[worst]
        raise GeometryError(
            f"calibration: the best {solution.camera.lens.projection} lens leaves rms {solution.rms_px:.3g} px (median "
            f"{np.median(distance):.3g}, worst {distance[worst]:.3g} at ({u:.0f}, {v:.0f}) of "
            f"{fit.sightings.images[fit.sightings.view[worst]]}); remove wrong points, or try another lens"
        )


def _check_determined(calibration: Calibration, fit: Fit) -> None:
    outermost = math.radians(calibration.observed_theta_deg[1])
    radius = float(calibration.camera.lens.radius(outermost))
    sigma = float(_sigma_of_radius(calibration, np.array([outermost]))[0])
    if sigma > _UNDETERMINED * radius:
        worst = weakest(fit.solution.camera, fit.rays[fit.used], fit.sightings.view[fit.used])
        raise GeometryError(
            f"calibration: these points do not determine the lens: r({math.degrees(outermost):.0f} degrees) = "
            f"{radius:.0f} px comes out with a standard deviation of {sigma:.3g} px; {worst.text}"
        )
