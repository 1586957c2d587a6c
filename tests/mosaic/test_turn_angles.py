from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError, InputError, UsageError
from fullsphere.model.lens import Equidistant
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.arm import ArmTurn, mount_angles, mount_of, positions, turned
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.turn_angles import find_turn, turn_of_views
from fullsphere.mosaic.turn_diagnosis import missing_frames
from fullsphere.mosaic.turn_told import told_turn
from fullsphere.mosaic.turn_views import View, view_of

Floats = NDArray[np.float64]
CAMERA = Camera(Equidistant(270.0), (900, 900), (449.5, 450.5), half_fov=math.radians(91.5))
N = 24
EVEN: Floats = np.arange(N) * 2 * np.pi / N
POINTS, NOISE_PX = 360, 0.04


def frame(k: int, camera: Camera = CAMERA) -> Frame:
    return Frame(f"{k:03d}.jpg", "", camera.size, lambda: np.zeros((*camera.size[::-1], 3), np.uint8))


def views_at(
    angles: Floats, mount: Floats | None = None, radius: float = 1.0, range_of: tuple[float, float] = (3, 40)
) -> list[View]:
    """What frames at angles show of points about the arm: keypoints with noise, descriptors all of their own."""
    random = np.random.default_rng(5)
    points = random.normal(size=(POINTS, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= np.exp(random.uniform(math.log(range_of[0]), math.log(range_of[1]), (POINTS, 1)))
    words = np.abs(random.normal(size=(POINTS, 128)))
    words = (words / np.linalg.norm(words, axis=1, keepdims=True)).astype(np.float16)
    mount = np.eye(3) if mount is None else mount
    views = []
    for angle in angles:
        pixels = CAMERA.project((points - radius * positions(angle)) @ turned(angle) @ mount.T)
        seen = np.isfinite(pixels[:, 0])
        pixels = pixels[seen] + NOISE_PX * random.normal(size=(int(seen.sum()), 2))
        views.append(view_of(CAMERA, Features(pixels, words[seen], np.full(len(pixels), NOISE_PX))))
    return views


def solved(views: Sequence[View], order: Sequence[int] | None = None, straight: bool = False) -> ArmTurn:
    order = range(len(views)) if order is None else order
    return turn_of_views(
        [frame(k) for k in order], CAMERA, {a: views[k] for a, k in enumerate(order)}, straight=straight
    )


def off_deg(turn: ArmTurn, true: Floats) -> Floats:
    """By how much angles (n,) are wrong, but for a turn of all, degrees."""
    told = np.array([true[int(one.id[:3])] for one in turn.frames])
    off = (turn.angles - told - (turn.angles - told)[0] + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(np.degrees(off - off.mean()))


@pytest.fixture(scope="module")
def uneven() -> tuple[Floats, list[View]]:
    angles = EVEN + np.random.default_rng(1).normal(0, math.radians(0.5), N)
    return angles, views_at(angles, mount_of(*np.radians([0.3, 0.8, 0.6])))


@pytest.fixture(scope="module")
def even() -> list[View]:
    return views_at(EVEN)


def test_angles_and_mount_are_found(uneven: tuple[Floats, list[View]]) -> None:
    angles, views = uneven
    turn = solved(views)
    assert np.abs(off_deg(turn, angles)).max() < 0.02
    assert np.abs(np.degrees(mount_angles(turn.mount)) - [0.3, 0.8, 0.6]).max() < 0.03
    assert turn.sigmas is not None
    assert 0.5 < np.sqrt(np.mean((off_deg(turn, angles) / np.degrees(turn.sigmas)) ** 2)) < 2
    assert turn.angles[0] == 0
    assert turn.frames[0].id == "000.jpg"
    assert not turn.diagnosis
    assert turn.quality["held_out_px"] == pytest.approx(NOISE_PX, rel=0.15)


def test_an_arm_may_turn_to_the_left(uneven: tuple[Floats, list[View]]) -> None:
    angles, views = uneven
    turn = solved(views, range(N)[::-1])
    assert np.abs(off_deg(turn, angles)).max() < 0.02
    assert not turn.diagnosis


@pytest.mark.parametrize("quarter", [1, 3])
def test_a_camera_may_be_held_on_its_side(quarter: int) -> None:
    views = views_at(EVEN, mount_of(0.0, 0.01, quarter * math.pi / 2))
    frames = [dataclasses.replace(frame(k), quarter_turns=quarter) for k in range(N)]
    turn = turn_of_views(frames, CAMERA, dict(enumerate(views)))
    assert np.abs(off_deg(turn, EVEN)).max() < 0.02
    assert abs(math.degrees(mount_angles(turn.mount)[1]) - math.degrees(0.01)) < 0.03


def test_frames_out_of_order_are_sorted(even: list[View]) -> None:
    turn = solved(even, [*range(8), *range(17, 20), *range(8, 17), *range(20, N)])
    assert [one.id for one in turn.frames] == [frame(k).id for k in range(N)]
    assert "not in the order of turning" in turn.diagnosis[0]


def test_frames_in_no_order_are_sorted(even: list[View]) -> None:
    order = [int(k) for k in np.random.default_rng(0).permutation(N)]
    turn = solved(even, order)
    assert len(turn.frames) == N
    ranks = np.array([int(one.id[:3]) for one in turn.frames])
    assert (np.diff(ranks) % N == 1).all() or (np.diff(ranks) % N == N - 1).all()


def test_less_than_a_full_turn_is_refused(even: list[View]) -> None:
    with pytest.raises(GeometryError, match=r"cover 255 degrees.*105 degrees between 017\.jpg and 000\.jpg"):
        solved(even, range(18))


def test_what_is_more_than_a_full_turn_is_left_out(even: list[View]) -> None:
    more = views_at(EVEN[:3] + np.array([0, 0.02, 0.02]))
    turn = solved([*even, *more])
    assert [one.id for one in turn.frames] == [frame(k).id for k in range(N)]
    assert "more than one full turn" in turn.diagnosis[0]
    assert "024.jpg, 025.jpg, 026.jpg" in turn.diagnosis[0]


def test_a_missing_frame_is_told_and_a_hole_refused() -> None:
    angles = np.arange(32) * 2 * np.pi / 32
    views = views_at(angles)
    turn = solved(views, [*range(20), *range(21, 32)])
    assert "missing between 019.jpg and 021.jpg" in turn.diagnosis[0]
    with pytest.raises(GeometryError, match="less than a full turn"):
        solved(views, [*range(20), *range(24, 32)])


@pytest.mark.parametrize("count", [60, 180])
@pytest.mark.parametrize(("gone", "seem"), [([20], "a frame seems"), ([20, 21], "2 frames seem")])
def test_frames_missing_in_a_regular_turn_are_told(count: int, gone: list[int], seem: str) -> None:
    step = 2 * np.pi / count
    angles = np.delete(np.arange(count) * step + np.random.default_rng(2).normal(0, 0.02 * step, count), gone)
    ids = [str(k) for k in np.delete(np.arange(count), gone)]
    said = missing_frames(np.sort(angles), ids)
    assert f"{seem} to be missing between 19 and {gone[-1] + 1}:" in said[0]
    assert len(said) == 1


def test_frames_missing_in_two_places_are_told() -> None:
    angles = np.delete(np.arange(60) * 2 * np.pi / 60, [20, 21, 40])
    assert "between 19 and 20, and in 1 more place:" in missing_frames(angles, [str(k) for k in range(57)])[0]


@pytest.mark.parametrize("count", [24, 60, 180])
@pytest.mark.parametrize("jitter", [0.0, 0.02, 0.1, 0.25, 0.4])
def test_of_an_uneven_turn_no_frame_is_missing(count: int, jitter: float) -> None:
    for seed in range(20):
        angles = np.arange(count) + np.random.default_rng(seed).normal(0, jitter, count)
        within = np.sort(np.mod((angles - angles.min()) * 2 * np.pi / count, 2 * np.pi))
        assert not missing_frames(within, [str(k) for k in range(count)])


def test_of_an_arm_that_turns_faster_and_slower_no_frame_is_missing() -> None:
    even = np.arange(90) * 2 * np.pi / 90
    assert not missing_frames(even + 0.4 * np.sin(even), [str(k) for k in range(90)])
    hasty = np.delete(even, 30)
    hasty[30:] -= 0.4 * even[1]  # 1.6 steps after it
    assert not missing_frames(hasty, [str(k) for k in range(89)])


def test_where_the_arm_stood_still_frames_are_left_out(even: list[View]) -> None:
    turn = solved([*even[:11], *views_at(EVEN[[10, 10]]), *even[11:]])
    assert len(turn.frames) == N
    assert "stood still" in turn.diagnosis[0]


def test_an_arm_may_stop_for_many_frames() -> None:
    turn = solved(views_at(np.repeat(EVEN[::2], 3)))
    assert [one.id for one in turn.frames] == [frame(k).id for k in range(0, 36, 3)]
    assert "stood still" in turn.diagnosis[0]
    assert len(turn.diagnosis) == 1


def test_frames_of_another_place_are_left_out_by_name(even: list[View]) -> None:
    random = np.random.default_rng(3)
    views = list(even)
    for k in (0, 7):
        features = views[k].features
        strange = features.descriptors[:, random.permutation(128)]
        views[k] = views[k]._replace(features=dataclasses.replace(features, descriptors=strange))
    turn = solved(views)
    assert len(turn.frames) == N - 2
    assert any("000.jpg, 007.jpg: nothing in common" in sentence for sentence in turn.diagnosis)


def test_a_camera_that_turns_about_its_own_centre_makes_no_stereo() -> None:
    with pytest.raises(GeometryError, match=r"no stereo.*fullsphere stitch"):
        solved(views_at(EVEN, radius=0.0))


def test_a_world_that_is_far_makes_no_stereo() -> None:
    with pytest.raises(GeometryError, match="no stereo"):
        solved(views_at(EVEN, range_of=(3000, 5000)))


def test_a_camera_that_looks_inward_is_refused() -> None:
    with pytest.raises(GeometryError, match="looks to the axis"):
        solved(views_at(EVEN, mount_of(math.pi, 0, 0)))


def test_frames_that_do_not_turn_are_refused() -> None:
    with pytest.raises(GeometryError, match="hardly turn"):
        solved(views_at(EVEN / 400))


def test_a_camera_far_off_the_arm_is_told_of(even: list[View]) -> None:
    turn = solved(views_at(EVEN, mount_of(0, math.radians(2.2), 0)))
    assert math.degrees(mount_angles(turn.mount)[1]) == pytest.approx(2.2, abs=0.03)
    assert "2.2" in turn.diagnosis[0]
    assert "stay empty" in turn.diagnosis[0]


def told(views: Sequence[View], angles: Floats, straight: bool = False) -> ArmTurn:
    frames = [frame(k) for k in range(len(views))]
    return told_turn(frames, CAMERA, angles, lambda indices: {k: views[k] for k in indices}, straight=straight)


def test_the_mount_is_found_with_angles_told(uneven: tuple[Floats, list[View]]) -> None:
    angles, views = uneven
    turn = told(views, angles)
    assert np.abs(np.degrees(mount_angles(turn.mount)) - [0.3, 0.8, 0.6]).max() < 0.03
    assert not turn.diagnosis
    assert (turn.angles == np.sort(np.mod(angles, 2 * np.pi))).all()


def test_a_straight_camera_stays_straight(even: list[View]) -> None:
    turn = told(even, EVEN, straight=True)
    assert (turn.mount == np.eye(3)).all()
    assert not turn.diagnosis


def test_a_camera_told_to_be_straight_that_is_not_is_told_of(uneven: tuple[Floats, list[View]]) -> None:
    angles, views = uneven
    turn = told(views, angles, straight=True)
    assert (turn.mount == np.eye(3)).all()
    assert "pitch 0.80, roll 0.60" in turn.diagnosis[0]


def test_angles_told_the_other_way_are_refused(even: list[View]) -> None:
    with pytest.raises(GeometryError, match="turn the other way"):
        told(even, -EVEN)


def test_even_steps_of_frames_that_are_less_are_refused() -> None:
    with pytest.raises(GeometryError, match="less than a full turn, about 306 degrees; give the rest"):
        told(views_at(EVEN * 0.85), EVEN)


def test_even_steps_of_frames_out_of_order_are_refused(even: list[View]) -> None:
    with pytest.raises(GeometryError, match="contradict"):
        told([*even[:8], *even[17:20], *even[8:17], *even[20:]], EVEN)


def test_even_steps_of_an_uneven_turn_are_told(uneven: tuple[Floats, list[View]]) -> None:
    assert "--angles auto" in told(uneven[1], EVEN).diagnosis[0]


def test_angles_that_are_no_full_turn_are_refused(even: list[View]) -> None:
    with pytest.raises(GeometryError, match="less than a full turn"):
        told(even, EVEN / 2)
    with pytest.raises(GeometryError, match="the same turn angle"):
        told(even, np.r_[EVEN[:-1], EVEN[3]])


SMALL = Camera(Equidistant(74.0), (244, 244), (121.5, 122.5), half_fov=math.radians(91.5))


def room_pictures(angles: Floats, camera: Camera) -> list[Picture]:
    """Small frames of a box with painted walls, in arm lengths."""
    random = np.random.default_rng(0)
    walls = []
    for _ in range(6):
        wall = np.full((512, 512), 110, np.float32)
        for _ in range(260):
            (x, y), (w, h) = random.integers(0, 512, 2), random.integers(6, 60, 2)
            cv2.rectangle(wall, (int(x), int(y)), (int(x + w), int(y + h)), float(random.integers(10, 250)), -1)
        walls.append(cv2.GaussianBlur(wall, (0, 0), 1.0))
    half, middle = np.array([9.0, 6.0, 11.0]), np.array([1.0, -1.0, 2.0])
    rays = camera.unproject(np.stack(np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1])), -1))
    made = []
    for angle in angles:
        rest, ahead = positions(angle) - middle, np.nan_to_num(rays @ turned(angle).T, nan=1e-3)
        far = (np.sign(ahead) * half - rest) / ahead
        axis = far.argmin(-1)
        hit = (rest + ahead * far.min(-1, keepdims=True)) / half
        side = np.take_along_axis(ahead, axis[..., None], -1)[..., 0] > 0
        picture = np.zeros(axis.shape, np.float32)
        for face in range(6):
            u, v = (hit[..., k] for k in range(3) if k != face // 2)
            shown = cv2.remap(walls[face], *(((1 + w) * 255.5).astype(np.float32) for w in (u, v)), cv2.INTER_LINEAR)
            here = (axis == face // 2) & (side == bool(face % 2))
            picture[here] = shown[here]
        picture[np.isnan(rays[..., 0])] = 0
        made.append(np.repeat(np.round(picture).astype(np.uint8)[..., None], 3, axis=2))
    return made


@pytest.fixture(scope="module")
def small() -> tuple[Floats, list[Picture]]:
    angles = np.arange(14) * 2 * np.pi / 14 + np.random.default_rng(4).normal(0, 0.01, 14)
    return angles, room_pictures(angles, SMALL)


def frames_of(pictures: Sequence[Picture]) -> list[Frame]:
    return [Frame(f"{k:03d}.png", "", SMALL.size, lambda k=k: pictures[k]) for k in range(len(pictures))]  # type: ignore[misc]


def test_angles_are_found_in_pictures_each_opened_once_and_doubles_left_out(
    small: tuple[Floats, list[Picture]],
) -> None:
    angles, pictures = small
    opened: list[str] = []

    def picture_of(one: Frame) -> Picture:
        opened.append(one.id)
        return one.load()

    turn = find_turn(frames_of(pictures), SMALL, picture_of=picture_of)
    assert np.abs(off_deg(turn, angles)).max() < 0.15
    assert np.abs(np.degrees(mount_angles(turn.mount))).max() < 0.3
    assert sorted(opened) == [f"{k:03d}.png" for k in range(14)]
    twice = [dataclasses.replace(one, sha256=one.id) for one in frames_of(pictures)]
    twice.insert(5, dataclasses.replace(twice[4], id="again.png"))
    with thread_pool(2) as executor:
        again = find_turn(twice, SMALL, executor)
    assert (again.angles == turn.angles).all()
    assert (again.mount == turn.mount).all()
    assert not turn.diagnosis
    assert "again.png" in again.diagnosis[0]


def test_too_few_frames_a_wrong_camera_and_wrong_angles_are_refused(small: tuple[Floats, list[Picture]]) -> None:
    frames = frames_of(small[1])
    with pytest.raises(InputError, match="at least 8 frames"):
        find_turn(frames[:2], SMALL)
    with pytest.raises(InputError, match=r"000\.png: is 244 x 244 pixels, the camera is for 900 x 900"):
        find_turn(frames, CAMERA)
    with pytest.raises(UsageError, match="one angle for each frame"):
        find_turn(frames, SMALL, angles=EVEN[:3])


def test_angles_told_open_some_frames_only(small: tuple[Floats, list[Picture]]) -> None:
    angles, pictures = small
    turn = find_turn(frames_of(pictures), SMALL, angles=angles)
    assert np.abs(np.degrees(mount_angles(turn.mount))).max() < 0.3
