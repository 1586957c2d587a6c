"""Links -> the largest group of frames that hang together -> first orientations, by robust rotation averaging."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial.transform import Rotation

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Link


def connected_groups(links: Sequence[Link], count: int) -> list[NDArray[np.intp]]:
    """Groups of frame indices that the links hold together, largest first; every frame is in one group."""
    graph = _graph(links, count, np.ones(len(links)))
    groups, label = connected_components(graph, directed=False)
    members = [np.flatnonzero(label == g) for g in range(groups)]
    return sorted(members, key=lambda m: (-m.size, m[0]))


def first_orientations(links: Sequence[Link], group: NDArray[np.intp], count: int) -> FloatArray:
    """Rotations camera_from_world (count, 3, 3) of a connected group; identity outside it and for its first frame.

    Chained along the tree of the links with most matches, then averaged over all links by iteratively reweighted least
    squares of log(R_j^T R_ij R_i) with Geman-McClure weights (Chatterjee & Govindu, ICCV 2013).
    """
    rotations = _along_tree(links, group, count)
    inner = [link for link in links if link.i in group]
    if not inner:
        return rotations
    index = {int(frame): k for k, frame in enumerate(group)}
    i = np.array([index[link.i] for link in inner])
    j = np.array([index[link.j] for link in inner])
    measured = np.array([link.j_from_i for link in inner])
    matches = np.sqrt([len(link.pixels_i) for link in inner])
    for scale_deg in (20.0, 10.0, 5.0, 5.0, 3.0, 3.0, 3.0):
        world = rotations[group]
        turn = Rotation.from_matrix(np.swapaxes(world[j], 1, 2) @ measured @ world[i]).as_rotvec()
        scale = np.deg2rad(scale_deg)
        weight = matches * (scale**2 / (scale**2 + (turn**2).sum(1)))
        system = np.zeros((len(inner) + 1, len(group)))
        system[np.arange(len(inner)), i] -= weight
        system[np.arange(len(inner)), j] += weight
        system[-1, 0] = 1e3 * weight.max()  # the first frame stays
        step, *_ = np.linalg.lstsq(system, np.vstack([weight[:, None] * turn, np.zeros(3)]), rcond=None)
        rotations[group] = world @ Rotation.from_rotvec(step).as_matrix()
    return rotations


def disagreement_deg(link: Link, rotations: FloatArray) -> float:
    """Angle in degrees between a link's own rotation and that of the orientations (n, 3, 3)."""
    left = rotations[link.j].T @ link.j_from_i @ rotations[link.i]
    return float(np.rad2deg(Rotation.from_matrix(left).magnitude()))


def _graph(links: Sequence[Link], count: int, weight: FloatArray) -> coo_array:
    # 32-bit indices: csgraph of older SciPy takes no others
    i, j = np.array([[link.i, link.j] for link in links], np.int32).reshape(-1, 2).T
    return coo_array((weight, (i, j)), shape=(count, count))


def _along_tree(links: Sequence[Link], group: NDArray[np.intp], count: int) -> FloatArray:
    rotations = np.tile(np.eye(3), (count, 1, 1))
    if not links:
        return rotations
    cost = np.array([1.0 / len(link.pixels_i) for link in links])
    tree = minimum_spanning_tree(_graph(links, count, cost).tocsr())
    order, parent = breadth_first_order(tree, int(group[0]), directed=False)
    between = {(link.i, link.j): link.j_from_i for link in links}
    for frame in order[1:]:
        p = int(parent[frame])
        turn = between[p, int(frame)] if (p, int(frame)) in between else between[int(frame), p].T
        rotations[frame] = turn @ rotations[p]
    return rotations
