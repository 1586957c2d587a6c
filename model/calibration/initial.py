"""Starting values for a calibration, from the measured points alone: no guess from the user.

1. For several centres and scales of an equidistant lens the pixels become rays, and the pose of every view follows
   linearly from x cross (R X + t) = 0, which never divides by z and so holds past 90 degrees.
2. The best few are refined with one well-behaved lens, r = f theta + g theta^3, and the best of them once more with
   odd powers up to the ninth, which every real lens follows closely.
3. The lens asked for is fitted to the radial curve that was found: its lengths linearly, its other parameters from a
   grid over their bounds, or from the axis outwards.  For r = a tan(theta/b) + c sin(theta/d) the grid keeps both terms
   alive; from the paper's own start, c = 0, the descent stalls.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.calibration.linear_pose import linear_poses
from fullsphere.model.calibration.points import Poses, Sightings
from fullsphere.model.calibration.solve import descend
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import Equidistant, FloatArray, KannalaBrandt, Lens, Parameter

_OUTERMOST_DEG = (8, 12, 17, 24, 33, 42, 52, 62, 72, 82, 92, 103, 115, 130)  # where the outermost point may stand
_KEPT = 3  # scales that are refined
_SAMPLE = 60  # points per view that the search looks at
_HOPELESS = 0.02  # of the picture's longer side: a median error that no lens explains


_NODES = 200  # of the curve that a lens is fitted to
_AGREE = 4.0  # times the median error: a point further off is left to be judged by a better camera
_NEAR_PX = 0.25  # a median error below this says how well the start's curve follows, not how good the points are


class Start(NamedTuple):
    """A camera and the poses of all views, to descend from; `error_px`, a median, ranks it among others.

    `agreeing` (N,) are the points that the camera explains; all of them unless wrong ones were reckoned with.
    """

    camera: Camera
    poses: Poses
    error_px: float
    agreeing: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class _Cubic(Lens):
    """r = f theta + g theta^3: follows every real lens to a few pixels, and its two values are well determined."""

    f: float
    g: float
    projection = "cubic"
    parameters = (Parameter("f", "f_px", 0.0, 1e7), Parameter("g", "g_px", -1e7, 1e7))

    @property
    def theta_max(self) -> float:
        return math.pi if self.g >= 0 else min(math.pi, math.sqrt(-self.f / (3 * self.g)))

    def radius(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        return self.f * t + self.g * t**3

    def slope(self, theta: ArrayLike) -> FloatArray:
        return self.f + 3 * self.g * np.asarray(theta, float) ** 2

    def radius_by_parameter(self, theta: ArrayLike) -> FloatArray:
        t = np.asarray(theta, float)
        return np.stack([t, t**3], -1)


def find_starts(
    sightings: Sightings,
    size: tuple[int, int],
    lens: type[Lens],
    centre: tuple[float, float] | None = None,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
    robust: bool = False,
) -> list[Start]:
    """The best start found for a lens of the given kind; several where the descent may end in several minima.

    Parameters
    ----------
    sightings
        The measured points, on any rigid target.
    size
        Width and height of the picture in pixels.
    lens
        The kind of lens asked for.
    centre
        Another candidate for the image centre (that of a visible image circle); the picture's centre is always tried.
    progress
        Wraps the candidates.
    robust
        Whether to reckon with wrong points, up to almost half of each view, and with wrong views.  Slower.

    Raises
    ------
    GeometryError
        If no candidate gives poses with the points before the camera, or the lens cannot image the angles needed.
    """
    sample = _sampled(sightings)
    centres = [((size[0] - 1) / 2, (size[1] - 1) / 2), *([centre] if centre is not None else [])]
    candidates = tuple(_candidates(sample, size, centres))
    tried = [_linear(sample, camera, robust) for camera in progress(candidates)]
    ranked = sorted(tried, key=lambda start: start.error_px)[:_KEPT]
    refined = [start for candidate in ranked if (start := _refined(sample, candidate, robust)) is not None]
    best = min(refined, key=lambda start: start.error_px, default=None)
    if best is None or best.error_px > _HOPELESS * max(size):
        raise GeometryError(
            "calibration: no camera was found that sees the points where the pictures show them. Check that rows, "
            "units and picture size belong together, and that the target's coordinates are not mirrored"
        )
    best = _closer(sample, best)
    best = best._replace(agreeing=_agreeing(sightings, best.camera, best.poses, robust))
    return [best._replace(camera=camera) for camera in _with_lenses(sightings, best, lens)]


def _sampled(sightings: Sightings) -> Sightings:
    """At most `_SAMPLE` points of each view, taken at random (always the same): every k-th might be one line."""
    rng = np.random.default_rng(0)
    chosen = np.zeros(sightings.count, bool)
    for places in sightings.split(np.arange(sightings.count)):
        chosen[places if len(places) <= _SAMPLE else rng.choice(places, _SAMPLE, replace=False)] = True
    return sightings.only(chosen)


def _candidates(sightings: Sightings, size: tuple[int, int], centres: list[tuple[float, float]]) -> Iterator[Camera]:
    for centre, outermost in itertools.product(centres, _OUTERMOST_DEG):
        r = float(np.max(np.hypot(*(sightings.pixels - centre).T)))
        if r > 0:
            yield Camera(Equidistant(r / math.radians(outermost)), size, centre, half_fov=math.pi)


def _linear(sightings: Sightings, camera: Camera, robust: bool) -> Start:
    poses = linear_poses(sightings, camera, robust)
    return _start(sightings, camera, poses, robust)


def _start(sightings: Sightings, camera: Camera, poses: Poses, robust: bool) -> Start:
    """Ranked by the mean over views of the median error: a few bad points decide nothing; nor, by a median, views."""
    by_view = sightings.median_by_view(_distances(sightings, camera, poses))
    error = float(np.median(by_view) if robust else np.mean(by_view))
    return Start(camera, poses, error, _agreeing(sightings, camera, poses, robust))


def _distances(sightings: Sightings, camera: Camera, poses: Poses) -> FloatArray:
    """Distance in pixels of each point; as far as the picture is wide where it cannot be seen."""
    distance = np.hypot(*(camera.project(sightings.rays(poses)) - sightings.pixels).T)
    seen: FloatArray = np.nan_to_num(distance, nan=float(max(camera.size)))
    return seen


def _agreeing(sightings: Sightings, camera: Camera, poses: Poses, robust: bool) -> NDArray[np.bool_]:
    """The points that take part (N,): all, or those about as near as the median of their view.

    A view whose median is far from that of the others takes no part.
    """
    if not robust:
        return np.ones(sightings.count, bool)
    distance = _distances(sightings, camera, poses)
    by_view = sightings.median_by_view(distance)
    by_view = np.maximum(by_view, _NEAR_PX)
    limit = np.where(by_view <= _AGREE * np.median(by_view), _AGREE * by_view, -1.0)
    return np.asarray(distance <= limit[sightings.view])


def _refined(sightings: Sightings, start: Start, robust: bool) -> Start | None:
    """The start after a descent with the cubic lens; views whose pose went astray are placed anew on the way."""
    try:
        camera, poses = _descended(sightings, start, ("f_px", "centre_u_px", "centre_v_px"), 12)
        camera = dataclasses.replace(camera, lens=_Cubic(float(camera.lens.slope(0.0)), 0.0), half_fov=math.pi)
        for iterations in (12, 25):
            poses = _better(sightings, camera, poses, robust)
            camera, poses = _descended(sightings, _start(sightings, camera, poses, robust), None, iterations)
            camera = dataclasses.replace(camera, half_fov=_whole(camera.lens))
    except (GeometryError, CameraError):
        return None
    return _start(sightings, camera, poses, robust)


def _whole(lens: Lens) -> float:
    return lens.theta_max * (1 - 1e-9)


def _closer(sightings: Sightings, start: Start) -> Start:
    """The start with a curve of odd powers up to the ninth, or as it is where that fails."""
    try:
        f, g = start.camera.lens.values
        camera = dataclasses.replace(start.camera, lens=KannalaBrandt(f, g / f, 0.0, 0.0, 0.0), half_fov=1e-3)
        camera, poses = _descended(sightings, start._replace(camera=camera), None, 25)
    except (GeometryError, CameraError):
        return start
    return start._replace(camera=camera, poses=poses)


def _descended(sightings: Sightings, start: Start, free: Sequence[str] | None, iterations: int) -> tuple[Camera, Poses]:
    """Where a descent over the agreeing points ends; views without any keep their poses."""
    kept = np.unique(sightings.view[start.agreeing])
    part = sightings.only(start.agreeing)
    reached = descend(part, start.camera, start.poses.only(kept), free, iterations)
    return reached.camera, start.poses.replaced(kept, reached.poses)


def _better(sightings: Sightings, camera: Camera, poses: Poses, robust: bool) -> Poses:
    """For each view the given pose or a fresh linear one, whichever shows the points nearer to their pixels."""
    fresh = linear_poses(sightings, camera, robust)
    errors = [sightings.median_by_view(_distances(sightings, camera, tried)) for tried in (fresh, poses)]
    wins = np.asarray(errors[0] < errors[1])
    return Poses(
        np.where(wins[:, None, None], fresh.camera_from_target, poses.camera_from_target),
        np.where(wins[:, None], fresh.translation, poses.translation),
    )


def _with_lenses(sightings: Sightings, start: Start, kind: type[Lens]) -> Iterator[Camera]:
    """The start's camera with lenses of the kind asked for, fitted to its curve where points are imaged."""
    part = sightings.only(start.agreeing)
    rays = part.rays(start.poses.only(np.unique(sightings.view[start.agreeing])))
    theta = np.sort(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]))
    nodes = theta[np.linspace(0, len(theta) - 1, min(len(theta), _NODES)).astype(np.intp)]
    for lens in fitted_lenses(kind, nodes, start.camera.lens.radius(nodes)):
        yield dataclasses.replace(start.camera, lens=lens, half_fov=min(float(nodes[-1]), _whole(lens)))
