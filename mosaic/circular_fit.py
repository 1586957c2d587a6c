"""All turn angles and the camera's mount at once, from the matches of many pairs of frames.

Robust least squares (Cauchy's weights) over the distance of every match from its epipolar plane, Gauss-Newton.  A pair
adds to the normal equations by the difference of its two angles and by the mount only, so they are sparse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.arm import mount_angles, mount_of
from fullsphere.mosaic.circular_motion import Plane, Rays, ahead, plane_of, slope_by_turn, slopes_by_mount

_YAW_SIGMA = math.radians(1.0)  # people aim the axis along the arm: only parallax tells how well they did
_TILT_SIGMA = math.radians(20.0)
_ANGLE_SIGMA = math.radians(100.0)  # holds groups of frames that nothing joins where they are
_ROUNDS = 25
_STEP = 1e-8  # radians: no angle moves by more any more
_CAUCHY = 2.0  # of the spread: half of the weight
_BEHIND = 3.0  # of its noise that a match may lie behind
_CLEAR = 3.0  # deviations from which on parallax tells the yaw
_BLOCK = 1 << 17  # matches at a time
_DRAWS = 48  # of random signs for what keypoints' errors do: the growth of sigma by them to some percent


class Solver(Protocol):
    """A factorised matrix."""

    def solve(self, rhs: FloatArray, /) -> FloatArray:
        """What the matrix takes to `rhs` (n,) or (n, k)."""
        ...


class MatchedPair(NamedTuple):
    """Frames i and j, their matches, which keypoint of each frame a match is of (m,), and whether no fit may see it."""

    i: int
    j: int
    rays: Rays
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    held: NDArray[np.bool_]


class CircularFit(NamedTuple):
    """Angles (n,) and mount (3, 3) that fit best.

    Attributes
    ----------
    sigmas
        One standard deviation (n,) of the angles, radians, the mean of all angles being known.
    mount_sigmas
        Of yaw, pitch and roll (3,).
    spread
        Median distance of matches from their planes, as a normal distribution's standard deviation, in expected ones.
    held_spread
        The same of matches that no fit saw; NaN if there are none.
    """

    angles: FloatArray
    mount: FloatArray
    sigmas: FloatArray
    mount_sigmas: FloatArray
    spread: float
    held_spread: float


def fit_circle(
    pairs: Sequence[MatchedPair],
    angles: FloatArray,
    mount: FloatArray,
    *,
    angles_known: bool = False,
    mount_known: bool = False,
) -> CircularFit:
    """The angles and the mount that bring the matches nearest to their epipolar planes.

    Parameters
    ----------
    pairs
        Matched frames; a group of frames that is joined to no other stays about where it is.
    angles
        Where to begin (n,), radians; each pair must be right to a fraction of a degree.
    mount
        camera_from_arm (3, 3), right to some degrees.
    angles_known, mount_known
        Leave them as they are.
    """
    n = len(angles)
    start, told = np.array(angles, float), mount_angles(mount)
    angles = start.copy()
    free = np.concatenate([np.full(n, not angles_known), np.full(3, not mount_known)])
    free[0] = False
    spread = 1.0
    for _ in range(_ROUNDS):
        normal, gradient, offs = _normal_equations(pairs, angles, told, spread)
        spread = max(_spread(offs), 1e-3)
        prior = spread**2 / np.r_[np.full(n, _ANGLE_SIGMA), _YAW_SIGMA, _TILT_SIGMA, _TILT_SIGMA] ** 2
        normal = normal + scipy.sparse.diags_array(prior, format="csc")
        gradient += prior * np.r_[angles - start, told]
        if not free.any():
            break
        chosen = np.flatnonzero(free)
        solver = splu(normal[chosen][:, chosen].tocsc())
        step = np.zeros(n + 3)
        step[chosen] = -solver.solve(gradient[chosen])
        angles, told = angles + step[:n], told + step[n:]
        if np.abs(step).max() < _STEP:
            break
    sigmas = np.zeros(n + 3)
    if free.any():
        weight = 1 / (1 + (offs / (_CAUCHY * spread)) ** 2)
        loose = float(weight.sum() / (weight * (2 * weight - 1)).sum())  # Cauchy's loss bends less than it weighs
        together = loose * _by_tracks(pairs, angles, mount_of(*told), spread, solver, free)
        sigmas = spread * loose * _deviations(solver, free, n)
        # A keypoint is matched with many others, and its error comes back in all of them.
        sigmas[:n] *= _growth(together[:n], sigmas[:n])
        sigmas[n:] *= _growth(together[n:], sigmas[n:])
    held = _offs(pairs, angles, mount_of(*told), held=True)
    return CircularFit(
        angles, mount_of(*told), sigmas[:n], sigmas[n:], spread, _spread(held) if len(held) else math.nan
    )


def _spread(offs: FloatArray) -> float:
    return 1.4826 * float(np.median(np.abs(offs))) if len(offs) else 1.0


def _blocks(pairs: Sequence[MatchedPair]) -> list[list[MatchedPair]]:
    """The pairs, so many together as have a block of matches."""
    blocks: list[list[MatchedPair]] = [[]]
    count = 0
    for pair in pairs:
        if count + len(pair.held) > _BLOCK and blocks[-1]:
            blocks.append([])
            count = 0
        blocks[-1].append(pair)
        count += len(pair.held)
    return blocks


def _joined(pairs: Sequence[MatchedPair], angles: FloatArray, held: bool) -> tuple[Rays, FloatArray, NDArray[np.intp]]:
    """Matches of pairs together, held back or not, the turn of each and the number of its pair."""
    kept = [pair.rays.where(pair.held == held) for pair in pairs]
    rays = Rays(*(np.concatenate(values) for values in zip(*kept, strict=True)))
    counts = [len(one.first) for one in kept]
    turns = np.array([math.remainder(angles[pair.j] - angles[pair.i], 2 * math.pi) for pair in pairs])
    return rays, np.repeat(turns, counts), np.repeat(np.arange(len(pairs)), counts)


def _offs(pairs: Sequence[MatchedPair], angles: FloatArray, mount: FloatArray, held: bool) -> FloatArray:
    found = []
    for block in _blocks(pairs):
        rays, turns, _ = _joined(block, angles, held)
        plane = plane_of(rays, mount, turns)
        found.append((plane.off / plane.noise)[ahead(plane, rays, _BEHIND)])
    return np.concatenate(found)


def _normal_equations(
    pairs: Sequence[MatchedPair], angles: FloatArray, told: FloatArray, spread: float
) -> tuple[scipy.sparse.csc_array, FloatArray, FloatArray]:
    """J^T W J and J^T W r by all angles, then yaw, pitch and roll; and r, in expected standard deviations."""
    n, mount, axes = len(angles), mount_of(*told), _axes(told)
    rows, columns, values, offs = [], [], [], []
    gradient = np.zeros(n + 3)
    for block in _blocks(pairs):
        rays, turns, of_pair = _joined(block, angles, held=False)
        plane = plane_of(rays, mount, turns)
        off = plane.off / plane.noise
        slopes = _slopes(rays, plane, turns, axes, spread)
        usable = ahead(plane, rays, _BEHIND)
        offs.append(off[usable])
        weight = np.where(usable, 1 / (1 + (off / (_CAUCHY * spread)) ** 2), 0.0)
        sums = np.zeros((len(block), 20))
        products = np.einsum("m,ma,mb->mab", weight, slopes, slopes).reshape(-1, 16)
        for k, column in enumerate(np.column_stack([products, (weight * off)[:, None] * slopes]).T):
            sums[:, k] = np.bincount(of_pair, column, minlength=len(block))
        i, j = np.array([[pair.i, pair.j] for pair in block]).T
        # By the angles of i and j, yaw, pitch and roll: the turn is the difference of the first two.
        spread_out = np.zeros((4, 5))
        spread_out[0, :2], spread_out[1:, 2:] = (-1, 1), np.eye(3)
        index = np.column_stack([i, j, np.broadcast_to(np.arange(n, n + 3), (len(block), 3))])
        whole = spread_out.T @ sums[:, :16].reshape(-1, 4, 4) @ spread_out
        rows.append(np.repeat(index, 5, axis=1).ravel())
        columns.append(np.tile(index, (1, 5)).ravel())
        values.append(whole.ravel())
        np.add.at(gradient, index, sums[:, 16:] @ spread_out)
    at = (np.concatenate(rows), np.concatenate(columns))
    normal = scipy.sparse.csc_array((np.concatenate(values), at), shape=(n + 3, n + 3))
    return normal, gradient, np.concatenate(offs)


def _by_tracks(
    pairs: Sequence[MatchedPair],
    angles: FloatArray,
    mount: FloatArray,
    spread: float,
    solver: Solver,
    free: NDArray[np.bool_],
) -> FloatArray:
    """Standard deviations (n + 3,) by what is left of the matches, those of one thing taken together.

    The wild cluster bootstrap (Cameron, Gelbach & Miller 2008): what all matches of a thing are off keeps its size, its
    sign is drawn, and what that does to the result is averaged over draws.
    """
    n, track = len(angles), _tracks(pairs, len(angles))
    random = np.random.default_rng(0)
    signs = 2.0 * random.integers(0, 2, (max(int(t.max(initial=0)) for t in track) + 1, _DRAWS), np.int8) - 1.0
    gradient, axes = np.zeros((n + 3, _DRAWS)), _axes(mount_angles(mount))
    for pair, own in zip(pairs, track, strict=True):
        rays = pair.rays.where(~pair.held)
        turn = math.remainder(angles[pair.j] - angles[pair.i], 2 * math.pi)
        plane = plane_of(rays, mount, turn)
        slopes = _slopes(rays, plane, turn, axes, spread)
        off = plane.off / plane.noise
        pull = np.where(ahead(plane, rays, _BEHIND), off / (1 + (off / (_CAUCHY * spread)) ** 2), 0.0)
        by = (pull[:, None] * slopes).T @ signs[own]
        gradient[pair.i] -= by[0]
        gradient[pair.j] += by[0]
        gradient[n:] += by[1:]
    step = np.zeros((n + 3, _DRAWS))
    step[free] = solver.solve(gradient[free])
    if free[:n].any():
        step[:n] -= step[:n].mean(0)
    return np.asarray(np.sqrt((step**2).mean(1)))


def _tracks(pairs: Sequence[MatchedPair], frames: int) -> list[NDArray[np.intp]]:
    """Of each match (m,) of each pair that is not held back the number of the thing that it shows."""
    used = [(pair, ~pair.held) for pair in pairs]
    most = 1 + max(max(int(p.first.max(initial=0)), int(p.second.max(initial=0))) for p in pairs)
    one = np.concatenate([p.i * most + p.first[use] for p, use in used])
    other = np.concatenate([p.j * most + p.second[use] for p, use in used])
    size = frames * most
    joined = scipy.sparse.csr_array((np.ones(len(one), np.int8), (one, other)), shape=(size, size))
    _, label = scipy.sparse.csgraph.connected_components(joined, directed=False)
    _, thing = np.unique(label[one], return_inverse=True)
    return list(np.split(np.asarray(thing, np.intp), np.cumsum([use.sum() for _, use in used])[:-1]))


def _growth(together: FloatArray, alone: FloatArray) -> float:
    """By how much errors that matches share make the standard deviations greater, all alike."""
    known = alone > 0
    return max(1.0, float(np.sqrt(np.mean((together[known] / alone[known]) ** 2)))) if known.any() else 1.0


def _slopes(rays: Rays, plane: Plane, turns: FloatArray | float, axes: FloatArray, spread: float) -> FloatArray:
    """Derivatives (m, 4) of what matches are off, in expected deviations, by the turn, yaw, pitch and roll.

    The yaw shows by parallax only: where that is no more than noise, it would be taken for a yaw.
    """
    slopes = np.column_stack([slope_by_turn(plane), slopes_by_mount(plane, turns, axes)]) / plane.noise[:, None]
    clear = plane.beyond / (_CLEAR * spread * np.hypot(rays.noise_first, rays.noise_second))
    slopes[:, 1] *= np.maximum(1 - 1 / np.maximum(clear, 1) ** 2, 0)
    return slopes


def _axes(told: FloatArray) -> FloatArray:
    """The axes (3, 3) in the arm's frame about which yaw, pitch and roll turn the camera, as rows."""
    yaw, pitch, _ = told
    return np.stack([np.array([0.0, 1.0, 0.0]), mount_of(yaw, 0, 0)[0], mount_of(yaw, pitch, 0)[2]])


def _deviations(solver: Solver, free: NDArray[np.bool_], n: int) -> FloatArray:
    """Standard deviations (n + 3,) for unit noise; of angles in the gauge in which their mean is known."""
    chosen = np.flatnonzero(free)
    size = len(chosen)
    of_angle = (chosen < n).astype(float)
    summed = solver.solve(of_angle)
    variance = np.empty(size)
    for start in range(0, size, 256):
        some = np.arange(start, min(start + 256, size))
        unit = np.zeros((size, len(some)))
        unit[some, np.arange(len(some))] = 1
        variance[some] = solver.solve(unit)[some, np.arange(len(some))]
    result = np.zeros(n + 3)
    is_angle = chosen < n
    total = float(of_angle @ summed) / n**2
    centred = variance - np.where(is_angle, 2 * summed / n - total, 0.0)
    result[chosen] = np.sqrt(np.maximum(centred, 0))
    if is_angle.any():
        result[0] = math.sqrt(total)
    return result
