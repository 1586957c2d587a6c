"""A grid of discs is found whole and numbered as it looks; its centres are right once the camera is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from board_photos import board_pose, photograph_board, truth, wide_camera
from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import Chessboard, CirclesGrid
from fullsphere.model.calibration.detect_circles import find_circles
from fullsphere.model.calibration.disc_images import centre_offset
from fullsphere.model.calibration.mark_order import equivalent_orders
from fullsphere.model.colour import linear_from_encoded

CAMERA = wide_camera()
BOARDS = {
    "symmetric": CirclesGrid(7, 6, 30.0, 18.0),
    "square": CirclesGrid(6, 6, 30.0, 12.0),
    "asymmetric": CirclesGrid(4, 11, 20.0, 15.0, True),
    "asymmetric-wide": CirclesGrid(5, 6, 20.0, 18.0, True),
}
PLACES = {
    "ahead": ((0.0, 0.0, 250.0, 20.0, 0.0), {"noise": 0.005}),
    "shaded": ((40.0, 30.0, 250.0, 0.0, 30.0), {"noise": 0.01, "shade": 0.6}),
    "blurred": ((25.0, 250.0, 260.0, -30.0, 75.0), {"noise": 0.01, "blur_px": 1.0}),
    "side": ((66.0, 200.0, 320.0, 0.0, 170.0), {"noise": 0.005, "shade": 0.3}),
    "rim": ((76.0, 100.0, 420.0, 25.0, 80.0), {"noise": 0.005}),
}


def look_for(grey: NDArray[np.uint8], board: CirclesGrid) -> MarksFound | None:
    return find_circles(grey, linear_from_encoded(grey[..., None])[..., 0], board)


@pytest.mark.parametrize("where", PLACES)
@pytest.mark.parametrize("kind", BOARDS)
def test_centres_are_where_the_truth_is_after_the_offset(kind: str, where: str) -> None:
    board, (how, light) = BOARDS[kind], PLACES[where]
    pose = board_pose(board, *how)
    found = look_for(photograph_board(board, CAMERA, pose, **light), board)
    assert found is not None
    assert len(found.marks) >= 0.95 * len(board.marks_on_paper())
    everything = np.arange(len(board.marks_on_paper()))
    right = truth(board, CAMERA, pose)
    seen = right + centre_offset(CAMERA, *pose, board, everything)
    errors = [np.linalg.norm(found.pixels - seen[o][found.marks], axis=1) for o in equivalent_orders(board)]
    error = min(errors, key=np.median)
    assert np.median(error) < 0.05
    assert error.max() < 0.2


def test_the_offset_is_seen_in_the_photo() -> None:
    board = CirclesGrid(5, 4, 60.0, 40.0)
    pose = board_pose(board, 30, 0, 350, 45)
    found = look_for(photograph_board(board, CAMERA, pose), board)
    assert found is not None
    right, offset = truth(board, CAMERA, pose), centre_offset(CAMERA, *pose, board, np.arange(20))
    apart = [found.pixels - right[order][found.marks] for order in equivalent_orders(board)]
    which = int(np.argmin([np.abs(a).max() for a in apart]))
    expected = offset[equivalent_orders(board)[which]][found.marks]
    assert np.median(np.linalg.norm(expected, axis=1)) > 0.15
    assert np.median(np.linalg.norm(apart[which] - expected, axis=1)) < 0.05


def test_the_offset_agrees_with_a_dense_picture_of_the_disc() -> None:
    board = CirclesGrid(2, 2, 100.0, 80.0)
    pose = board_pose(board, 50, 120, 200, 35)
    radius, turn = np.meshgrid((np.arange(300) + 0.5) / 300, 2 * np.pi * np.arange(400) / 400)
    disc = 40.0 * np.stack([radius * np.cos(turn), radius * np.sin(turn)], -1) + board.marks_on_paper()[1]
    step = 1e-3
    corners = [disc, disc + np.array([step, 0]), disc + np.array([0, step])]
    pixels, right, down = (CAMERA.project(board.placement.lift(p) @ pose[0].T + pose[1]) for p in corners)
    magnified = np.abs(np.linalg.det(np.stack([right - pixels, down - pixels], -1))) * radius
    centre = (pixels * magnified[..., None]).sum((0, 1)) / magnified.sum()
    offset = centre_offset(CAMERA, *pose, board, np.array([1]))[0]
    np.testing.assert_allclose(offset, centre - truth(board, CAMERA, pose)[1], atol=2e-3)
    assert np.linalg.norm(offset) > 0.3


def test_a_disc_beyond_the_field_of_view_has_no_offset() -> None:
    board = BOARDS["symmetric"]
    turn, _ = board_pose(board, 0, 0, 200)
    assert np.isnan(centre_offset(CAMERA, turn, np.array([0.0, 0.0, -200.0]), board, np.array([0, 3]))).all()


@pytest.mark.parametrize("asked", [(6, 6), (7, 5), (8, 6), (6, 7)], ids=str)
def test_a_grid_of_other_dimensions_is_not_taken_for_it(asked: tuple[int, int]) -> None:
    there = BOARDS["symmetric"]
    photo = photograph_board(there, CAMERA, board_pose(there, 30, 10, 250, 20, 10))
    found = look_for(photo, CirclesGrid(*asked, 30.0, 18.0))
    if asked == (6, 7):  # a quarter turn of the same grid
        assert found is not None and len(found.marks) == 42
    else:
        assert found is None
    assert look_for(photo, BOARDS["asymmetric"]) is None


@pytest.mark.parametrize("kind", ["noise", "plain", "chessboard", "dots", "tiny"])
def test_pictures_without_a_grid(kind: str) -> None:
    random = np.random.default_rng(2)
    chess = Chessboard(8, 5, 30.0)
    dots = np.full((300, 400), 200, np.uint8)
    for row, column in random.integers(10, 290, (60, 2)):
        dots[row - 4 : row + 4, column - 4 : column + 4] = 20
    picture = {
        "noise": random.integers(0, 256, (240, 320), np.uint8),
        "plain": np.full((200, 300), 120, np.uint8),
        "chessboard": photograph_board(chess, CAMERA, board_pose(chess, 30, 10, 250, 20, 10)),
        "dots": dots,
        "tiny": np.zeros((1, 1), np.uint8),
    }[kind]
    assert [look_for(picture, board) for board in BOARDS.values()] == [None] * 4
