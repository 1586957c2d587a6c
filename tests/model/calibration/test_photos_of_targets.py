"""From photos to views: coded boards of both kinds, the second search, copies and faults named."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from board_photos import board_pose, photograph_board, truth, wide_camera
from fullsphere.model.calibration.board import Board
from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.calibrate import calibrate
from fullsphere.model.calibration.detect import find_marks
from fullsphere.model.calibration.photos import Photo, views_of_photos
from fullsphere.model.calibration.search_again import find_rectified, search_again
from fullsphere.model.calibration.targets import Target
from fullsphere.model.errors import InputError
from fullsphere.model.lens import FloatArray

SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[3].parent / "shared"))
REAL = SHARED / "data" / "calibration"
CAMERA = wide_camera()
BOARDS: dict[str, Board] = {
    "aprilgrid": AprilGrid(4, 3, 40.0, 0.3),
    "thin-border": AprilGrid(4, 3, 40.0, 0.3, 20, border_modules=1),
    "charuco": CharucoBoard(7, 5, 30.0, 21.0),
}
PLACES = {"ahead": (10, 0, 130, 20, 10), "side": (55, 140, 150, 10, 60), "rim": (72, 250, 130, 0, -30)}


def taken(board: Board, place: tuple[float, ...]) -> tuple[NDArray[np.uint8], tuple[FloatArray, FloatArray]]:
    pose = board_pose(board, *place)
    return photograph_board(board, CAMERA, pose), pose


def photo(name: str, pixels: NDArray[np.uint8]) -> Photo:
    return Photo(name, lambda: pixels)


@pytest.mark.parametrize(
    ("kind", "where"), [*((kind, where) for kind in BOARDS for where in ("ahead", "side")), ("charuco", "rim")]
)
def test_marks_of_coded_boards_are_where_the_truth_is(kind: str, where: str) -> None:
    board = BOARDS[kind]
    target = Target(kind, (board,))
    picture, pose = taken(board, PLACES[where])
    expected = truth(board, CAMERA, pose)
    seen = np.isfinite(expected).all(1) & (expected > 2).all(1) & (expected < np.array(CAMERA.size) - 3).all(1)
    first = find_marks(picture, target)
    assert len(first.marks) >= 0.2 * seen.sum()
    again = search_again(picture, target, CAMERA, *pose, first)
    assert len(again.marks) >= 0.9 * seen.sum()
    for found, most in ((first, 0.08), (again, 0.06)):
        error = np.linalg.norm(found.pixels - expected[found.marks], axis=1)
        assert np.median(error) < most and error.max() < 0.5
    assert not len(find_marks(np.ascontiguousarray(picture[:, ::-1]), target).marks)


@pytest.mark.parametrize("kind", ["aprilgrid", "charuco"])
def test_a_camera_that_is_a_little_wrong_leads_to_the_same_marks(kind: str) -> None:
    board = BOARDS[kind]
    target = Target(kind, (board,))
    picture, (turn, shift) = taken(board, PLACES["side"])
    wrong = dataclasses.replace(CAMERA, lens=CAMERA.lens.scaled(1.01))
    few = find_marks(picture, target)
    few = few._replace(marks=few.marks[::3], pixels=few.pixels[::3])
    again = search_again(picture, target, wrong, turn, shift, few)
    expected = truth(board, CAMERA, (turn, shift))
    assert len(again.marks) > 2 * len(few.marks)
    assert np.linalg.norm(again.pixels - expected[again.marks], axis=1).max() < 0.5


def test_rectified_windows_show_the_marks_where_they_are() -> None:
    board = BOARDS["charuco"]
    picture, pose = taken(board, PLACES["side"])
    found = find_rectified(picture, Target("board", (board,)), CAMERA)
    error = np.linalg.norm(found.pixels - truth(board, CAMERA, pose)[found.marks], axis=1)
    assert len(found.marks) > 5 and np.median(error) < 0.2


def test_photos_become_views_and_the_camera_follows() -> None:
    board = BOARDS["charuco"]
    target = Target("board", (board,))
    places = [
        (5, 0, 110, 25, 0),
        (40, 90, 110, -20, 40),
        (40, 210, 120, 15, 90),
        (60, 330, 120, 10, 200),
        (70, 30, 115, 0, 300),
    ]
    photos = [photo(f"{k}.png", taken(board, place)[0]) for k, place in enumerate(places)]
    blank = np.full(photos[0].read().shape, 90, np.uint8)
    seen = views_of_photos([*photos, photo("copy.png", photos[2].read()), photo("blank.png", blank)], target)
    assert [view.image for view in seen.views] == [p.name for p in photos]
    assert seen.found == 6 and seen.image_size == CAMERA.size
    reasons = {left.image: left.reason for left in seen.left_out}
    assert "2.png" in reasons["copy.png"] and "no marks" in reasons["blank.png"]
    found = calibrate(seen.views, seen.image_size)
    theta = np.radians(np.arange(5, found.observed_theta_deg[1]))
    assert np.abs(found.camera.lens.radius(theta) - CAMERA.lens.radius(theta)).max() < 0.5
    assert found.rms_px < 0.1


def test_discs_are_seen_at_their_centres_and_grids_are_numbered_alike() -> None:
    board = CirclesGrid(7, 5, 20.0, 12.0)
    target = Target("discs", (board,))
    places = [
        (15, 0, 120, 25, 0),
        (35, 90, 120, -25, 10),
        (35, 210, 130, 25, -10),
        (30, 330, 120, -20, 5),
        (20, 150, 110, 10, 182),
    ]
    poses = [board_pose(board, *place) for place in places]
    photos = [photo(f"{k}.png", photograph_board(board, CAMERA, pose)) for k, pose in enumerate(poses)]
    seen = views_of_photos(photos, target)
    assert len(seen.views) == len(photos)
    marks = board.marks_on_target()
    for view, pose in zip(seen.views, poses, strict=True):
        near = truth(board, CAMERA, pose)
        distance = np.linalg.norm(view.pixels[:, None] - near, axis=-1)
        assert np.median(distance.min(1)) < 0.08
    firsts = [view.pixels[np.argmin(np.linalg.norm(view.points_on_target - marks[0], axis=1))] for view in seen.views]
    sides = [
        np.linalg.norm(first - truth(board, CAMERA, pose)[0]) < 3 for first, pose in zip(firsts, poses, strict=True)
    ]
    assert all(sides[:4]) or not any(sides[:4])  # all one way up, whichever
    assert sides[4] != sides[0]  # the camera was turned over: its picture cannot tell that from a board turned over


def test_faults_are_named() -> None:
    charuco = CharucoBoard(7, 5, 30.0, 21.0)
    picture, _ = taken(charuco, PLACES["ahead"])
    with pytest.raises(InputError, match=r"b\.png: 400 x 640 pixels"):
        views_of_photos(
            [photo("a.png", picture), photo("c.png", picture), photo("b.png", picture[:, :400])],
            Target("t", (charuco,)),
        )
    flipped = np.ascontiguousarray(picture[:, ::-1])
    with pytest.raises(InputError, match=r"a\.png: .*mirrored"):
        views_of_photos([photo("a.png", flipped)], Target("t", (charuco,)))
    other = CharucoBoard(7, 5, 30.0, 21.0, 0, "DICT_6X6_1000")
    with pytest.raises(InputError, match="DICT_5X5_1000 are seen"):
        views_of_photos([photo("a.png", picture)], Target("t", (other,)))
    shifted = CharucoBoard(7, 5, 30.0, 21.0, 100)
    with pytest.raises(InputError, match="the target has 100 to 116"):
        views_of_photos([photo("a.png", picture)], Target("t", (shifted,)))
    chess, _ = taken(Chessboard(7, 5, 20.0), PLACES["ahead"])
    with pytest.raises(InputError, match="7 x 5 inner corners is seen, not 8 x 6"):
        views_of_photos([photo("a.png", chess)], Target("t", (Chessboard(8, 6, 20.0),)))
    with pytest.raises(InputError, match="sharp"):
        views_of_photos([photo("black.png", np.zeros((60, 80), np.uint8))], Target("t", (charuco,)))


@pytest.mark.skipif(not REAL.exists(), reason=f"real data: {REAL} is not here")
def test_real_photos_become_views() -> None:
    files = sorted((REAL / "urban-fisheye2" / "images").glob("*.jpg"))
    photos = [photo(file.name, np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))) for file in files]
    seen = views_of_photos(photos, Target("chessboard", (Chessboard(6, 8, 117.0),)))
    assert seen.found == len(files) == 16
    assert "same picture" in seen.left_out[0].reason  # two of the files are one picture
    assert calibrate(seen.views, seen.image_size).rms_px <= 0.12
