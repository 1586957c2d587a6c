"""Links -> groups that hang together -> orientations, in spite of some false links."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning import matched, ring, turn_between

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.orientation import connected_groups, disagreement_deg, first_orientations
from fullsphere.mosaic.project import Link
from laws import SEEDS, fisheye, law, rotation

CAMERA = fisheye(500)


def bare(i: int, j: int, j_from_i: FloatArray | None = None, matches: int = 20) -> Link:
    return Link(i, j, np.zeros((matches, 2)), np.zeros((matches, 2)), np.eye(3) if j_from_i is None else j_from_i)


@given(count=st.integers(1, 12), pairs=st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), max_size=20))
@law(60)
def test_groups_partition_the_frames_and_no_link_leaves_its_group(count: int, pairs: list[tuple[int, int]]) -> None:
    links = [bare(i, j) for i, j in sorted({(min(p), max(p)) for p in pairs}) if i < j < count]
    groups = connected_groups(links, count)
    assert sorted(np.concatenate(groups).tolist()) == list(range(count))
    assert [len(g) for g in groups] == sorted((len(g) for g in groups), reverse=True)
    for link in links:
        assert len({k for k, g in enumerate(groups) for frame in (link.i, link.j) if frame in g}) == 1
    for group in groups:  # and each hangs together: what is reached from its first member is all of it
        reached = {int(group[0])}
        for _ in range(count):
            reached |= {f for link in links if {link.i, link.j} & reached for f in (link.i, link.j)}
        assert reached == set(group.tolist())


@given(seed=SEEDS)
@law(15)
def test_true_links_give_the_true_orientations(seed: int) -> None:
    truth = np.array([rotation(seed + k) for k in range(6)])
    links = [bare(i, j, truth[j] @ truth[i].T) for i in range(6) for j in range(i + 1, 6) if (i + j) % 3]
    group = connected_groups(links, 6)[0]
    found = first_orientations(links, group, 6)
    np.testing.assert_allclose(found[group[0]], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found[group] @ truth[group[0]], truth[group], atol=1e-9)


@given(seed=SEEDS)
@law(15)
def test_some_false_links_do_not_move_the_orientations(seed: int) -> None:
    truth = ring(8, seed)
    links = matched(CAMERA, truth, count=30, seed=seed)
    rng = np.random.default_rng(seed)
    for k in rng.choice(len(links), 4, replace=False):
        few = links[k].kept(np.arange(len(links[k].pixels_i)) < 14)  # a false link has few matches that agree
        links[k] = dataclasses.replace(few, j_from_i=rotation(seed + k))
    found = first_orientations(links, np.arange(8), 8)
    assert np.rad2deg(turn_between(found, truth)).max() < 1.0


def test_frames_outside_the_group_are_left_alone() -> None:
    links = [bare(1, 3, rotation(0))]
    found = first_orientations(links, np.array([1, 3]), 5)
    np.testing.assert_array_equal(found[[0, 1, 2, 4]], np.tile(np.eye(3), (4, 1, 1)))
    np.testing.assert_allclose(found[3], rotation(0), atol=1e-12)


def test_without_links_every_orientation_is_the_identity() -> None:
    np.testing.assert_array_equal(first_orientations([], np.array([0]), 3), np.tile(np.eye(3), (3, 1, 1)))
    assert [g.tolist() for g in connected_groups([], 3)] == [[0], [1], [2]]


def test_disagreement_is_the_angle_between_link_and_orientations() -> None:
    rotations = ring(3)
    (link,) = matched(CAMERA, rotations, [(0, 2)])
    assert disagreement_deg(link, rotations) == pytest.approx(0, abs=1e-6)
    c, s = np.cos(np.deg2rad(7)), np.sin(np.deg2rad(7))
    turned = dataclasses.replace(link, j_from_i=np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ link.j_from_i)
    assert disagreement_deg(turned, rotations) == pytest.approx(7)
