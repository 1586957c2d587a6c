"""Starting values for a calibration, from the measured points alone: no guess from the user.

1. For several centres and scales of an equidistant lens the pixels become rays, and the pose of every view follows
   linearly from x cross (R X + t) = 0, which never divides by z and so holds past 90 degrees.
2. The best few are refined with one well-behaved lens, r = f theta + g theta^3.
3. The lens asked for is fitted to the radial curve that was found: its lengths linearly, its other parameters from a
   grid over their bounds, or from the axis outwards.  For r = a tan(theta/b) + c sin(theta/d) the grid keeps both terms
   alive; from the paper's own start, c = 0, the descent stalls.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.calibration.points import Poses, Sightings, is_flat
from fullsphere.model.calibration.solve import descend
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import Equidistant, FloatArray, Lens, Parameter

_OUTERMOST_DEG = (8, 12, 17, 24, 33, 42, 52, 62, 72, 82, 92, 103, 115, 130)  # where the outermost point may stand
_KEPT = 3  # scales that are refined
_SAMPLE = 60  # points per view that the search looks at
_HOPELESS = 0.02  # of the picture's longer side: a median error that no lens explains
_FAR = 0.01  # of the outermost radius: an rms misfit of a lens that is no start yet
_NOT_QUITE = 0.97  # of a lens's domain: nearer to its end a curve is too steep to be fitted
_STEPS = 60  # of a descent on a curve
_POSITIVE = (1.05, 1.15, 1.3, 1.6, 2.0, 3.0, 5.0, 9.0)  # grid for a lens parameter without an upper bound


class Start(NamedTuple):
    """A camera and the poses of all views, to descend from; `error_px`, a median, ranks it among others."""

    camera: Camera
    poses: Poses
    error_px: float


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

    Raises
    ------
    GeometryError
        If no candidate gives poses with the points before the camera, or the lens cannot image the angles needed.
    """
    sample = _sampled(sightings)
    centres = [((size[0] - 1) / 2, (size[1] - 1) / 2), *([centre] if centre is not None else [])]
    candidates = tuple(_candidates(sample, size, centres))
    ranked = sorted((_linear(sample, camera) for camera in progress(candidates)), key=lambda start: start.error_px)
    refined = [start for candidate in ranked[:_KEPT] if (start := _refined(sample, candidate)) is not None]
    best = min(refined, key=lambda start: start.error_px, default=None)
    if best is None or best.error_px > _HOPELESS * max(size):
        raise GeometryError(
            "calibration: no camera was found that sees the points where the pictures show them. Check that rows, "
            "units and picture size belong together, and that the target's coordinates are not mirrored"
        )
    return [best._replace(camera=camera) for camera in _with_lenses(sightings, best, lens)]


def linear_poses(sightings: Sightings, camera: Camera) -> Poses:
    """The pose of each view for a known camera, from rays: linear, so a start for `descend`, not its end."""
    rays = camera.unproject(sightings.pixels)
    found = [_pose(points, x) for points, x in zip(*map(sightings.split, (sightings.points, rays)), strict=True)]
    return Poses(np.array([rotation for rotation, _ in found]), np.array([translation for _, translation in found]))


def _sampled(sightings: Sightings) -> Sightings:
    """At most `_SAMPLE` points of each view, taken at random (always the same): every k-th might be one line."""
    rng = np.random.default_rng(0)
    rows: list[NDArray[np.intp]] = []
    for part in sightings.split(np.arange(sightings.count)):
        places = part.astype(np.intp)
        rows.append(places if len(places) <= _SAMPLE else np.sort(rng.choice(places, _SAMPLE, replace=False)))
    chosen = np.concatenate(rows)
    return Sightings(sightings.images, sightings.points[chosen], sightings.pixels[chosen], sightings.view[chosen])


def _candidates(sightings: Sightings, size: tuple[int, int], centres: list[tuple[float, float]]) -> Iterator[Camera]:
    for centre, outermost in itertools.product(centres, _OUTERMOST_DEG):
        r = float(np.max(np.hypot(*(sightings.pixels - centre).T)))
        if r > 0:
            yield Camera(Equidistant(r / math.radians(outermost)), size, centre, half_fov=math.pi)


def _linear(sightings: Sightings, camera: Camera) -> Start:
    """Linear poses, ranked by the mean over views of the median error: a few bad points or views decide nothing."""
    poses = linear_poses(sightings, camera)
    return Start(camera, poses, float(np.mean(_errors(sightings, camera, poses))))


def _errors(sightings: Sightings, camera: Camera, poses: Poses) -> FloatArray:
    """Median distance in pixels of each view; as far as the picture is wide where points cannot be seen."""
    distance = np.hypot(*(camera.project(sightings.rays(poses)) - sightings.pixels).T)
    return sightings.median_by_view(np.nan_to_num(distance, nan=float(max(camera.size))))


