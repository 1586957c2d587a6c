"""Which way is up: what is asked for, what there is, and where the middle of the panorama looks."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from turning import frame_of, frames_of, orientation, srgb8

from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.level import Levelled, level
from fullsphere.mosaic.options import Levelling
from fullsphere.mosaic.project import Frame
from laws import SEEDS, fisheye, law, rotation

CAMERA = fisheye(300)
DOWN = np.array([0.0, 1.0, 0.0])


def blank(rotations: Sequence[FloatArray]) -> list[Frame]:
    picture = np.zeros((*CAMERA.size[::-1], 3), np.uint8)
    return [frame_of(str(k), picture, r) for k, r in enumerate(rotations)]


def by(source: str, frames: Sequence[Frame], **options: object) -> Levelled:
    return level(frames, [CAMERA], dataclasses.replace(Levelling(source), **options))  # type: ignore[arg-type]


def is_rotation(turn: FloatArray) -> bool:
    return bool(np.allclose(turn @ turn.T, np.eye(3), atol=1e-12) and np.linalg.det(turn) > 0)


def tilt_deg(levelled: Levelled, level_from_now: FloatArray) -> float:
    return float(np.rad2deg(np.arccos((levelled.levelled_from_world @ level_from_now.T @ DOWN)[1])))


@given(seed=SEEDS)
@law(30)
def test_level_cameras_give_the_true_up_and_the_first_one_the_middle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    level_from_now = rotation(seed)
    rotations = [orientation(72 * k + rng.uniform(0, 30), rng.uniform(-50, 50)) @ level_from_now for k in range(5)]
    levelled = by("cameras", blank(rotations))
    assert levelled.source == "camera-x-axes"
    assert is_rotation(levelled.levelled_from_world)
    assert tilt_deg(levelled, level_from_now) < 3
    forward = (rotations[0] @ levelled.levelled_from_world.T)[2]
    assert abs(forward[0]) < 1e-9
    assert forward[2] > 0


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_a_first_camera_that_looks_straight_up_or_down(pitch: float) -> None:
    rotations = [orientation(0, pitch), *(orientation(yaw) for yaw in (0, 70, 150, 250))]
    levelled = by("cameras", blank(rotations))
    assert levelled.source == "camera-x-axes"
    assert is_rotation(levelled.levelled_from_world)
    np.testing.assert_allclose(levelled.levelled_from_world @ DOWN, DOWN, atol=1e-3)
    assert levelled.levelled_from_world[2, 2] == pytest.approx(
        1, abs=1e-6
    )  # the horizon that it was tilted from is the middle


@pytest.mark.parametrize("rotations", [[rotation(3)], [rotation(3)] * 4], ids=["one", "all alike"])
def test_frames_that_look_one_way_tell_nothing(rotations: list[FloatArray]) -> None:
    levelled = by("auto", blank(rotations))
    assert levelled.source == "none"
    assert levelled.sigma_deg is None
    np.testing.assert_allclose(levelled.levelled_from_world, rotations[0], atol=1e-15)
    with pytest.raises(GeometryError, match="--level"):
        by("cameras", blank(rotations))


def test_asked_for_what_there_is_not() -> None:
    frames = blank([orientation(90 * k) for k in range(4)])
    with pytest.raises(GeometryError, match=r"upright lines.*--level cameras"):
        by("verticals", frames)
    with pytest.raises(GeometryError, match=r"no frame tells.*--prior"):
        by("gravity", frames)
    with pytest.raises(GeometryError, match="no registered frame"):
        by("auto", [frames[0].left_out("is blank")])


def test_none_is_the_first_registered_frames_own_world() -> None:
    rotations = [orientation(40 * k) @ rotation(2) for k in range(4)]
    frames = blank(rotations)
    levelled = by("none", [frames[0].left_out("is blank"), *frames[1:]])
    np.testing.assert_array_equal(levelled.levelled_from_world, rotations[1])
    assert levelled.source == "none"


def test_by_hand_is_the_first_frames_orientation() -> None:
    rotations = [orientation(40 * k) @ rotation(2) for k in range(4)]
    told = orientation(-30, 10, 4)
    levelled = by("none", blank(rotations), turn=told.T)
    assert levelled.source == "by-hand"
    np.testing.assert_allclose(rotations[0] @ levelled.levelled_from_world.T, told, atol=1e-12)


def test_the_longitude_asked_for_comes_to_the_middle() -> None:
    frames = blank([orientation(90 * k + 10) for k in range(4)])
    plain, turned = by("cameras", frames), by("cameras", frames, centre_yaw_deg=35.0)
    before = np.array([np.sin(np.deg2rad(35)), 0, np.cos(np.deg2rad(35))])  # at 35 degrees of longitude
    ray = plain.levelled_from_world.T @ before
    np.testing.assert_allclose(turned.levelled_from_world @ ray, [0, 0, 1], atol=1e-12)


def test_gravity_as_the_files_told_it() -> None:
    rng, level_from_now = np.random.default_rng(0), rotation(9)
    frames = []
    for k in range(8):  # rolled anyhow: the cameras' axes tell nothing
        own = orientation(45 * k, rng.uniform(-30, 30), rng.uniform(-180, 180))
        told = own @ DOWN + rng.normal(0, 0.005, 3) if k != 3 else np.array([1.0, 0, 0])  # one of them wrong
        frame = blank([own @ level_from_now])[0]
        if k < 5:
            frame = dataclasses.replace(frame, gravity=told / np.linalg.norm(told))
        frames.append(frame)
    for source in ("gravity", "auto"):
        levelled = by(source, frames)
        assert levelled.source == "gravity"
        assert levelled.sigma_deg is not None
        assert tilt_deg(levelled, level_from_now) < 0.6


def test_a_pose_told_beforehand_tells_gravity() -> None:
    own = [orientation(60 * k, 5, 20) for k in range(6)]
    frames = [dataclasses.replace(f, prior=r) for f, r in zip(blank([r @ rotation(4) for r in own]), own, strict=True)]
    assert tilt_deg(by("auto", frames), rotation(4)) < 1e-6


def test_gravity_that_contradicts_itself_is_not_believed() -> None:
    rng = np.random.default_rng(0)
    frames = [
        dataclasses.replace(f, gravity=g / np.linalg.norm(g))
        for f, g in zip(blank([orientation(45 * k) for k in range(8)]), rng.normal(size=(8, 3)), strict=True)
    ]
    assert by("auto", frames).source == "camera-x-axes"
    with pytest.raises(GeometryError, match="contradict"):
        by("gravity", frames)


@pytest.mark.parametrize("roll", [90.0, -90.0])
def test_frames_held_on_their_sides_stand_upright_by_the_light(roll: float) -> None:
    """The ring does not tell which side they were held on; the sky does."""

    def scene(rays: FloatArray) -> FloatArray:
        return np.stack([0.3 - 0.2 * rays[:, 1], 0.3 - 0.2 * rays[:, 1], np.where(rays[:, 1] < 0, 0.7, 0.2)], -1)

    world = rotation(6)
    rotations = [orientation(60 * k, 0, roll) for k in range(6)] + [orientation(0, 89), orientation(40, -89)]
    frames = frames_of(scene, CAMERA, np.array(rotations), lambda _, light: srgb8(light))
    frames = [dataclasses.replace(f, camera_from_world=r @ world) for f, r in zip(frames, rotations, strict=True)]
    levelled = by("auto", frames)
    assert levelled.source == "camera-x-axes"
    assert tilt_deg(levelled, world) < 2
