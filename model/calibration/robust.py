"""A fit that wrong points and wrong views do not spoil, and that names them.

Good corners go through ordinary least squares with nothing taken away.  A point further off than six standard
deviations of the points used (three in 10^8 of normal errors) is rejected, the rest solved again, and every point
judged anew, until nothing changes.  Where least squares itself is spoilt, the start is sought again by medians over
points and views (which bear almost half of them wrong), and the same judging goes on from there.

From one view the aspect of the pixels cannot be told from an inexact target.  Sensors have square pixels, so there they
are taken as square unless they deviate by ten standard deviations.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fullsphere.model.calibration.bow import bow_shapes
from fullsphere.model.calibration.initial import Start, find_starts
from fullsphere.model.calibration.points import LeftOut, Sightings, View
from fullsphere.model.calibration.reduction import POSE, inverse_factor
from fullsphere.model.calibration.solve import Solution, solve
from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray, Lens
from fullsphere.model.radial import angle_of_radius

_SQUARE = 10.0  # standard deviations from 1 that an aspect seen in one view needs
_REJECT = 6.0  # standard deviations of a coordinate
_SPOILT = 3.0  # times the deviation that the median tells: heavy tails of real corners reach 2
_RAYLEIGH_MEDIAN = math.sqrt(2 * math.log(2))  # median distance over the deviation of a coordinate
_ROUNDS = 20
_MOST = 0.5  # of a view's points, or of all views, must agree with the others
_LEAST_POINTS = 6
_NEIGHBOURS = 9  # in angle from the axis, over all views
_EXACT_PX = 1e-6  # errors of this size are rounding, not noise


class Fit(NamedTuple):
    """A solution, and what took part in it.

    `residuals` (N, 2) px, `rays` (N, 3) in the camera frames and `used` (N,) belong to all points of `views`, those
    rejected too (residual NaN where the lens does not image the point); `left_out` are the views not in `views`;
    `free` names the camera's values that were solved for.
    """

    views: tuple[View, ...]
    sightings: Sightings
    solution: Solution
    residuals: FloatArray
    rays: FloatArray
    used: NDArray[np.bool_]
    left_out: tuple[LeftOut, ...]
    free: tuple[str, ...]

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate: the residuals used over their degrees of freedom."""
        unknowns = len(self.free) + POSE * len(self.views) + self.solution.bow.size
        return math.sqrt(float(np.sum(self.residuals[self.used] ** 2)) / (2 * np.count_nonzero(self.used) - unknowns))