def _refined(sightings: Sightings, start: Start) -> Start | None:
    """The start after a descent with the cubic lens; views whose pose went astray are placed anew on the way."""
    try:
        first = descend(sightings, start.camera, start.poses, ("f_px", "centre_u_px", "centre_v_px"), 12)
        lens = first.camera.lens
        camera = dataclasses.replace(first.camera, lens=_Cubic(float(lens.slope(0.0)), 0.0), half_fov=math.pi)
        poses = first.poses
        for iterations in (12, 25):
            poses = _better(sightings, camera, poses)
            reached = descend(sightings, camera, poses, None, iterations)
            camera, poses = dataclasses.replace(reached.camera, half_fov=_whole(reached.camera.lens)), reached.poses
    except (GeometryError, CameraError):
        return None
    return Start(camera, poses, float(np.mean(_errors(sightings, camera, poses))))


def _whole(lens: Lens) -> float:
    return lens.theta_max * (1 - 1e-9)


def _better(sightings: Sightings, camera: Camera, poses: Poses) -> Poses:
    """For each view the given pose or a fresh linear one, whichever shows the points nearer to their pixels."""
    fresh = linear_poses(sightings, camera)
    wins = np.asarray(_errors(sightings, camera, fresh) < _errors(sightings, camera, poses))
    return Poses(
        np.where(wins[:, None, None], fresh.camera_from_target, poses.camera_from_target),
        np.where(wins[:, None], fresh.translation, poses.translation),
    )


