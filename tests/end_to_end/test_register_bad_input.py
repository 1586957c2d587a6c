"""Bad frames among good ones: each is named with its reason, and the others are registered as without it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from picture_files import picture_file
from rooms import Outcome, Set

from fullsphere.cli.main import main
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import save_camera
from fullsphere.mosaic import Mosaic, load_mosaic
from fullsphere.mosaic.truth import rotation_errors_deg

Run = Callable[..., Outcome]
Make = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]


class Alone(NamedTuple):
    """Frames, their true camera_from_world, their camera, and the mosaic that they make without any bad one."""

    frames: tuple[Path, ...]
    truth: tuple[FloatArray, ...]
    camera: Path
    mosaic: Mosaic
    worst_deg: float


@pytest.fixture(scope="module")
def alone(room_set: Set, tmp_path_factory: pytest.TempPathFactory) -> Alone:
    output, frames = tmp_path_factory.mktemp("alone") / "m.json", room_set.frames[:3]
    assert main(["register", *map(str, frames), "-o", str(output), "--camera", str(room_set.camera_file)]) == 0
    truth = tuple(shot.camera_from_world for shot in room_set.shots[:3])
    mosaic = load_mosaic(output)
    return Alone(frames, truth, room_set.camera_file, mosaic, errors_deg(mosaic, frames, truth).max())


def errors_deg(mosaic: Mosaic, frames: Sequence[Path], truth: Sequence[FloatArray]) -> FloatArray:
    """How far the frames are turned from the truth; all of them have to be registered, and no other."""
    found = {frame.id: frame.camera_from_world for frame in mosaic.registered}
    assert set(found) == {path.name for path in frames}
    return rotation_errors_deg([rotation for rotation in found.values() if rotation is not None], truth)[0]


def read(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), np.uint8)


def plain(level: int) -> Make:
    return lambda good: np.full_like(good, level)


def noise(good: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, good.shape, np.uint8)


def overexposed(good: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(np.clip(good * 20.0 + 60, 0, 255), np.uint8)


USELESS: dict[str, tuple[Make, str]] = {
    "blank": (plain(90), "is blank: all its pixels are alike"),
    "white": (plain(255), "is overexposed: 100 % of its pixels are white"),
    "black": (plain(0), "is black: 100 % of its pixels hold no light"),
    "saturated": (overexposed, "is overexposed"),
    "noise": (noise, "shows nothing but noise"),
    "mirrored": (lambda good: good[:, ::-1], "is mirrored: flipped from left to right it agrees with"),
    "half": (lambda good: good[::2, ::2], "is 320 x 320 pixels, the camera is for 640 x 640"),
    "one pixel": (lambda good: good[:1, :1], "is 1 x 1 pixels"),
}


@pytest.mark.parametrize(("make", "reason"), USELESS.values(), ids=USELESS.keys())
def test_a_picture_that_is_no_good_is_named(
    alone: Alone, fullsphere: Run, tmp_path: Path, make: Make, reason: str
) -> None:
    cv2.imwrite(str(tmp_path / "odd.png"), make(read(alone.frames[1])))
    assert_named(alone, fullsphere, tmp_path / "odd.png", reason)


def test_a_frame_of_another_scene_is_named(alone: Alone, room_set: Set, fullsphere: Run) -> None:
    assert_named(alone, fullsphere, room_set.other_room, "does not overlap the other frames, or shows another place")


def test_the_same_bytes_under_another_name_are_named(alone: Alone, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "copy.jpg").write_bytes(alone.frames[1].read_bytes())
    assert_named(alone, fullsphere, tmp_path / "copy.jpg", "is the same file as frame_1.jpg")


def test_a_copy_saved_anew_is_named(alone: Alone, fullsphere: Run, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "anew.jpg"), read(alone.frames[1]), [cv2.IMWRITE_JPEG_QUALITY, 60])
    assert_named(alone, fullsphere, tmp_path / "anew.jpg", "is a copy of frame_1.jpg, saved anew")


FILES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "truncated": (lambda whole: whole[: len(whole) // 2], "damaged"),
    "empty": (lambda whole: b"", "is empty; copy it again from the camera"),
    "text": (lambda whole: b"these are words", "is not a picture that can be read"),
}


@pytest.mark.parametrize(("damage", "reason"), FILES.values(), ids=FILES.keys())
def test_a_file_that_cannot_be_read_is_named(
    alone: Alone, fullsphere: Run, tmp_path: Path, damage: Callable[[bytes], bytes], reason: str
) -> None:
    (tmp_path / "odd.jpg").write_bytes(damage(alone.frames[1].read_bytes()))
    assert_named(alone, fullsphere, tmp_path / "odd.jpg", reason)


def test_a_folder_among_the_frames_is_named(alone: Alone, fullsphere: Run, tmp_path: Path) -> None:
    assert_named(alone, fullsphere, tmp_path, "is a folder")


def assert_named(alone: Alone, fullsphere: Run, odd: Path, reason: str) -> None:
    """The frame is warned of by name, the others are where they are without it; --strict makes that exit code 3."""
    output = alone.camera.parent / "with_odd.json"
    common = ("--camera", alone.camera, "--strict", "--overwrite")
    run = fullsphere("register", *alone.frames, odd, "-o", output, *common)
    assert run.code == 3
    assert len(run.warnings) == 1
    assert f"{odd.name} is left out: " in run.warnings[0]
    assert reason in run.warnings[0]
    mosaic = load_mosaic(output)
    assert len(mosaic.frames) == 4
    assert errors_deg(mosaic, alone.frames, alone.truth).max() < 1.2 * alone.worst_deg + 0.001


def test_bad_frames_do_not_bend_a_lens_that_is_found_from_the_others(
    room_set: Set, fullsphere: Run, tmp_path: Path
) -> None:
    for name in ("white", "noise", "saturated"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), USELESS[name][0](read(room_set.frames[1])))
    odd = sorted(tmp_path.glob("*.png"))
    good, both = tmp_path / "good.json", tmp_path / "both.json"
    assert fullsphere("register", *room_set.frames, "-o", good).code == 0
    assert fullsphere("register", *room_set.frames, *odd, "-o", both).code == 0
    without, among = load_mosaic(good), load_mosaic(both)
    assert {frame.id for frame in among.frames if not frame.registered} == {path.name for path in odd}
    assert among.camera.half_fov == pytest.approx(without.camera.half_fov, abs=np.radians(0.3))
    truth = [shot.camera_from_world for shot in room_set.shots]
    for mosaic in (without, among):
        known_to = max(frame.sigma_deg or 0 for frame in mosaic.registered)
        assert 0 < known_to < 0.01
        assert errors_deg(mosaic, room_set.frames, truth).max() < 3 * known_to


def test_a_frame_given_twice_counts_once(alone: Alone, fullsphere: Run, tmp_path: Path) -> None:
    output = tmp_path / "m.json"
    run = fullsphere("register", *alone.frames, alone.frames[0], "-o", output, "--camera", alone.camera)
    assert run.code == 0
    assert [line.split(": ", 2)[2] for line in run.warnings] == [
        "frame_0.jpg:2 is left out: is frame_0.jpg given again"
    ]
    assert len(load_mosaic(output).registered) == 3


class Wide(NamedTuple):
    """The good frames cut to landscape pictures, and the camera that takes such ones."""

    pictures: list[NDArray[np.uint8]]
    camera: Path


@pytest.fixture
def landscape(alone: Alone, room_set: Set, tmp_path: Path) -> Wide:
    top, bottom = 50, 590
    u, v = room_set.camera.centre
    camera = dataclasses.replace(room_set.camera, size=(640, bottom - top), centre=(u, v - top))
    save_camera(tmp_path / "landscape.json", camera)
    return Wide([np.ascontiguousarray(read(path)[top:bottom, :, ::-1]) for path in alone.frames], tmp_path)


def test_portrait_and_landscape_are_one_set(alone: Alone, landscape: Wide, fullsphere: Run, tmp_path: Path) -> None:
    turns = (0, 1, 0)  # the second was turned upright by a program
    names = [f"frame_{k}.jpg" for k in range(3)]
    for name, picture, turn in zip(names, landscape.pictures, turns, strict=True):
        picture_file(tmp_path / name, np.ascontiguousarray(np.rot90(picture, turn)))
    run = registered(fullsphere, tmp_path, names)
    assert len(run.warnings) == 1
    assert "1 frame with exchanged sides turned back" in run.warnings[0]
    assert_as_good(alone, tmp_path)


def test_exif_orientation_does_not_turn_what_the_sensor_saw(
    alone: Alone, landscape: Wide, fullsphere: Run, tmp_path: Path
) -> None:
    names = [f"frame_{k}.jpg" for k in range(3)]
    for name, picture, orientation in zip(names, landscape.pictures, (1, 6, 3), strict=True):
        picture_file(tmp_path / name, picture, orientation)
    assert registered(fullsphere, tmp_path, names).warnings == []
    assert_as_good(alone, tmp_path)


def registered(fullsphere: Run, folder: Path, names: Sequence[str]) -> Outcome:
    run = fullsphere(
        *("register", *[folder / name for name in names], "-o", folder / "m.json"),
        *("--camera", folder / "landscape.json"),
    )
    assert run.code == 0, run.err
    return run


def assert_as_good(alone: Alone, folder: Path) -> None:
    errors = errors_deg(load_mosaic(folder / "m.json"), alone.frames, alone.truth)
    assert errors.max() < 2 * alone.worst_deg + 0.002


def test_frames_of_which_none_is_any_good_are_each_told(fullsphere: Run, tmp_path: Path) -> None:
    for name, level in (("a.png", 90), ("b.png", 255)):
        cv2.imwrite(str(tmp_path / name), np.full((300, 400, 3), level, np.uint8))
    (tmp_path / "c.png").write_text("words")
    paths = [tmp_path / name for name in ("a.png", "b.png", "c.png")]
    run = fullsphere("register", *paths, "-o", tmp_path / "m.json")
    assert run.code == 4
    assert "no two frames see the same things" in run.error_line
    assert [line.split()[2] for line in run.warnings] == ["a.png", "b.png", "c.png"]
    assert "is blank" in run.warnings[0]
    assert "is overexposed" in run.warnings[1]
    assert "is not a picture" in run.warnings[2]
    assert not (tmp_path / "m.json").exists()


def test_two_frames_without_overlap_are_no_mosaic(alone: Alone, room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("register", alone.frames[0], room_set.other_room, "-o", tmp_path / "m.json")
    assert run.code == 4
    assert "do the frames overlap" in run.error_line
    assert list(tmp_path.iterdir()) == []


def test_one_frame_is_no_mosaic(alone: Alone, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "empty.jpg").touch()
    run = fullsphere("register", alone.frames[0], tmp_path / "empty.jpg", "-o", tmp_path / "m.json")
    assert run.code == 3
    assert "1 of the 2 given can be used (empty.jpg: is empty" in run.error_line
    assert fullsphere("register", alone.frames[0], "-o", tmp_path / "m.json").code == 3


@pytest.mark.parametrize("one_for_all", [True, False], ids=["one for all", "of one frame"])
def test_a_mask_of_another_size_is_refused_by_both_sizes(
    alone: Alone, fullsphere: Run, tmp_path: Path, one_for_all: bool
) -> None:
    mask = tmp_path / "frame_1_mask.png"
    cv2.imwrite(str(mask), np.full((20, 30), 255, np.uint8))
    run = fullsphere(
        *("register", *alone.frames, "-o", tmp_path / "m.json", "--camera", alone.camera),
        *("--mask", mask if one_for_all else tmp_path),
    )
    assert run.code == 3
    assert f"{mask}: is a mask of 30 x 20 pixels" in run.error_line
    assert "640 x 640" in run.error_line
    assert not (tmp_path / "m.json").exists()