def robust_fit(
    views: Sequence[View],
    size: tuple[int, int],
    kind: type[Lens],
    *,
    centre: tuple[float, float] | None = None,
    bow: bool = False,
    reject: bool = True,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Fit:
    """The camera and poses that the points agree on; the parameters are those of `calibrate`.

    Raises
    ------
    GeometryError
        If there is no such camera, or fewer than half of the points and views agree on it.
    """
    how = _How(bow)
    fit = _agreed(tuple(views), size, kind, centre, how, reject, progress)
    if len(fit.views) == 1 and _may_be_square(fit):
        camera = dataclasses.replace(fit.solution.camera, aspect=1.0)
        start, how = Start(camera, fit.solution.poses, 0.0, fit.used), how._replace(aspect=False)
        square = _fit(fit.views, fit.sightings, fit.used, start, how)._replace(left_out=fit.left_out)
        return _judged(square, how) if reject else square
    return fit


class _How(NamedTuple):
    """What is solved for besides lens, centre and poses."""

    bow: bool
    aspect: bool = True


def _agreed(
    views: tuple[View, ...],
    size: tuple[int, int],
    kind: type[Lens],
    centre: tuple[float, float] | None,
    how: _How,
    reject: bool,
    progress: Callable[[Iterable[Any]], Iterable[Any]],
) -> Fit:
    """The fit to all points, or if `reject` to those that agree."""
    sightings = Sightings.of(views)
    fault: GeometryError | None = None
    try:
        starts = find_starts(sightings, size, kind, centre, progress)
        fit = _best(views, sightings, np.ones(sightings.count, bool), starts, how)
        if not reject:
            return fit
        if not _spoilt(fit):
            return _judged(fit, how)
    except GeometryError as error:
        if not reject:
            raise
        fault = error
    try:
        starts = find_starts(sightings, size, kind, centre, progress, robust=True)
        where = "where the camera that the others agree on shows them"
        kept, left_out = _agreeing_views(views, sightings.split(starts[0].agreeing), where)
        return _judged(_of_views(views, kept, starts, how)._replace(left_out=left_out), how)
    except GeometryError as error:
        raise fault or error from error


def _may_be_square(fit: Fit) -> bool:
    """Whether the aspect is 1 within the errors of a target that is not exactly known."""
    spread = float(np.linalg.norm(inverse_factor(fit.solution.triangle)[-1])) * fit.sigma_px
    return abs(fit.solution.camera.aspect - 1) < _SQUARE * spread


def _best(
    views: tuple[View, ...], sightings: Sightings, used: NDArray[np.bool_], starts: Sequence[Start], how: _How
) -> Fit:
    """The fit to the points used with the least error, from whichever start; the first's fault if none converges."""
    fits, faults = [], []
    for start in starts:
        try:
            fits.append(_fit(views, sightings, used, start, how))
        except GeometryError as fault:
            faults.append(fault)
    if not fits:
        raise faults[0]
    return min(fits, key=lambda fit: fit.solution.rms_px)


def _fit(views: tuple[View, ...], sightings: Sightings, used: NDArray[np.bool_], start: Start, how: _How) -> Fit:
    shapes = bow_shapes(sightings.points) if how.bow else None
    free = start.camera.parameter_names if how.aspect else start.camera.parameter_names[:-1]
    chosen = shapes[used] if shapes is not None else None
    solution = solve(sightings.only(used), start.camera, start.poses, free, chosen)
    rays = sightings.rays(solution.poses)
    if shapes is not None:
        along_z = solution.poses.camera_from_target[sightings.view, :, 2]
        rays = rays + along_z * (shapes @ solution.bow)[:, None]
    residuals = _reaching_far(solution.camera).project(rays) - sightings.pixels
    return Fit(views, sightings, solution, residuals, rays, used, (), free)


def _reaching_far(camera: Camera) -> Camera:
    """The camera with the field of view that its lens has in and around the picture: a tangent's radius has no end."""
    most = camera.lens.theta_max * (1 - 1e-6)
    radius = min(float(camera.lens.radius(most)), 2.0 * sum(camera.size))
    reached = float(angle_of_radius(camera.lens, np.array(radius), most))
    return dataclasses.replace(camera, half_fov=max(reached, camera.half_fov))


def _spoilt(fit: Fit) -> bool:
    """Whether the residuals are far from those of noise: many are small, and the others huge."""
    distance = np.hypot(*fit.residuals.T)
    typical = float(np.median(distance)) / _RAYLEIGH_MEDIAN
    return fit.sigma_px > max(_SPOILT * typical, _EXACT_PX)


def _judged(fit: Fit, how: _How) -> Fit:
    """The fit with what disagrees rejected, solved and judged again until nothing changes."""
    for _ in range(_ROUNDS):
        reach = _REJECT * max(fit.sigma_px, _EXACT_PX)
        agrees = _near(fit, reach)
        if (agrees == fit.used).all():
            break
        where = f"within {reach:.2g} px of where the camera that the others agree on shows them"
        kept, left_out = _agreeing_views(fit.views, fit.sightings.split(agrees), where)
        start = Start(fit.solution.camera, fit.solution.poses, 0.0, agrees)
        fit = _of_views(fit.views, kept, [start], how)._replace(left_out=(*fit.left_out, *left_out))
    _check_majority(fit)
    return fit


def _near(fit: Fit, reach: float) -> NDArray[np.bool_]:
    """Which points (N,) lie within `reach` px of where they should, the lens's own misfit apart.

    Where a lens cannot follow the true one, all points at an angle from the axis are off together.  That is no fault of
    the points, and to reject them would hide it: the median radial error at the angle is taken off before judging.
    """
    near = np.asarray(np.hypot(*fit.residuals.T) <= reach)  # NaN is not
    imaged = np.isfinite(fit.residuals).all(1)
    doubtful = np.flatnonzero(imaged & ~near)
    if doubtful.size and np.count_nonzero(imaged) > _NEIGHBOURS:
        across = np.hypot(fit.rays[:, 0], fit.rays[:, 1])
        outward = fit.rays[:, :2] / np.maximum(across, 1e-300)[:, None]
        radial = np.sum(fit.residuals * outward, 1)
        theta = np.arctan2(across, fit.rays[:, 2])[:, None]
        nearest = KDTree(theta[imaged]).query(theta[doubtful], _NEIGHBOURS)[1]
        usual = np.median(radial[imaged][nearest], axis=1)[:, None] * outward[doubtful]
        near[doubtful] = np.hypot(*(fit.residuals[doubtful] - usual).T) <= reach
    return near


def _agreeing_views(
    views: Sequence[View], agrees: Sequence[NDArray[np.bool_]], where: str
) -> tuple[list[int], tuple[LeftOut, ...]]:
    """The numbers of the views of which most points agree, and the others with their reason.

    Raises
    ------
    GeometryError
        If there is none.
    """
    kept, left_out = [], []
    for k, (view, good) in enumerate(zip(views, agrees, strict=True)):
        count = int(np.count_nonzero(good))
        if count >= max(_MOST * len(good), _LEAST_POINTS):
            kept.append(k)
        else:
            left_out.append(LeftOut(view.image, f"only {count} of its {len(good)} points are {where}"))
    if not kept:
        raise GeometryError(
            f"calibration: no view has points enough that agree with the others; {left_out[0].image}: "
            f"{left_out[0].reason}. Check that the points belong to these pictures"
        )
    return kept, tuple(left_out)


def _of_views(views: Sequence[View], kept: Sequence[int], starts: Sequence[Start], how: _How) -> Fit:
    """The best fit of the views with the numbers `kept` to their points that agree with the starts."""
    every = Sightings.of(views)
    rows = np.isin(every.view, kept)
    fewer = tuple(views[k] for k in kept)
    used = starts[0].agreeing[rows]
    return _best(fewer, Sightings.of(fewer), used, [s._replace(poses=s.poses.only(kept)) for s in starts], how)


def _check_majority(fit: Fit) -> None:
    views = len(fit.views) + len(fit.left_out)
    points = int(np.count_nonzero(fit.used))
    if len(fit.views) < _MOST * views or points < _MOST * fit.used.size:
        raise GeometryError(
            f"calibration: only {points} of {fit.used.size} points in {len(fit.views)} of {views} views agree on one "
            f"{fit.solution.camera.lens.projection} lens; check rows, units and picture size, or try another lens"
        )