def _pose(points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation with rays (n, 3) along R points + t; rays that are NaN do not count.

    Minimises the sum of |x cross (A y + t)|^2 over all 3 x 4 matrices [A t], y the points along the axes of their own
    spread; A is then replaced by the nearest rotation and t by the best for it.  Points on a plane have no third
    axis: two columns of A are found and the third is their cross product.
    """
    mean = points.mean(0)
    axes = np.linalg.svd(points - mean, full_matrices=False)[2]
    axes *= np.sign(np.linalg.det(axes))
    spread = (points - mean) @ axes.T
    unit = math.sqrt(float(np.mean(spread**2)))
    known = 2 if is_flat(points) else 3
    y = np.column_stack([spread[:, :known] / unit, np.ones(len(points))])
    seen = np.asarray(np.isfinite(rays).all(1))
    x = np.where(seen[:, None], rays, 0.0)
    across = seen[:, None, None] * np.eye(3) - x[:, :, None] * x[:, None, :]  # |x cross p|^2 = p . across p
    moments = across.reshape(-1, 9).T @ (y[:, :, None] * y[:, None, :]).reshape(len(y), -1)
    moments = moments.reshape(3, 3, known + 1, known + 1).transpose(0, 2, 1, 3).reshape(3 * known + 3, -1)
    form = np.linalg.eigh(moments)[1][:, 0].reshape(3, known + 1)
    if np.sum(x * (y @ form.T)) < 0:  # the points stand along their rays, not opposite
        form = -form
    rotation = _nearest_rotation(form[:, :known])
    turned = rotation[:, :known] @ y[:, :known].T
    translation = -np.linalg.lstsq(across.sum(0), np.einsum("nij,jn->i", across, turned), rcond=None)[0]
    whole = rotation @ axes
    return whole, translation * unit - whole @ mean


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a (3, 3) matrix, or nearest in its first two columns to a (3, 2) matrix."""
    u, _, vt = np.linalg.svd(matrix, full_matrices=False)
    if matrix.shape[1] == 2:
        first = u @ vt
        return np.column_stack([first, np.cross(first[:, 0], first[:, 1])])
    rotation: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rotation


def _with_lenses(sightings: Sightings, start: Start, kind: type[Lens]) -> Iterator[Camera]:
    """The start's camera with lenses of the kind asked for, fitted to the radii at which the points are imaged."""
    rays = sightings.rays(start.poses)
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    from_centre = (sightings.pixels - start.camera.centre) / [1.0, start.camera.aspect]
    for lens in fitted_lenses(kind, theta, np.hypot(*from_centre.T)):
        yield dataclasses.replace(start.camera, lens=lens, half_fov=min(float(theta.max()), _whole(lens)))


def fitted_lenses(kind: type[Lens], theta: FloatArray, radius: FloatArray) -> list[Lens]:
    """Lenses of one kind near to radii (n,) in pixels at angles theta (n,), to start from: the nearest first.

    There is more than one where a parameter's interval has values of either sign: the error may have a minimum on
    both sides of zero, and no descent crosses from one to the other.

    Raises
    ------
    GeometryError
        If no lens of the kind images the largest of the angles.
    """
    nearest: dict[tuple[bool, ...], tuple[float, Lens]] = {}
    for ratios in _ratios(kind):
        lens = _with_best_lengths(kind, ratios, theta, radius)
        if lens is not None and lens.theta_max > theta.max():
            signs, misfit = tuple(ratio < 0 for ratio in ratios), _misfit(lens, theta, radius)
            if signs not in nearest or misfit < nearest[signs][0]:
                nearest[signs] = misfit, lens
    found = sorted(nearest.values(), key=lambda item: item[0])
    if not found or found[0][0] > len(radius) * (_FAR * float(radius.max())) ** 2:
        grown = _grown(kind, theta, radius)
        if grown is not None and (not found or _misfit(grown, theta, radius) < found[0][0]):
            return [grown]
    if not found:
        raise GeometryError(
            f"calibration: the points reach {math.degrees(float(theta.max())):.0f} degrees from the axis, further than "
            f"a {kind.projection} lens can image them; choose a lens that sees further"
        )
    return [lens for _, lens in found]


def _misfit(lens: Lens, theta: FloatArray, radius: FloatArray) -> float:
    return float(np.sum((lens.radius(theta) - radius) ** 2))


def _grown(kind: type[Lens], theta: FloatArray, radius: FloatArray) -> Lens | None:
    """A lens fitted from the axis outwards, for kinds that reach the outer angles with the right values only.

    A polynomial without its higher terms may end before the outermost point; fitted to the points that it does
    reach, it bends, and reaches further ones.
    """
    best: Lens | None = None
    for ratios in _ratios(kind):
        lens = _with_best_lengths(kind, ratios, *_within(theta, radius, 0.5 * float(theta.max())))
        reached = -1
        while lens is not None:
            inner, outer = _within(theta, radius, _NOT_QUITE * lens.theta_max)
            if len(inner) in (reached, 0):
                break
            reached = len(inner)
            lens = _followed(lens, inner, outer)
        if lens is None or lens.theta_max <= theta.max():
            continue
        lens = _followed(lens, theta, radius)
        if best is None or _misfit(lens, theta, radius) < _misfit(best, theta, radius):
            best = lens
    return best


def _within(theta: FloatArray, radius: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    inside = theta <= limit
    return theta[inside], radius[inside]


def _followed(lens: Lens, theta: FloatArray, radius: FloatArray) -> Lens:
    """The lens after a descent over all its values towards radii (n,) at angles theta (n,)."""
    damping, misfit = 1e-3, _misfit(lens, theta, radius)
    for _ in range(_STEPS):
        slopes = lens.radius_by_parameter(theta)
        scale = np.linalg.norm(slopes, axis=0)
        scale[scale == 0] = 1.0
        rows = np.concatenate([slopes / scale, math.sqrt(damping) * np.eye(scale.size)])
        errors = np.concatenate([lens.radius(theta) - radius, np.zeros(scale.size)])
        step = np.linalg.lstsq(rows, -errors, rcond=None)[0] / scale
        try:
            trial = lens.with_values(np.array(lens.values) + step)
        except CameraError:
            trial = None
        reached = math.inf
        if trial is not None and trial.theta_max > theta.max():
            reached = _misfit(trial, theta, radius)
        if trial is None or not reached < misfit:
            damping *= 5
            continue
        ended = misfit - reached < 1e-6 * misfit
        lens, misfit, damping = trial, reached, damping / 5
        if ended:
            break
    return lens


def _ratios(kind: type[Lens]) -> Iterator[tuple[float, ...]]:
    """Every combination from the grids of the parameters that are no lengths."""
    return itertools.product(*(_grid(p) for p in kind.parameters if not p.is_length))


def _grid(parameter: Parameter) -> tuple[float, ...]:
    """Values to try, from the bounds alone: inside an interval, above zero, or zero where there is no bound."""
    if parameter.upper < 100:
        count = 7 if parameter.lower >= 0 else 8  # an even number of values about zero: as many of either sign
        return tuple(np.linspace(parameter.lower, parameter.upper, count)[1:-1].tolist())
    return _POSITIVE if parameter.lower >= 0 else (0.0,)


def _with_best_lengths(
    kind: type[Lens], ratios: tuple[float, ...], theta: FloatArray, radius: FloatArray
) -> Lens | None:
    """The lens with the given ratios whose lengths, which r(theta) is linear in, fit best; None where there is none."""
    is_length = [p.is_length for p in kind.parameters]
    values = np.ones(len(is_length))
    values[[not length for length in is_length]] = ratios
    build: Callable[..., Lens] = kind
    try:
        shapes = build(*values.tolist()).radius_by_parameter(theta)[:, is_length]
        if not np.isfinite(shapes).all():
            return None
        values[is_length] = np.linalg.lstsq(shapes, radius, rcond=1e-9)[0]
        return build(*values.tolist())
    except CameraError:
        return None
