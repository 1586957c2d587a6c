"""A board's corners and markers are where OpenCV prints them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from fullsphere.model.calibration.board import Placement
from fullsphere.model.calibration.boards import CharucoBoard, marker_dictionary, one_dictionary
from fullsphere.model.errors import UsageError


def test_layout_is_that_of_opencv() -> None:
    board = CharucoBoard(7, 5, 30.0, 21.0, 40, "DICT_5X5_250")
    ids = np.arange(40, 40 + board.marker_count)
    theirs = cv2.aruco.CharucoBoard((7, 5), 30.0, 21.0, marker_dictionary("DICT_5X5_250"), ids)
    np.testing.assert_allclose(board.marks_on_paper(), theirs.getChessboardCorners()[:, :2])
    corners = np.array(theirs.getObjPoints())[:, 0, :2]
    np.testing.assert_allclose(board.marker_squares() * 30.0 + 4.5, corners)


def test_corners_follow_the_pose() -> None:
    pose = np.array([[0, 0, 1, 10], [1, 0, 0, 20], [0, 1, 0, 30], [0, 0, 0, 1.0]])
    board = CharucoBoard(3, 3, 10.0, 7.0, placement=Placement(pose))
    np.testing.assert_allclose(board.marks_on_target()[1], [10, 40, 40])
    assert len(board.marks_on_target()) == board.corner_count == 4


@pytest.mark.parametrize(
    "wrong",
    [
        {"squares_x": 1},
        {"marker_mm": 30.0},
        {"marker_mm": float("nan")},
        {"dictionary": "DICT_NONE"},
        {"dictionary": "ArucoDetector"},
        {"first_id": 999},
        {"first_id": -1},
    ],
)
def test_values_that_make_no_board_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        CharucoBoard(**{"squares_x": 4, "squares_y": 4, "square_mm": 30.0, "marker_mm": 20.0} | wrong)


@pytest.mark.parametrize("pose", [np.diag([1.0, 1, -1, 1]), np.eye(3)])
def test_placement_is_rigid(pose: np.ndarray) -> None:
    with pytest.raises(UsageError):
        Placement(pose)


def test_rolled_paper_keeps_its_lengths_and_touches_the_flat_one() -> None:
    paper = np.stack([np.linspace(-200, 200, 4001), np.full(4001, 7.0)], -1)
    flat, rolled = Placement().lift(paper), Placement(radius_mm=150.0).lift(paper)
    np.testing.assert_allclose(np.linalg.norm(np.diff(rolled, axis=0), axis=1), 0.1, rtol=1e-6)
    np.testing.assert_allclose(np.hypot(rolled[:, 0], rolled[:, 2] + 150.0), 150.0)
    np.testing.assert_allclose(rolled[2000], flat[2000])
    assert (rolled[:, 2] <= 1e-12).all()  # towards the viewer


def test_boards_of_one_target_share_a_dictionary_and_no_marker() -> None:
    first, second = CharucoBoard(4, 4, 30.0, 20.0), CharucoBoard(4, 4, 30.0, 20.0, 8)
    assert one_dictionary([second, first]) == "DICT_5X5_1000"
    for wrong in ([], [first, first], [first, CharucoBoard(4, 4, 30.0, 20.0, 8, "DICT_4X4_100")]):
        with pytest.raises(UsageError):
            one_dictionary(wrong)
