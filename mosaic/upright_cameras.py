"""Up from how the cameras were held: people and tripods hold them level, upright or on their sides, and in rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray

_DIRECTIONS = 2000  # tried as up: some 3 degrees apart
_NOT_LEVEL = math.radians(8.0)  # hand-held: beyond a few times of this a frame tells little
_PITCH = math.radians(40.0)  # cameras look up and down, but around the horizon on average
_COST_OF_QUARTERS = (0.0, 1.2, 4.0, 1.2)  # held as stored, on the right side, upside down, on the left side
_COST_OF_DOWN_UP = 8.0  # of a frame whose lower edge would be the higher one
_NO_DIFFERENCE = 0.5  # of cost, for each frame that decides, between an up and its opposite
_LEAST_SCALE = math.radians(0.3)
_PRIOR_SCALE, _PRIOR_FRAMES = math.radians(4.0), 2.0  # what hands do, worth so many frames
_TRIPOD_FRAMES = 3  # that agree on a roll far better than hands do, besides those that fix it
_MOST_ROWS = 3
_TIGHT = 0.75
_FREEDOM = 4.0  # degrees of freedom of Student's t, in which single rolled frames weigh little


class Upright(NamedTuple):
    """A direction as up.

    Attributes
    ----------
    up
        Unit vector (3,) away from the ground, in the world that the rotations are from.
    sigma_deg
        Root mean square of its angle to the truth to be expected, degrees.
    opposite
        Whether the opposite direction explains the same as well.
    """

    up: FloatArray
    sigma_deg: float
    opposite: bool = False


def up_from_cameras(rotations: Sequence[FloatArray], quarter_turns: Sequence[int] | None = None) -> Upright:
    """The up under which most cameras were held level.

    Held level, a camera has an edge of its picture in the horizon: the lower one, or a side where it was held on its
    side.  Which of them, is chosen for each frame with up itself, the best of directions all round.  It is then
    refined by least squares with the weights of Student's t over the rolls, which says most where frames look all
    round (Brown & Lowe, IJCV 2007, section 5), and over how far each frame is above or below its row: sets are
    taken in rows of one pitch, as many as explain the pitches best (the Bayesian information criterion, Schwarz 1978).

    Parameters
    ----------
    rotations
        camera_from_world (3, 3) of the frames, at least one.
    quarter_turns
        For each, how many quarter turns clockwise bring its picture upright; None if nothing tells.
    """
    axes = np.asarray(rotations, float)
    turned = np.zeros(len(axes), int) if quarter_turns is None else np.asarray(quarter_turns)
    sides = _sides(axes, turned)
    directions = _all_round(_DIRECTIONS)
    costs, _ = _costs(directions, sides)
    first = directions[int(np.argmin(costs))]
    here, choice = _costs(first[None], sides)
    there, _ = _costs(-first[None], sides)
    held = sides[np.arange(len(axes)), choice[0]]
    up, sigma = _refined(first, held)
    return Upright(up, math.degrees(sigma), bool(there[0] - here[0] < _NO_DIFFERENCE))


def _sides(axes: FloatArray, turned: NDArray[np.int_]) -> FloatArray:
    """Right, down and forward (n, 4, 3, 3) of each frame if its picture is upright after 0 to 3 further turns."""
    right, down, forward = axes[:, 0], axes[:, 1], axes[:, 2]
    # turned clockwise by a quarter, a picture's left edge comes to the top: what was up is to the right
    rights = np.stack([right, -down, -right, down], 1)
    downs = np.stack([down, right, -down, -right], 1)
    frames = np.stack([rights, downs, np.broadcast_to(forward[:, None], rights.shape)], 2)
    order = (np.arange(4)[None, :] + turned[:, None]) % 4
    return np.asarray(np.take_along_axis(frames, order[:, :, None, None], axis=1))


def _all_round(count: int) -> FloatArray:
    """Directions (count, 3) spread evenly over the sphere, on a golden spiral."""
    k = np.arange(count) + 0.5
    y, longitude = 1 - 2 * k / count, k * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - y * y)
    return np.stack([flat * np.cos(longitude), y, flat * np.sin(longitude)], -1)


def _costs(ups: FloatArray, sides: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """What each direction (m, 3) costs as up (m,), and which way each frame is held then (m, n)."""
    total = np.zeros(len(ups))
    choices = np.empty((len(ups), len(sides)), np.intp)
    for k, of_frame in enumerate(sides):
        along = np.einsum("mc,qac->mqa", ups, of_frame)
        roll = np.arcsin(np.clip(along[..., 0], -1, 1))
        cost = np.log1p((roll / _NOT_LEVEL) ** 2) + _COST_OF_QUARTERS
        cost += _COST_OF_DOWN_UP * np.clip(along[..., 1] / 0.25 - 1, 0, 1)  # near the zenith either edge may be lower
        choices[:, k] = np.argmin(cost, axis=1)
        pitch = np.arcsin(np.clip(along[:, 0, 2], -1, 1))
        total += cost.min(1) + np.log1p((pitch / _PITCH) ** 2)
    return total, choices


def _refined(up: FloatArray, held: FloatArray) -> tuple[FloatArray, float]:
    """The best up near a first one, and its standard deviation, over one to three rows."""
    one_row = _fitted(up, held, 1)
    for rows in range(2, min(_MOST_ROWS, len(held) // 3) + 1):
        found = _fitted(up, held, rows)
        if found[0] < _TIGHT / rows * one_row[0]:  # pitches strewn anyhow come to 1 / rows
            return found[1:]
    return one_row[1:]


def _fitted(up: FloatArray, held: FloatArray, rows: int) -> tuple[float, FloatArray, float]:
    """(information criterion, up, sigma) with so many rows."""
    n = len(held)
    roll_scale, pitch_scale = _NOT_LEVEL, _PITCH
    for _ in range(30):
        sides = across(up)
        roll, pitch = held[:, 0] @ up, held[:, 2] @ up
        of_row, off = _in_rows(pitch, rows)
        roll_weight, pitch_weight = _weights(roll, roll_scale), _weights(off, pitch_scale)
        roll_scale = _scale(roll, roll_weight, 1.0)
        pitch_scale = _scale(off, pitch_weight, 1.0 + rows)
        by_roll, by_pitch = held[:, 0] @ sides.T, held[:, 2] @ sides.T
        means = np.stack([by_pitch[of_row == r].mean(0) if np.any(of_row == r) else np.zeros(2) for r in range(rows)])
        by_pitch = by_pitch - means[of_row]
        a = np.concatenate(
            [
                by_roll * (np.sqrt(roll_weight) / roll_scale)[:, None],
                by_pitch * (np.sqrt(pitch_weight) / pitch_scale)[:, None],
                held[:, 2] @ sides.T / (_PITCH * math.sqrt(n)),
            ]
        )
        b = np.concatenate(
            [
                roll * np.sqrt(roll_weight) / roll_scale,
                off * np.sqrt(pitch_weight) / pitch_scale,
                pitch / (_PITCH * math.sqrt(n)),
            ]
        )
        normal = a.T @ a + 1e-9 * np.eye(2)
        step = np.linalg.solve(normal, -a.T @ b)
        step *= min(1.0, 0.2 / max(float(np.linalg.norm(step)), 1e-12))
        up = up + step @ sides
        up = up / np.linalg.norm(up)
        if np.linalg.norm(step) < 1e-10:
            break
    sigma = math.sqrt(float(np.trace(np.linalg.inv(normal))))
    return pitch_scale, up, sigma


def across(up: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) at right angles to a direction and each other."""
    other = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, other)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _weights(errors: FloatArray, scale: float) -> FloatArray:
    return np.asarray((_FREEDOM + 1) / (_FREEDOM + (errors / scale) ** 2))


def _scale(errors: FloatArray, weights: FloatArray, unknowns: float) -> float:
    known = max(len(errors) - unknowns, 0.0)
    square = float((weights * errors**2).sum())
    if known >= _TRIPOD_FRAMES and square < known * _LEAST_SCALE**2:  # no hand is so steady so often
        return _LEAST_SCALE
    return max(math.sqrt((square + _PRIOR_FRAMES * _PRIOR_SCALE**2) / (known + _PRIOR_FRAMES)), _LEAST_SCALE)


def _in_rows(pitch: FloatArray, rows: int) -> tuple[NDArray[np.intp], FloatArray]:
    """Which row each frame is in, split at the widest gaps of pitch, and how far it is off its row's mean."""
    order = np.argsort(pitch, kind="stable")
    gaps = np.diff(pitch[order])
    cuts = np.sort(np.argsort(-gaps, kind="stable")[: rows - 1]) + 1
    of_row = np.empty(len(pitch), np.intp)
    of_row[order] = np.searchsorted(cuts, np.arange(len(pitch)), side="right")
    means = np.array([pitch[of_row == r].mean() if np.any(of_row == r) else 0.0 for r in range(rows)])
    return of_row, pitch - means[of_row]
