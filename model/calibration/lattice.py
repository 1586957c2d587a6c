"""Numbers the points of a bent regular grid, from neighbour to neighbour: nothing is assumed of the lens."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fullsphere.model.lens import FloatArray

_SEEDS = 12
_NEIGHBOURS = 9  # of a seed, among which the grid's two steps are looked for
_LEAST_SINE = 0.4  # of the angle between those
_OFF = 0.35  # steps: a point lies this near to where its neighbours say
_SIZES = 2.0  # largest ratio of the sizes of neighbours
_AROUND = ((1, 0), (-1, 0), (0, 1), (0, -1))
_BASES = tuple(
    np.array(turn) @ np.array(shear)
    for shear in (((1, 0), (0, 1)), ((1, 0), (1, 1)), ((1, 0), (-1, 1)), ((1, 1), (0, 1)), ((1, -1), (0, 1)))
    for turn in (((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0)))
)
"""Bases of the same lattice: foreshortened, a diagonal may be shorter than a side."""


def numbered(points: FloatArray, sizes: FloatArray, places: NDArray[np.intp]) -> NDArray[np.intp] | None:
    """Which point is at which place of a grid that a viewer sees unmirrored.

    Parameters
    ----------
    points, sizes
        Pixels (m, 2) of spots in the picture, and how large each is (m,); some may have nothing to do with the grid.
    places
        Column and row (n, 2) of each of the grid's places, in steps of its lattice.

    Returns
    -------
    The numbers (n,) of the points at the places; None if the points do not make just this grid.
    """
    if len(points) < len(places):
        return None
    tree = cKDTree(points)
    middle = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    wanted = _shape(places)
    for seed in np.argsort(middle, kind="stable")[:_SEEDS]:
        grown = _grow(tree, points, sizes, int(seed))
        if len(grown) != len(places):
            continue
        coordinates, indices = np.array(list(grown)), np.array(list(grown.values()))
        for basis in _BASES:
            order = _matched(coordinates @ basis.T, places, wanted)
            if order is not None:
                return np.asarray(indices[order], np.intp)
    return None


def _shape(places: NDArray[np.intp]) -> set[tuple[int, int]]:
    return set(map(tuple, (places - places.min(0)).tolist()))


def _matched(
    coordinates: NDArray[np.intp], places: NDArray[np.intp], wanted: set[tuple[int, int]]
) -> NDArray[np.intp] | None:
    """Which row (n,) of the coordinates has each place; None if the two sets differ by more than a shift."""
    if _shape(coordinates) != wanted:
        return None
    by_place, by_coordinate = (np.lexsort(array.T) for array in (places, coordinates))
    order = np.empty(len(places), np.intp)
    order[by_place] = by_coordinate
    return order


def _grow(tree: cKDTree, points: FloatArray, sizes: FloatArray, seed: int) -> dict[tuple[int, int], int]:
    """Lattice coordinates and numbers of the points that a lattice reaches from the seed, step by step."""
    steps = _steps_at(tree, points, seed)
    if steps is None:
        return {}
    grown, taken = {(0, 0): seed}, {seed}
    queue = deque([((0, 0), steps)])
    while queue:
        place, steps = queue.popleft()
        here = grown[place]
        for i, j in _AROUND:
            there = (place[0] + i, place[1] + j)
            if there in grown:
                continue
            axis, sign = (0, i) if i else (1, j)
            step = sign * steps[axis]
            distance, index = tree.query(points[here] + step)
            ratio = sizes[index] / sizes[here]
            near = distance < _OFF * np.linalg.norm(step)
            if near and index not in taken and 1 / _SIZES < ratio < _SIZES:
                grown[there] = int(index)
                taken.add(int(index))
                followed = steps.copy()
                followed[axis] = sign * (points[index] - points[here])
                queue.append((there, followed))
    return grown


def _steps_at(tree: cKDTree, points: FloatArray, seed: int) -> FloatArray | None:
    """The two shortest steps (2, 2) from the seed to neighbours in directions that differ; y to the right of x."""
    _, neighbours = tree.query(points[seed], k=min(_NEIGHBOURS, len(points)))
    first, *others = points[np.asarray(neighbours)[1:]] - points[seed]
    for other in others:
        cross = first[0] * other[1] - first[1] * other[0]
        if abs(cross) > _LEAST_SINE * np.linalg.norm(first) * np.linalg.norm(other):
            return np.array([first, other if cross > 0 else -other])
    return None
