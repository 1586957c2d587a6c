"""The minimum cut of a picture into two parts, exactly: pixels are nodes, each joined to its four neighbours.

After Boykov & Kolmogorov, "An experimental comparison of min-cut/max-flow algorithms for energy minimization in
vision", PAMI 2004: a tree grows from each terminal, where the two meet flow is sent along the path, and what lost its
parent is adopted anew.  Capacities are whole numbers, so the cut is exact and the same everywhere.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.kernels import compiled

RIGHT, LEFT, DOWN, UP = 0, 1, 2, 3
"""The places of a node's neighbours; the one that leads back differs in the last bit."""

_FREE, _SOURCE, _SINK = 0, 1, 2
_TERMINAL, _ORPHAN, _NONE = 4, 5, 6  # parents that are no neighbour
_FAR = 1 << 30


class Cut(NamedTuple):
    """The nodes (n,) on the sink's side, as few as a minimum cut can have, and what the cut costs."""

    sink: NDArray[np.bool_]
    cost: int


def minimum_cut(terminal: NDArray[np.int32], capacity: NDArray[np.int32], neighbours: NDArray[np.int32]) -> Cut:
    """Cut a graph of nodes with four neighbours each so that the sum of what is cut is least.

    Parameters
    ----------
    terminal
        (n,) what it costs more to put a node on the sink's side than on the source's (negative: less).  Of the two
        costs the smaller is taken off beforehand.
    capacity
        (n, 4) what it costs, >= 0, to have the node on the source's side and its neighbour to the RIGHT, LEFT, DOWN or
        UP on the sink's.  The sum over an edge's two directions stays below 2**31.
    neighbours
        (n, 4) the neighbours, -1 for none; mutual, as `grid_neighbours` makes them.
    """
    flow_left, edges = terminal.astype(np.int32), capacity.astype(np.int32)
    tree, sent = _max_flow(flow_left, edges, np.ascontiguousarray(neighbours, np.int32))
    return Cut(tree == _SINK, int(sent))


