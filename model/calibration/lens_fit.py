"""A lens of a given kind near to a measured radial curve: a start for the descent, whatever the kind's parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray, Lens, Parameter

_FAR = 0.01  # of the outermost radius: an rms misfit of a lens that is no start yet
_NOT_QUITE = 0.97  # of a lens's domain: nearer to its end a curve is too steep to be fitted
_FOLLOWED = 5  # lenses of the grid that a descent starts from
_STEPS = 40  # of a descent on a curve
_POSITIVE = (1.05, 1.15, 1.3, 1.6, 2.0, 3.0, 5.0, 9.0)  # grid for a lens parameter without an upper bound


def fitted_lenses(kind: type[Lens], theta: FloatArray, radius: FloatArray) -> list[Lens]:
    """Lenses of one kind near to radii (n,) in pixels at angles theta (n,), to start from: the nearest first.

    There is more than one where a parameter's interval has values of either sign: the error may have a minimum on
    both sides of zero, and no descent crosses from one to the other.

    Raises
    ------
    GeometryError
        If no lens of the kind images the largest of the angles.
    """
    near: dict[tuple[bool, ...], list[tuple[float, Lens]]] = {}
    for ratios in _ratios(kind):
        lens = _with_best_lengths(kind, ratios, theta, radius)
        if lens is not None and lens.theta_max > theta.max():
            near.setdefault(tuple(ratio < 0 for ratio in ratios), []).append((_misfit(lens, theta, radius), lens))
    found = sorted((_nearest(lenses, theta, radius) for lenses in near.values()), key=lambda item: item[0])
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


def _nearest(lenses: list[tuple[float, Lens]], theta: FloatArray, radius: FloatArray) -> tuple[float, Lens]:
    """Where the descent from the nearest few of the lenses (misfit, lens) ends best: the error has many valleys."""
    few = sorted(lenses, key=lambda item: item[0])[:_FOLLOWED]
    ends = [_followed(lens, theta, radius) for _, lens in few]
    return min(((_misfit(lens, theta, radius), lens) for lens in ends), key=lambda item: item[0])


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
        ended = misfit - reached < 1e-4 * misfit
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
