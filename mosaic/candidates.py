"""Which pairs of frames to match: all of few frames; of many those that order, prior poses or a first look suggest.

The first look compares the largest keypoints of each frame with those of all others: what is seen large is seen again
from any frame that overlaps.  It is cheap, and it tells how much two frames have in common whatever their order.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.matching import match_features
from fullsphere.mosaic.options import Order

Pair = tuple[int, int]

FEW_FRAMES = 12
"""Of so many frames all pairs are matched."""

_LARGEST = 200  # keypoints of a frame in the first look
_CHANCE = 6  # as many of those match between frames that have nothing in common
_NEAREST, _SPREAD = 4, 4  # partners of a frame: those it shares most with, and others evenly among all that share
_NEIGHBOURS = 2  # frames before and after that are always matched where the order is told


def candidate_pairs(
    frames: Sequence[int],
    shared: NDArray[np.int32],
    order: Order = "any",
    priors: Mapping[int, FloatArray] | None = None,
) -> list[Pair]:
    """Pairs i < j to match first, sorted; their number grows with the frames, not with their square.

    Parameters
    ----------
    frames
        Their indices, ascending.
    shared
        How much they have in common (n, n), of `first_look`.
    order
        How the frames follow one another, in the order of their indices: neighbours are always matched, and the ends
        of a ring are neighbours.
    priors
        camera_from_world (3, 3) of frames, as far as told beforehand: those that look the same way are matched.
    """
    if len(frames) <= FEW_FRAMES:
        return list(itertools.combinations(frames, 2))
    told = {k: prior for k, prior in (priors or {}).items() if k in set(frames)}
    return sorted(_by_likeness(frames, shared) | _by_order(frames, order) | set(near_pairs(told, _NEAREST + _SPREAD)))


def first_look(features: Mapping[int, Features], executor: Executor | None = None) -> NDArray[np.int32]:
    """How many of their largest keypoints match (n, n), for all pairs of the frames in the order of their indices."""
    frames = sorted(features)
    largest = [_largest(features[k]) for k in frames]

    def row(i: int) -> list[int]:
        return [len(match_features(largest[i], other).first) for other in largest[i + 1 :]]

    shared = np.zeros((len(frames), len(frames)), np.int32)
    for i, counts in enumerate(ordered_map(executor, row, range(len(frames)))):
        shared[i, i + 1 :] = counts
    return shared + shared.T


def near_pairs(camera_from_world: Mapping[int, FloatArray], partners: int, known: Collection[Pair] = ()) -> list[Pair]:
    """For each frame the pairs with the `partners` others whose optical axes are nearest to its own, sorted.

    With the orientations of a first solution these close the loops: frames that look the same way, however far apart
    they were taken.  Those of `known` are left out.
    """
    frames = sorted(camera_from_world)
    if len(frames) < 2:
        return []
    axes = np.array([camera_from_world[k][2] for k in frames])
    cosine = axes @ axes.T
    np.fill_diagonal(cosine, -np.inf)
    nearest = np.argsort(-cosine, axis=1, kind="stable")[:, : min(partners, len(frames) - 1)]
    pairs = {_sorted(frames[i], frames[j]) for i, row in enumerate(nearest) for j in row}
    return sorted(pairs - set(known))


def missing_pairs(
    frames: Sequence[int], strong: Iterable[Pair], known: Collection[Pair], shared: NDArray[np.int32], partners: int
) -> list[Pair]:
    """Pairs that may join groups of frames which no strong pair joins: for each frame outside the largest group the
    `partners` likeliest outside its own, sorted; those of `known` are left out.
    """
    index = {k: at for at, k in enumerate(frames)}
    ends = np.array([[index[i], index[j]] for i, j in strong], np.int32).reshape(-1, 2).T
    graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(len(frames), len(frames)))
    _, label = connected_components(graph, directed=False)
    largest = np.bincount(label).argmax()
    known = set(known)
    pairs: set[Pair] = set()
    for i in np.flatnonzero(label != largest).tolist():
        outside = [j for j in np.flatnonzero(label != label[i]).tolist() if _sorted(frames[i], frames[j]) not in known]
        outside.sort(key=lambda j: (-shared[i, j], abs(j - i), j))
        pairs.update(_sorted(frames[i], frames[j]) for j in outside[:partners])
    return sorted(pairs)


def _largest(features: Features) -> Features:
    """The largest keypoints, or the first where sizes are not known; single precision, as they are compared often."""
    order = np.arange(len(features))
    if features.sigma_px.size:
        order = np.lexsort((features.pixels[:, 1], features.pixels[:, 0], -features.sigma_px))
    some = features.where(order[:_LARGEST])
    return dataclasses.replace(some, descriptors=some.descriptors.astype(np.float32))


def _by_likeness(frames: Sequence[int], shared: NDArray[np.int32]) -> set[Pair]:
    """For each frame the most alike, and some evenly among the others that share more than chance: long arms, which
    keep small errors from adding up.
    """
    pairs: set[Pair] = set()
    for i, counts in enumerate(shared):
        alike = np.argsort(-counts, kind="stable")
        alike = alike[alike != i]
        best, others = alike[:_NEAREST], alike[_NEAREST:]
        others = others[counts[others] > _CHANCE]
        picked = others[np.linspace(0, len(others) - 1, _SPREAD).round().astype(int)] if len(others) else others
        pairs |= {_sorted(frames[i], frames[j]) for j in (*best, *picked)}
    return pairs


def _by_order(frames: Sequence[int], order: Order) -> set[Pair]:
    reach = 1 if order == "any" else _NEIGHBOURS
    count = len(frames)
    pairs = {(frames[i], frames[i + step]) for step in range(1, reach + 1) for i in range(count - step)}
    if order == "ring":
        pairs |= {_sorted(frames[i], frames[(i + step) % count]) for step in range(1, reach + 1) for i in range(count)}
    return pairs


def _sorted(i: int, j: int) -> Pair:
    return (i, j) if i < j else (j, i)