@compiled
def grid_neighbours(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The graph of the free pixels (h, w) of a picture whose columns wrap: nodes and neighbours.

    Returns
    -------
    The pixels (n,) as y w + x in rising order, and the neighbours (n, 4) as places in that list, -1 for none.
    """
    height, width = free.shape
    count = 0
    place = np.full((height, width), -1, np.int32)
    for y in range(height):
        for x in range(width):
            if free[y, x]:
                place[y, x] = count
                count += 1
    pixels = np.empty(count, np.int32)
    neighbours = np.full((count, 4), -1, np.int32)
    for y in range(height):
        for x in range(width):
            n = place[y, x]
            if n < 0:
                continue
            pixels[n] = y * width + x
            if width > 1:
                neighbours[n, 0] = place[y, x + 1 if x + 1 < width else 0]
                neighbours[n, 1] = place[y, x - 1 if x > 0 else width - 1]
            if y + 1 < height:
                neighbours[n, 2] = place[y + 1, x]
            if y > 0:
                neighbours[n, 3] = place[y - 1, x]
    return pixels, neighbours


@compiled
def _max_flow(terminal: np.ndarray, residual: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, Any]:
    """Send as much flow as goes; what is left of the capacities stays in `terminal` and `residual`."""
    n = terminal.size
    tree = np.zeros(n, np.uint8)
    parent = np.full(n, _NONE, np.uint8)
    seen_at = np.zeros(n, np.int32)  # when the distance to the terminal was last known to be right
    distance = np.zeros(n, np.int32)
    active = np.empty(n + 1, np.int32)  # rings, in which a node stands once at most
    orphans = np.empty(n + 1, np.int32)
    waits = np.zeros(n, np.bool_)
    first, last = 0, 0
    for p in range(n):
        if terminal[p] != 0:
            tree[p] = _SOURCE if terminal[p] > 0 else _SINK
            parent[p] = _TERMINAL
            distance[p] = 1
            waits[p] = True
            active[last] = p
            last += 1
    sent, time = np.int64(0), 0
    p = -1
    while True:
        if p < 0 or parent[p] == _NONE:
            p = -1
            while first != last:
                p = active[first]
                first = first + 1 if first < n else 0
                waits[p] = False
                if parent[p] != _NONE:
                    break
                p = -1
            if p < 0:
                break
        met = -1
        mine = tree[p]
        for d in range(4):
            q = neighbours[p, d]
            if q < 0 or (residual[p, d] if mine == _SOURCE else residual[q, d ^ 1]) == 0:
                continue
            if tree[q] == _FREE:
                tree[q], parent[q] = mine, d ^ 1
                seen_at[q], distance[q] = seen_at[p], distance[p] + 1
                if not waits[q]:
                    waits[q] = True
                    active[last] = q
                    last = last + 1 if last < n else 0
            elif tree[q] != mine:
                met = d
                break
            elif seen_at[q] <= seen_at[p] and distance[q] > distance[p]:
                parent[q], seen_at[q], distance[q] = d ^ 1, seen_at[p], distance[p] + 1
        if met < 0:
            p = -1
            continue

        time += 1
        if mine == _SOURCE:
            amount, lost = _augment(p, met, terminal, residual, neighbours, parent, orphans)
        else:
            amount, lost = _augment(
                np.int64(neighbours[p, met]), met ^ 1, terminal, residual, neighbours, parent, orphans
            )
        sent += amount
        waits[p] = True  # it goes on being looked at, so nobody need queue it
        taken, put = 0, lost
        while taken != put:
            i = orphans[taken]
            taken = taken + 1 if taken < n else 0
            side = tree[i]
            best, nearest = -1, _FAR
            for d in range(4):
                j = neighbours[i, d]
                if j < 0 or tree[j] != side or parent[j] == _NONE:
                    continue
                if (residual[j, d ^ 1] if side == _SOURCE else residual[i, d]) == 0:
                    continue
                far = _distance(j, time, neighbours, parent, seen_at, distance)
                if far < nearest:
                    best, nearest = d, far
            if best >= 0:
                parent[i], seen_at[i], distance[i] = best, time, nearest + 1
                continue
            parent[i], tree[i] = _NONE, _FREE
            for d in range(4):
                j = neighbours[i, d]
                if j < 0 or tree[j] != side or parent[j] == _NONE:
                    continue
                if not waits[j] and (residual[j, d ^ 1] if side == _SOURCE else residual[i, d]) > 0:
                    waits[j] = True
                    active[last] = j
                    last = last + 1 if last < n else 0
                if parent[j] == d ^ 1:
                    parent[j] = _ORPHAN
                    orphans[put] = j
                    put = put + 1 if put < n else 0
        waits[p] = False
    return tree, sent


@compiled
def _augment(
    p: Any,
    d: int,
    terminal: np.ndarray,
    residual: np.ndarray,
    neighbours: np.ndarray,
    parent: np.ndarray,
    orphans: np.ndarray,
) -> tuple[int, int]:
    """Send flow from the source through p, its neighbour in place d, to the sink: how much, and how many lost parents.

    What has lost its parent is put into `orphans`, from its start.
    """
    q = neighbours[p, d]
    amount = residual[p, d]
    i = p
    while parent[i] != _TERMINAL:
        up = parent[i]
        i = neighbours[i, up]
        amount = min(amount, residual[i, up ^ 1])
    amount = min(amount, terminal[i])
    i = q
    while parent[i] != _TERMINAL:
        amount = min(amount, residual[i, parent[i]])
        i = neighbours[i, parent[i]]
    amount = min(amount, -terminal[i])

    lost = 0
    residual[p, d] -= amount
    residual[q, d ^ 1] += amount
    i = p
    while parent[i] != _TERMINAL:
        up = parent[i]
        above = neighbours[i, up]
        residual[i, up] += amount
        residual[above, up ^ 1] -= amount
        if residual[above, up ^ 1] == 0:
            parent[i] = _ORPHAN
            orphans[lost] = i
            lost += 1
        i = above
    terminal[i] -= amount
    if terminal[i] == 0:
        parent[i] = _ORPHAN
        orphans[lost] = i
        lost += 1
    i = q
    while parent[i] != _TERMINAL:
        up = parent[i]
        above = neighbours[i, up]
        residual[above, up ^ 1] += amount
        residual[i, up] -= amount
        if residual[i, up] == 0:
            parent[i] = _ORPHAN
            orphans[lost] = i
            lost += 1
        i = above
    terminal[i] += amount
    if terminal[i] == 0:
        parent[i] = _ORPHAN
        orphans[lost] = i
        lost += 1
    return amount, lost


@compiled
def _distance(
    j: int, time: int, neighbours: np.ndarray, parent: np.ndarray, seen_at: np.ndarray, distance: np.ndarray
) -> int:
    """How many steps j is from its terminal, _FAR if its line ends at an orphan; the line is marked as known."""
    far, k = 0, j
    while True:
        if seen_at[k] == time:
            far += distance[k]
            break
        up = parent[k]
        far += 1
        if up == _TERMINAL:
            seen_at[k], distance[k] = time, 1
            break
        if up == _ORPHAN:
            return _FAR
        k = neighbours[k, up]
    steps, k = far, j
    while seen_at[k] != time:
        seen_at[k], distance[k] = time, steps
        steps -= 1
        k = neighbours[k, parent[k]]
    return far
