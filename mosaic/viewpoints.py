"""From how many places the frames of a set were taken: groups of frames between which parallax is far larger.

No set of real frames is free of parallax: a tripod turns the lens about a point beside its entrance pupil.  So no size
of it says by itself that somebody walked.  What does is that the frames fall apart into groups, small parallax within
and large between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.parallax import Parallax

MOST_PAIRS = 300
"""Pairs that are compared at most: of a long sweep those with most matches, each frame's own first."""

_MATCHES = 30  # that a pair needs to be judged by
_BETWEEN = 2.5  # times the parallax within groups, at the least, that there is between groups
_FINER = 1.2  # times the contrast that a division into more groups must have to be preferred
_LEAST = np.deg2rad(0.3)  # parallax of a lens held five centimetres off its place, ten metres away
_LEAST_PX = 2.0  # parallax below this spoils no mosaic, and lens and keypoints alone may bring it about
_FLOOR_PX = 0.3  # parallax below this is that of keypoints


class Viewpoints(NamedTuple):
    """Frames taken from the same places, and the median parallax in radians within and between the groups."""

    groups: tuple[tuple[int, ...], ...]
    within: float
    between: float


def pairs_to_compare(evidence: Evidence, most: int = MOST_PAIRS) -> list[Pair]:
    """The pairs of frames to look for parallax in: all of a small set, the strongest of a large one, in order.

    Both frames are of one camera: the two of a rig stand beside each other, wherever the rig is.
    """
    good = [
        (i, j)
        for (i, j), matches in evidence.matches.items()
        if len(matches.first) >= _MATCHES and evidence.camera_of.get(i, 0) == evidence.camera_of.get(j, 0)
    ]
    if len(good) <= most:
        return good
    partners = max(1, most // max(1, len(evidence.features)))
    strongest = evidence.strongest_pairs(partners)
    step = -(-len(strongest) // most)
    chosen = set(strongest[::step])
    return [pair for pair in good if pair in chosen]


def viewpoints(parallax: Mapping[Pair, Parallax]) -> Viewpoints | None:
    """The groups of frames taken from different places, the largest first, or None where there is one place.

    Frames are joined into groups, always the two groups next with the least parallax between them (the mean of its
    logarithm over the pairs that were compared).  Where the parallax of the last joints is far larger than that of all
    before, those joints are undone.

    Parameters
    ----------
    parallax
        Of pairs of frames, as `parallaxes` finds it.
    """
    judged = {pair: one for pair, one in parallax.items() if one.matches >= _MATCHES}
    frames = sorted({frame for pair in judged for frame in pair})
    best: Viewpoints | None = None
    for groups in reversed(_joined(judged, frames)):
        candidate = _contrast(judged, groups)
        if candidate is not None and (best is None or _ratio(candidate) > _FINER * _ratio(best)):
            best = candidate
    return best


def inside_groups(pairs: Sequence[Pair], groups: Sequence[Sequence[int]]) -> list[Pair]:
    """The pairs both frames of which were taken from one place; frames in no group are taken for a group each."""
    of = {frame: k for k, group in enumerate(groups) for frame in group}
    return [(i, j) for i, j in pairs if i in of and of[i] == of.get(j)]


def _joined(judged: Mapping[Pair, Parallax], frames: Sequence[int]) -> list[list[list[int]]]:
    """Every stage of the joining, from single frames to groups between which no pair was compared."""
    logs = {pair: np.log(_size_px(one)) for pair, one in judged.items()}
    groups = {k: [frame] for k, frame in enumerate(frames)}
    place = {frame: k for k, frame in enumerate(frames)}
    near: dict[int, dict[int, tuple[float, int]]] = {k: {} for k in groups}  # sum of logarithms, and their number
    for (i, j), value in logs.items():
        near[place[i]][place[j]] = near[place[j]][place[i]] = (float(value), 1)
    stages: list[list[list[int]]] = []
    while True:
        links = [(total / n, k, m) for k, row in near.items() for m, (total, n) in row.items() if k < m]
        if not links:
            return stages
        _, k, m = min(links)
        groups[k] = sorted(groups[k] + groups.pop(m))
        for other, (total, n) in near.pop(m).items():
            del near[other][m]
            if other != k:
                before = near[k].get(other, (0.0, 0))
                near[k][other] = near[other][k] = (before[0] + total, before[1] + n)
        stages.append([list(group) for group in groups.values()])


def _contrast(judged: Mapping[Pair, Parallax], groups: Sequence[Sequence[int]]) -> Viewpoints | None:
    """The groups as viewpoints, or None where what is between them is not clearly more than what is within."""
    ordered = tuple(sorted((tuple(group) for group in groups), key=lambda g: (-len(g), g)))
    inner = set(inside_groups(list(judged), ordered))
    within = [judged[pair] for pair in judged if pair in inner]
    between = [judged[pair] for pair in judged if pair not in inner]
    if not within or not between or len(ordered) > max(2, len(inner) // 2):
        return None
    most = float(np.quantile([_size_px(one) for one in within], 0.9))
    medians = [float(np.median([one.size for one in part])) for part in (within, between)]
    apart = min(_medians_between(judged, ordered)) > max(1.5 * most, _LEAST_PX)
    if not apart or medians[1] < max(_LEAST, _BETWEEN * medians[0]):
        return None
    return Viewpoints(ordered, *medians)


def _medians_between(judged: Mapping[Pair, Parallax], groups: Sequence[Sequence[int]]) -> list[float]:
    """Median parallax in pixels between every two groups of which pairs were compared."""
    of = {frame: k for k, group in enumerate(groups) for frame in group}
    between: dict[tuple[int, int], list[float]] = {}
    for (i, j), one in judged.items():
        if of[i] != of[j]:
            between.setdefault((min(of[i], of[j]), max(of[i], of[j])), []).append(_size_px(one))
    return [float(np.median(sizes)) for sizes in between.values()]


def _size_px(one: Parallax) -> float:
    return max(one.size_px, _FLOOR_PX)


def _ratio(found: Viewpoints) -> float:
    return found.between / max(found.within, 1e-4)
