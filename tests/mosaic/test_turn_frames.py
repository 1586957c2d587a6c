import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from fullsphere.model.errors import InputError
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.turn_frames import even_angles, open_turn, read_angles


def frames(count: int) -> list[Frame]:
    return [Frame(f"f{k}.png", "", (4, 4), lambda: np.zeros((4, 4, 3), np.uint8)) for k in range(count)]


def pictures(folder: Path, count: int, side: int = 24) -> list[Path]:
    paths = [folder / f"f{k}.png" for k in range(count)]
    for k, path in enumerate(paths):
        cv2.imwrite(str(path), np.full((side, side, 3), 10 + k, np.uint8))
    return paths


def told(folder: Path, text: str) -> Path:
    path = folder / "angles.txt"
    path.write_text(text)
    return path


def test_even_steps_go_round_to_either_side() -> None:
    np.testing.assert_allclose(even_angles(frames(4)), np.radians([0, 90, 180, 270]))
    np.testing.assert_allclose(even_angles(frames(4), to_the_right=False), np.radians([0, 270, 180, 90]))


def test_a_file_given_twice_is_no_step() -> None:
    turn = [dataclasses.replace(one, sha256=one.id) for one in frames(4)]
    turn.insert(2, dataclasses.replace(turn[1], id="copy.png"))
    np.testing.assert_allclose(even_angles(turn), np.radians([0, 90, 90, 180, 270]))


def test_angles_are_read_by_name_or_in_order(tmp_path: Path) -> None:
    by_name = told(tmp_path, "# a turn\nf1.png, 20.5\n\nf0.png\t-3  # slipped\n")
    np.testing.assert_allclose(read_angles(by_name, frames(2)), np.radians([-3, 20.5]))
    spaced = [dataclasses.replace(one, id=f"my turn, {one.id}") for one in frames(2)]
    text = "my turn, f0.png 4\nmy turn, f1.png,5\n"
    np.testing.assert_allclose(read_angles(told(tmp_path, text), spaced), np.radians([4, 5]))
    np.testing.assert_allclose(read_angles(told(tmp_path, "1\n2\n3"), frames(3)), np.radians([1, 2, 3]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("f0.png 1\n", "no angle for f1.png"),
        ("f0.png 1\nf0.png 2\n", "line 2: f0.png has an angle already"),
        ("1\n2\n3\n", "3 angles, and there are 2 frames"),
        ("f0.png 1\nf1.png north\n", "line 2: 'north' is no angle"),
        ("f0.png 1\n7\n", "line 2 is not like the others"),
        ("# nothing\n", "no angles"),
        ("a b c\n", "line 1: 'c' is no angle"),
        ("0,5\n6,5\n", "line 1: '0' is no frame of these.*decimal point"),
        ("0\n1\n2\n3\n4\n5\n6\n6.2\n", "radians"),
        ("nan\n1\n", "line 1: 'nan'"),
    ],
)
def test_angles_that_cannot_be_used_are_refused_with_their_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_angles(told(tmp_path, text), frames(2))


def test_only_pictures_of_the_cameras_size_are_taken(tmp_path: Path) -> None:
    paths = pictures(tmp_path, 10)
    cv2.imwrite(str(paths[3]), np.zeros((12, 24, 3), np.uint8))
    paths[5].write_bytes(paths[4].read_bytes())
    paths.append(told(tmp_path, "no picture"))
    found = open_turn(paths, (24, 24))
    reasons = {frame.id: frame.reason for frame in found if frame.reason}
    assert reasons["f3.png"] == "is 24 x 12 pixels, the camera is for 24 x 24"
    assert reasons["f5.png"] == "is the same file as f4.png"
    assert set(reasons) == {"f3.png", "f5.png", "angles.txt"}


def test_too_few_frames_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least 8 frames, and 5 of the 5"):
        open_turn(pictures(tmp_path, 5), (24, 24))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.png: there is no such file"):
        open_turn([tmp_path / "gone.png"], (24, 24))
