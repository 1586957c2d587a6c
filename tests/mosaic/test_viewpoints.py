"""Frames taken from several places fall into groups; those of one tripod do not, however badly it was set up."""

import dataclasses
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from turning import orientation
from walking import evidence_of, room_points

from fullsphere.model.camera import Camera
from fullsphere.model.images import read_picture
from fullsphere.model.lens import Equisolid, FloatArray
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.features import find_features
from fullsphere.mosaic.links import Evidence, gather_evidence
from fullsphere.mosaic.parallax import parallaxes
from fullsphere.mosaic.viewpoints import Viewpoints, inside_groups, pairs_to_compare, viewpoints
from fullsphere.mosaic.worlds import furnished_room, photograph
from laws import SEEDS, fisheye, law

CAMERA = fisheye(800)
TURN = [orientation(yaw, pitch) for yaw, pitch in ((0, 4), (92, -3), (178, 6), (271, -5))]
POINTS = room_points(450)


def found_in(evidence: Evidence, camera: Camera = CAMERA) -> Viewpoints | None:
    return viewpoints(parallaxes(evidence, [camera], pairs_to_compare(evidence)))


def off_the_axis(rotations: list[FloatArray], metres: float) -> FloatArray:
    """Where the entrance pupil is when a lens is turned about a point so far behind it."""
    return np.array([metres * rotation[2] for rotation in rotations])


SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[2].parent / "shared"))


@given(seed=SEEDS)
@law(2)
def test_two_turns_are_two_viewpoints(seed: int) -> None:
    rng = np.random.default_rng(seed)
    order = rng.permutation(8)
    first = {int(k) for k in np.flatnonzero(order < 4)}
    step = rng.normal(size=3)
    positions = off_the_axis(TURN + TURN, 0.02)
    positions[4:] += 0.4 * step / np.linalg.norm(step)
    evidence = evidence_of(CAMERA, np.array(TURN + TURN)[order], positions[order], POINTS, seed=seed)
    found = found_in(evidence)
    assert found is not None
    assert {frozenset(group) for group in found.groups} == {frozenset(first), frozenset(range(8)) - first}
    assert found.between > 2 * found.within


@pytest.mark.parametrize("metres", [0.0, 0.05])
def test_a_tripod_is_one_viewpoint_wherever_it_holds_the_lens(metres: float) -> None:
    rotations = [orientation(60 * k, 5 * (-1) ** k) for k in range(6)]
    evidence = evidence_of(CAMERA, np.array(rotations), off_the_axis(rotations, metres), POINTS)
    assert found_in(evidence) is None


def test_a_hand_that_sways_is_one_viewpoint() -> None:
    rotations = [orientation(60 * k, 15 * (-1) ** k) for k in range(6)]
    sway = 0.03 * np.random.default_rng(1).normal(size=(6, 3))
    assert found_in(evidence_of(CAMERA, np.array(rotations), sway, POINTS)) is None


def test_who_walks_on_with_every_frame_has_no_groups() -> None:
    rotations = [orientation(60 * k) for k in range(6)]
    path = np.array([[0.1 * k, 0, 0] for k in range(6)])
    assert found_in(evidence_of(CAMERA, np.array(rotations), path, POINTS)) is None


def test_one_frame_from_another_place_is_found() -> None:
    positions = np.zeros((5, 3))
    positions[2] = [0.5, 0.1, -0.2]
    rotations = np.array([TURN[0], TURN[1], TURN[1], TURN[2], TURN[3]])
    found = found_in(evidence_of(CAMERA, rotations, positions, POINTS))
    assert found is not None
    assert found.groups == ((0, 1, 3, 4), (2,))


def test_three_viewpoints() -> None:
    positions = np.repeat([[0, 0, 0], [0.7, 0, 0.1], [-0.1, 0.1, 0.8]], 3, axis=0)
    found = found_in(evidence_of(CAMERA, np.array(TURN[:3] * 3), positions, POINTS))
    assert found is not None
    assert found.groups == ((0, 1, 2), (3, 4, 5), (6, 7, 8))


def test_nothing_to_compare_is_one_viewpoint() -> None:
    assert viewpoints({}) is None


def test_pairs_inside_groups() -> None:
    assert inside_groups([(0, 1), (0, 2), (2, 3), (3, 4)], [(0, 1), (2, 3)]) == [(0, 1), (2, 3)]


def test_a_large_set_is_compared_in_part() -> None:
    rotations = np.array([orientation(18 * k) for k in range(20)])
    evidence = evidence_of(CAMERA, rotations, np.zeros((20, 3)), POINTS[:200])
    pairs = pairs_to_compare(evidence, most=40)
    assert 15 <= len(pairs) <= 40
    assert {frame for pair in pairs for frame in pair} == set(range(20))


def test_the_two_cameras_of_a_rig_are_not_two_viewpoints() -> None:
    positions = np.repeat([[0, 0, 0], [0.2, 0, 0.05]], 4, axis=0)
    evidence = evidence_of(CAMERA, np.array(TURN + TURN), positions, POINTS)
    assert found_in(evidence) is not None
    on_rig = dataclasses.replace(evidence, camera_of={k: k // 4 for k in range(8)})
    pairs = pairs_to_compare(on_rig)
    assert pairs
    assert viewpoints(parallaxes(on_rig, [CAMERA, CAMERA], pairs)) is None


def test_a_room_photographed_from_two_places() -> None:
    room = furnished_room(texel_mm=8.0)
    camera = fisheye(460)
    features = {}
    for k, (rotation, place) in enumerate([(r, p) for p in ((0, 0, 0), (0.45, 0.0, 0.3)) for r in TURN[:3]]):
        picture = photograph(room.seen_from(place), camera, rotation, noise=0.004, seed=k, supersampling=1)
        features[k] = find_features(picture, None, 1000)
    found = found_in(gather_evidence(features, None, lambda items, **_: items), camera)
    assert found is not None
    assert found.groups == ((0, 1, 2), (3, 4, 5))


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.exists(), reason="needs the shared frames")
@pytest.mark.parametrize(
    ("chosen", "groups"), [("12345678", ((0, 1, 2, 3), (4, 5, 6, 7))), ("1234", None), ("5678", None)]
)
def test_two_turns_of_a_real_room(chosen: str, groups: tuple[tuple[int, ...], ...] | None) -> None:
    """With a lens that is only nearly the true one, as while it is being estimated."""
    folder = SHARED / "data" / "frames" / "canon815-set7"
    pictures = [read_picture(folder / f"7-{k}.jpg").pixels for k in chosen]
    half_fov = math.radians(91)
    camera = Camera(Equisolid(1241 / 2 / math.sin(half_fov / 2)), (3840, 2560), (1901, 1276), half_fov=half_fov)
    inside = camera.unproject(np.stack(np.meshgrid(np.arange(3840), np.arange(2560)), -1).reshape(-1, 2))[:, 0]
    mask = np.isfinite(inside).reshape(2560, 3840).astype(np.uint8)
    with thread_pool() as pool:
        features = dict(enumerate(pool.map(lambda picture: find_features(picture, mask, 3000), pictures)))
        evidence = gather_evidence(features, pool, lambda items, **_: items)
    found = found_in(evidence, camera)
    assert groups == (None if found is None else found.groups)
