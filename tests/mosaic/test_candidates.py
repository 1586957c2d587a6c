"""Pairs that may be matched: enough to hold all frames together, not as many as the square of their number."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.candidates import FEW_FRAMES, candidate_pairs, first_look, missing_pairs, near_pairs
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.links import gather_evidence, matched
from fullsphere.mosaic.options import Order
from laws import SEEDS, law


def swept(count: int, seed: int = 0, things: int = 60) -> dict[int, Features]:
    """Frames of a closed turn: each shows `things` things of which its neighbour shows two thirds."""
    rng = np.random.default_rng(seed)
    step = things // 3
    words = rng.random((count * step, 128)) ** 4
    words /= np.linalg.norm(words, axis=1, keepdims=True)
    shown = [(k * step + np.arange(things)) % len(words) for k in range(count)]
    return {
        k: Features(rng.uniform(0, 500, (things, 2)), words[at].astype(np.float32), np.asarray(at % 7 + 1.0, float))
        for k, at in enumerate(shown)
    }


def yaws(count: int) -> dict[int, FloatArray]:
    turns = Rotation.from_rotvec(np.arange(count)[:, None] * [0, 2 * np.pi / count, 0]).as_matrix()
    return dict(enumerate(turns.swapaxes(1, 2)))


@pytest.mark.parametrize("count", [2, 5, FEW_FRAMES])
def test_all_pairs_of_few_frames(count: int) -> None:
    frames = list(range(3, 3 + count))
    assert candidate_pairs(frames, np.zeros((count, count), np.int32)) == list(itertools.combinations(frames, 2))


def test_the_first_look_counts_what_frames_share() -> None:
    features = swept(15)
    shared = first_look(features)
    np.testing.assert_array_equal(shared, shared.T)
    np.testing.assert_array_equal(np.diag(shared), 0)
    for i, j in itertools.combinations(range(15), 2):
        steps = min(j - i, 15 - (j - i))
        assert shared[i, j] == max(0, 60 - 20 * steps)


def test_the_first_look_is_the_same_with_threads() -> None:
    features = swept(15)
    with thread_pool(3) as pool:
        np.testing.assert_array_equal(first_look(features, pool), first_look(features))


@given(seed=SEEDS, order=st.sampled_from(["any", "ring", "sweep"]))
@law(6)
def test_frames_in_any_order_stay_together(seed: int, order: Order) -> None:
    count = 30
    shuffled = np.random.default_rng(seed).permutation(count)
    features = dict(enumerate(swept(count)[int(q)] for q in shuffled))
    pairs = candidate_pairs(range(count), first_look(features), order)
    assert pairs == sorted(set(pairs))
    assert all(i < j for i, j in pairs)
    place = np.argsort(shuffled)  # where in the turn's order each lies
    for q in range(count):
        one, other = sorted((int(place[q]), int(place[(q + 1) % count])))
        assert (one, other) in pairs


def test_pairs_grow_with_the_frames_not_with_their_square() -> None:
    few, many = (len(candidate_pairs(range(n), first_look(swept(n)))) / n for n in (30, 120))
    assert many < 1.2 * few
    assert many < 12


def test_told_order_makes_neighbours_and_closes_a_ring() -> None:
    count = 20
    nothing = np.zeros((count, count), np.int32)
    open_pairs, ring = (set(candidate_pairs(range(count), nothing, order)) for order in ("sweep", "ring"))
    assert {(k, k + 2) for k in range(count - 2)} <= open_pairs & ring
    assert {(0, count - 1), (0, count - 2), (1, count - 1)} <= ring


def test_frames_told_to_look_the_same_way_are_matched() -> None:
    count = 24
    order = np.random.default_rng(1).permutation(count)
    turns = yaws(count)
    priors = {k: turns[int(q)] for k, q in enumerate(order)}
    pairs = candidate_pairs(range(count), np.zeros((count, count), np.int32), "any", priors)
    place = np.argsort(order)
    for q in range(count):
        assert tuple(sorted((int(place[q]), int(place[(q + 1) % count])))) in pairs


def test_near_pairs_close_the_loop() -> None:
    chain = {(k, k + 1) for k in range(19)}
    found = near_pairs(yaws(20), 2, chain)
    assert found == [(0, 19)]
    assert near_pairs({0: np.eye(3)}, 3) == []
    assert near_pairs({}, 3) == []


def test_missing_pairs_lead_out_of_small_groups() -> None:
    shared = np.zeros((6, 6), np.int32)
    shared[4, 1] = shared[1, 4] = 9
    found = missing_pairs([10, 11, 12, 13, 14, 15], [(10, 11), (11, 12), (12, 13), (14, 15)], {(10, 14)}, shared, 2)
    assert (11, 14) in found
    assert (10, 14) not in found
    assert all(set(pair) & {14, 15} and set(pair) & {10, 11, 12, 13} for pair in found)
    assert missing_pairs([0, 1, 2], [(0, 1), (1, 2)], (), np.zeros((3, 3), np.int32), 5) == []


def test_gathered_evidence_of_many_frames_has_their_neighbours() -> None:
    features = swept(16, things=150)
    evidence = gather_evidence(features, None, lambda items, **_: items)
    assert len(evidence.matches) < 16 * 15 / 2
    for k in range(16):
        pair = (k, k + 1) if k < 15 else (0, 15)
        assert len(evidence.matches[pair].first) + len(evidence.held[pair].first) == 100
    more = matched(evidence, [(0, 8), (0, 1)])
    assert more.matches[0, 1] is evidence.matches[0, 1]
    assert (0, 8) in more.matches
    assert list(more.matches) == sorted(more.matches)
    assert matched(more, [(0, 8)]) is more
