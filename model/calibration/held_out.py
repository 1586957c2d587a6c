"""Errors of a lens on points that its fit never saw, point by point, the same points for every lens.

Several views are dealt into folds, every k-th view into the same one.  Each fold is predicted by a camera fitted to
the others: lens, centre and aspect are fixed and only the poses of the held-out views are found, because a new
picture always has a pose of its own.  One view alone is cut into two random halves of its points, and each is
predicted by camera *and* pose of the other.

A fold's fit starts from the fit to all views: the start decides the basin alone, not where in it the fit ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.bow import bow_shapes
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.linear_pose import linear_poses
from fullsphere.model.calibration.observed import reaching
from fullsphere.model.calibration.points import Poses, Sightings, View
from fullsphere.model.calibration.solve import descend, solve
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray

_FEWEST = 6  # points of a view that fix its pose, on any target
_SOUND = 2.0  # times the least sigma: a lens with more has no say in which points are wrong
_RINGS, _SECTORS = 3, 8  # blocks that one view is cut into


class Judged(NamedTuple):
    """The points that all lenses are judged by.

    `views`, with rejected points taken out, and the `given` ones that they come from; `fold` (N,) in which a point is
    held out; `unit` (N,) of points whose errors belong together when chance is judged: their view, or a block of it
    where views are few; `by_point`, whether points of one view are held out instead of views.
    """

    views: tuple[View, ...]
    given: tuple[View, ...]
    fold: NDArray[np.intp]
    unit: NDArray[np.intp]
    by_point: bool

    @property
    def described(self) -> str:
        """How points are held out, in words."""
        folds = int(self.fold.max()) + 1
        if self.by_point:
            return f"either half of the {len(self.fold)} points of one view predicted by the other"
        if folds == len(self.views):
            return f"each of {folds} views predicted by the others"
        return f"{len(self.views)} views in {folds} folds, each predicted by the others"


def judged_points(views: Sequence[View], calibrations: Sequence[Calibration], folds: int) -> Judged:
    """Choose the points, and deal them.

    A lens must not look better by rejecting what it cannot follow.  So a point is left out only where every sound lens
    rejects it, one whose sigma is at most twice the least; a point that one lens misses and another explains counts.

    Raises
    ------
    GeometryError
        If no view keeps enough points.
    """
    least = min(calibration.sigma_px for calibration in calibrations)
    kept = [np.zeros(len(view.pixels), bool) for view in views]
    for calibration in calibrations:
        if calibration.sigma_px <= _SOUND * least:
            numbered = enumerate(views)  # those of a calibration are a part of these, in their order
            for view, used in zip(calibration.views, calibration.used, strict=True):
                kept[next(number for number, given in numbered if given is view)] |= used
    enough = [number for number, good in enumerate(kept) if np.count_nonzero(good) >= _FEWEST]
    given = tuple(views[number] for number in enough)
    chosen = tuple(
        View(view.image, view.points_on_target[kept[number]], view.pixels[kept[number]])
        for view, number in zip(given, enough, strict=True)
    )
    if not chosen or (len(chosen) == 1 and len(chosen[0].pixels) < 2 * _FEWEST):
        raise GeometryError(f"selection: lenses are compared by points held out, and {2 * _FEWEST} or more are needed")
    counts = [len(view.pixels) for view in chosen]
    owner = np.repeat(np.arange(len(chosen)), counts)
    if len(chosen) == 1:
        halves = np.random.default_rng(0).permutation(np.arange(counts[0]) % 2)
        return Judged(chosen, given, halves, _blocks(chosen[0].pixels), True)
    blocks = np.concatenate([_blocks(v.pixels) + k * _RINGS * _SECTORS for k, v in enumerate(chosen)])
    return Judged(chosen, given, owner % min(folds, len(chosen)), owner if len(chosen) >= folds else blocks, False)


def held_out_residuals(judged: Judged, calibration: Calibration) -> FloatArray:
    """Residuals (N, 2) of the judged points, each predicted by a fit that it took no part in.

    Raises
    ------
    GeometryError
        If a fold's fit does not converge, or its lens does not reach the points held out.
    """
    whole = Sightings.of(judged.views)
    shapes = np.zeros((whole.count, 0)) if calibration.bow_mm is None else bow_shapes(whole.points)
    poses = _poses(judged.given, whole, calibration)
    residuals = np.empty((whole.count, 2))
    for fold in range(int(judged.fold.max()) + 1):
        out = judged.fold == fold
        fitted, train = _only(whole, ~out)
        solution = solve(fitted, calibration.camera, poses.only(train), shapes=shapes[~out])
        points = whole.points + np.concatenate([np.zeros((whole.count, 2)), (shapes @ solution.bow)[:, None]], axis=1)
        predicted, test = _only(Sightings(whole.images, points, whole.pixels, whole.view), out)
        if judged.by_point:
            residuals[out] = _predicted(predicted, solution.camera, solution.poses)
        else:
            residuals[out] = descend(predicted, solution.camera, poses.only(test), free=()).residuals
    return residuals


def _predicted(sightings: Sightings, camera: Camera, poses: Poses) -> FloatArray:
    rays = sightings.rays(poses)
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    try:
        return reaching(camera, theta).project(rays) - sightings.pixels
    except CameraError as error:
        raise GeometryError(f"points stand outside the domain of the lens: {error}") from error


def _poses(views: tuple[View, ...], sightings: Sightings, calibration: Calibration) -> Poses:
    """The calibration's poses of the views; from rays for a view that it left out."""
    found = {id(view): k for k, view in enumerate(calibration.views)}
    if all(id(view) in found for view in views):
        return calibration.poses.only([found[id(view)] for view in views])
    fresh, known = linear_poses(sightings, calibration.camera), calibration.poses
    turns, shifts = fresh.camera_from_target.copy(), fresh.translation.copy()
    for k, view in enumerate(views):
        if id(view) in found:
            turns[k], shifts[k] = known.camera_from_target[found[id(view)]], known.translation[found[id(view)]]
    return Poses(turns, shifts)


def _only(sightings: Sightings, rows: NDArray[np.bool_]) -> tuple[Sightings, list[int]]:
    """The points of the rows, with those views alone that have any, and the numbers of these."""
    numbers, view = np.unique(sightings.view[rows], return_inverse=True)
    images = tuple(sightings.images[k] for k in numbers)
    return Sightings(images, sightings.points[rows], sightings.pixels[rows], view.reshape(-1)), numbers.tolist()


def _blocks(pixels: FloatArray) -> NDArray[np.intp]:
    """Numbers (n,) of blocks of neighbouring points: rings of as many points, cut into sectors."""
    away = pixels - pixels.mean(0)
    radius, turn = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0])
    ring = np.searchsorted(np.quantile(radius, np.arange(1, _RINGS) / _RINGS), radius)
    sector = np.minimum(((turn / (2 * np.pi) + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    return np.asarray(ring * _SECTORS + sector)
