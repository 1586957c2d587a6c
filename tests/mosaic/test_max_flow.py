"""The minimum cut of a grid, against SciPy's maximum flow on the same graph."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import maximum_flow

from fullsphere.mosaic.max_flow import DOWN, LEFT, RIGHT, UP, grid_neighbours, minimum_cut


def cost_of(
    sink: NDArray[np.bool_], terminal: NDArray[np.int32], capacity: NDArray[np.int32], neighbours: NDArray[np.int32]
) -> int:
    """What a cut costs, each node's smaller cost taken off."""
    total = int(np.where(sink, np.maximum(terminal, 0), np.maximum(-terminal, 0)).sum())
    n, d = np.nonzero(neighbours >= 0)
    crosses = ~sink[n] & sink[neighbours[n, d]]
    return total + int(capacity[n, d][crosses].sum())


@pytest.mark.parametrize("seed", range(40))
def test_the_cut_costs_what_scipy_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 12, 2)
    free = rng.random((height, width)) < rng.choice([0.6, 0.9, 1.0])
    pixels, neighbours = grid_neighbours(free)
    n = pixels.size
    most = int(rng.choice([3, 50, 1_000_000]))
    terminal = rng.integers(-most, most + 1, n).astype(np.int32)
    capacity = (rng.integers(0, most + 1, (n, 4)) * (rng.random((n, 4)) < 0.8)).astype(np.int32)
    cut = minimum_cut(terminal, capacity, neighbours)

    a, d = np.nonzero(neighbours >= 0)
    rows = np.concatenate([a, np.full(n, n), np.arange(n)])
    columns = np.concatenate([neighbours[a, d], np.arange(n), np.full(n, n + 1)])
    values = np.concatenate([capacity[a, d], np.maximum(terminal, 0), np.maximum(-terminal, 0)])
    graph = coo_array((values, (rows, columns)), shape=(n + 2, n + 2), dtype=np.int32).tocsr()
    assert cut.cost == maximum_flow(graph, n, n + 1).flow_value
    assert cut.cost == cost_of(cut.sink, terminal, capacity, neighbours)


def test_neighbours_are_mutual_and_columns_wrap() -> None:
    free = np.ones((3, 5), bool)
    free[1, 2] = False
    pixels, neighbours = grid_neighbours(free)
    at = {int(pixel): n for n, pixel in enumerate(pixels)}
    assert 7 not in at
    assert neighbours[at[4], RIGHT] == at[0]
    assert neighbours[at[10], LEFT] == at[14]
    assert neighbours[at[2], UP] == neighbours[at[2], DOWN] == -1
    n, d = np.nonzero(neighbours >= 0)
    np.testing.assert_array_equal(neighbours[neighbours[n, d], d ^ 1], n)


def test_no_node_is_no_cut_and_ties_stay_with_the_source() -> None:
    pixels, neighbours = grid_neighbours(np.zeros((4, 6), bool))
    assert pixels.size == 0
    cut = minimum_cut(np.empty(0, np.int32), np.empty((0, 4), np.int32), neighbours)
    assert cut.sink.size == cut.cost == 0
    _, neighbours = grid_neighbours(np.ones((4, 6), bool))
    assert not minimum_cut(np.zeros(24, np.int32), np.ones((24, 4), np.int32), neighbours).sink.any()
