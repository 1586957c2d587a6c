"""How every kind of lens would follow the measured curve: what is left over against theta (Figure 6 of the paper)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.calibration.observed import observed
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import LENSES, FloatArray, Lens

_SAMPLES = 200  # mean points along the curve that a lens is fitted to


@dataclasses.dataclass(frozen=True, eq=False)
class Misfit:
    """How a kind of lens misses the measured points.

    Attributes
    ----------
    lens
        Its name.
    theta
        (n,) angles of the points from the axis, radians.
    radial_px
        (n,) radius that the lens gives them minus the one measured.
    """

    lens: str
    theta: FloatArray
    radial_px: FloatArray

    @property
    def rms_px(self) -> float:
        """sqrt(mean(radial_px^2))."""
        return math.sqrt(float(np.mean(self.radial_px**2)))


def misfits_of_calibrations(calibrations: Mapping[str, Calibration]) -> tuple[Misfit, ...]:
    """What each of several calibrations of the same points leaves over along the radius, points used only."""
    points = {lens: observed(calibration) for lens, calibration in calibrations.items()}
    return tuple(Misfit(lens, seen.theta, seen.radial) for lens, seen in points.items())


def misfits_of_fitted_lenses(
    calibration: Calibration, kinds: Iterable[type[Lens]] = tuple(LENSES.values())
) -> tuple[Misfit, ...]:
    """What the calibrated lens and every other kind, fitted to the measured radii, leave over along the radius.

    Centre and poses stay those of the calibration, so another lens calibrated for itself would do a little better.
    Kinds that cannot image the outermost point are not among the answers.
    """
    points = observed(calibration)
    theta, radial = points.theta, points.radial
    own = calibration.camera.lens
    measured = own.radius(theta) - radial
    along, radius = _thinned(theta, measured)
    found = [Misfit(own.projection, theta, radial)]
    for kind in kinds:
        if kind is not type(own):
            lens = _nearest(kind, along, radius, float(theta.max()))
            if lens is not None:
                found.append(Misfit(kind.projection, theta, lens.radius(theta) - measured))
    return tuple(found)


def _thinned(theta: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of neighbours in theta, as many points each, the outermost point kept as it is."""
    order = np.argsort(theta, kind="stable")
    groups: list[NDArray[np.intp]] = [g for g in np.array_split(order[:-1], _SAMPLES) if g.size]
    groups.append(order[-1:])
    return np.array([theta[g].mean() for g in groups]), np.array([radius[g].mean() for g in groups])


def _nearest(kind: type[Lens], theta: FloatArray, radius: FloatArray, farthest: float) -> Lens | None:
    """The lens of a kind with the least squared error of the radii; None where no lens of it reaches so far."""
    try:
        starts = fitted_lenses(kind, theta, radius)
    except GeometryError:
        return None
    found = [_descended(start, theta, radius, farthest) for start in starts]
    return min(found, key=lambda lens: float(np.sum((lens.radius(theta) - radius) ** 2)))


def _descended(start: Lens, theta: FloatArray, radius: FloatArray, farthest: float) -> Lens:
    scale = np.array([abs(value) or 1.0 for value in start.values])
    hopeless = np.full(theta.shape, float(radius.max()))

    def errors(values: FloatArray) -> FloatArray:
        try:
            lens = start.with_values(values * scale)
        except CameraError:
            return hopeless
        return lens.radius(theta) - radius if lens.theta_max > farthest else hopeless

    found = least_squares(errors, np.array(start.values) / scale, x_scale="jac")
    return start.with_values(found.x * scale)
