"""Pairs of frames of a turning arm -> the first angles of all: which pairs to look at, and how their turns agree."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.turn_views import FoundPair

SPANS = tuple(math.radians(span) for span in (6, 12, 24, 45))
"""Turns between frames that are compared, beside neighbours: with a longer way both angles and mount show better."""

_AVERAGINGS = 30
_WRONG = math.radians(0.5)  # that a turn may differ from those of others, beside
_SIGMAS = 6.0  # of its own


def placed(found: Sequence[FoundPair], count: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Angles (n,) along the surest pairs, not wrapped, and which frames (n,) hang together with the largest group.

    The first of them has the angle 0.
    """
    ends = np.array([one.ends for one in found]).reshape(-1, 2)
    sure = np.array([1 / len(one.matched.held) for one in found])
    graph = scipy.sparse.csr_array((sure, ends.T), shape=(count, count))
    _, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    together: NDArray[np.bool_] = group == np.bincount(group).argmax()
    tree = scipy.sparse.csgraph.minimum_spanning_tree(graph)
    start = int(np.flatnonzero(together)[0])
    order, before = scipy.sparse.csgraph.breadth_first_order(tree, start, directed=False)
    turn_of = {one.ends: one.turn for one in found}
    angles = np.zeros(count)
    for k in order[1:]:
        b = int(before[k])
        angles[k] = angles[b] + (turn_of[b, k] if (b, k) in turn_of else -turn_of[k, b])
    return angles, together


def averaged(found: Sequence[FoundPair], angles: FloatArray) -> tuple[FloatArray, list[FoundPair]]:
    """Angles (n,) that most turns of pairs agree with, by least absolute differences, and the pairs that do.

    Frames without pairs keep theirs.
    """
    i, j = np.array([one.ends for one in found]).T
    turns, sigma = np.array([one.turn for one in found]), np.array([one.sigma for one in found])
    angles, n, pairs = angles.copy(), len(angles), np.arange(len(found))
    difference = scipy.sparse.csr_array(
        (np.repeat([1.0, -1.0], len(found)), (np.tile(pairs, 2), np.concatenate([j, i]))), shape=(len(found), n)
    )
    for _ in range(_AVERAGINGS):
        off = _off(turns, angles, i, j)
        weight = 1 / (np.maximum(np.abs(off), sigma) * sigma)  # of least absolute differences, by reweighting
        weighted = difference.T * weight
        normal = (weighted @ difference + scipy.sparse.eye_array(n) * (1e-6 * weight.min())).tocsc()
        step = spsolve(normal, weighted @ off)
        angles += step
        if np.abs(step).max() < 1e-5:
            break
    agree = np.abs(_off(turns, angles, i, j)) < _WRONG + _SIGMAS * sigma
    return angles, [one for one, right in zip(found, agree, strict=True) if right]


def _off(turns: FloatArray, angles: FloatArray, i: NDArray[np.intp], j: NDArray[np.intp]) -> FloatArray:
    return np.asarray((turns - angles[j] + angles[i] + np.pi) % (2 * np.pi) - np.pi)


def pairs_by_angle(angles: FloatArray, frames: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Pairs of neighbours and of frames about `SPANS` apart, round the full turn, in order.

    Parameters
    ----------
    angles
        Of all frames (n,), radians.
    frames
        Those to pair (m,).
    """
    within = np.mod(angles[frames], 2 * np.pi)
    order = np.argsort(within, kind="stable")
    within, count = within[order], len(frames)
    around = np.concatenate([within, within + 2 * np.pi])
    chosen = set()
    for place in range(count):
        partners = [place + 1]
        for span in SPANS:
            there = int(np.searchsorted(around, within[place] + span))
            nearest = min((there - 1, there), key=lambda k: abs(around[k] - within[place] - span))
            if abs(around[nearest] - within[place] - span) < span / 2:
                partners.append(nearest)
        for partner in partners:
            one, other = int(frames[order[place]]), int(frames[order[partner % count]])
            if one != other:
                chosen.add((min(one, other), max(one, other)))
    return sorted(chosen)


def neighbours_in(angles: FloatArray, frames: NDArray[np.intp], most: int) -> list[int]:
    """At most so many of frames (m,), spread evenly over their angles."""
    order = frames[np.argsort(np.mod(angles[frames], 2 * np.pi), kind="stable")]
    return [int(k) for k in order[:: max(1, -(-len(order) // most))]]
