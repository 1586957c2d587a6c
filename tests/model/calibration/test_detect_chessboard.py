"""A plain chessboard is found whole, numbered as it looks, to a twentieth of a pixel; and no other is taken for it."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from board_photos import board_pose, photograph_board, truth, wide_camera
from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import Chessboard
from fullsphere.model.calibration.calibrate import calibrate
from fullsphere.model.calibration.detect_chessboard import find_chessboard, seen_chessboards
from fullsphere.model.calibration.mark_order import equivalent_orders
from fullsphere.model.calibration.points import View
from fullsphere.model.colour import linear_from_encoded

SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[3].parent / "shared"))
REAL = SHARED / "data" / "calibration"
CAMERA = wide_camera()


def look_for(grey: NDArray[np.uint8], board: Chessboard) -> MarksFound | None:
    return find_chessboard(grey, linear_from_encoded(grey[..., None])[..., 0], board)


def place(theta: float, phi: float, distance: float, tilt: float, roll: float) -> dict[str, float]:
    return {"theta_deg": theta, "phi_deg": phi, "distance": distance, "tilt_deg": tilt, "roll_deg": roll}


PLACES = {
    "ahead": (place(0, 0, 250, 20, 0), {"noise": 0.005}),
    "shaded": (place(40, 30, 250, 0, 30), {"noise": 0.01, "shade": 0.7}),
    "blurred": (place(25, 250, 300, -30, 75), {"noise": 0.01, "blur_px": 1.2}),
    "side": (place(66, 200, 320, 0, 170), {"noise": 0.005, "shade": 0.3}),
    "rim": (place(76, 100, 420, 20, -100), {"noise": 0.005}),
}


@pytest.mark.parametrize(
    ("where", "size"),
    [*((where, (8, 5)) for where in PLACES), ("shaded", (6, 8)), ("side", (6, 6)), ("rim", (5, 5))],
    ids=str,
)
def test_corners_are_where_the_truth_is(where: str, size: tuple[int, int]) -> None:
    board, (how, light) = Chessboard(*size, 30.0), PLACES[where]
    pose = board_pose(board, **how)
    found = look_for(photograph_board(board, CAMERA, pose, **light), board)
    assert found is not None
    assert len(found.marks) >= 0.95 * size[0] * size[1]
    assert np.all(np.diff(found.marks) > 0)
    right = truth(board, CAMERA, pose)
    assert np.isfinite(right).all()
    errors = [np.linalg.norm(found.pixels - right[o][found.marks], axis=1) for o in equivalent_orders(board)]
    error = min(errors, key=np.median)
    assert np.median(error) < 0.05
    assert error.max() < 0.25


def test_small_squares_in_a_large_picture() -> None:
    """The search is made in a reduced picture, where squares are some 8 px, the corners fitted in the full one."""
    camera, board = wide_camera(3000, 2400), Chessboard(9, 6, 20.0)
    pose = board_pose(board, 50, 20, 900, 10, 10)
    found = look_for(photograph_board(board, camera, pose, blur_px=1.0), board)
    assert found is not None
    error = np.linalg.norm(found.pixels - truth(board, camera, pose)[found.marks], axis=1)
    assert len(found.marks) == 54 and np.median(error) < 0.05


def test_edges_are_fitted_in_the_light_or_in_the_codes_whichever_was_blurred() -> None:
    board = Chessboard(8, 5, 30.0)
    pose = board_pose(board, 40, 30, 250)
    sharp = photograph_board(board, CAMERA, pose, noise=0, blur_px=0)
    blurred = cv2.GaussianBlur(sharp.astype(np.float32), (0, 0), 1.5)
    found = look_for(np.rint(blurred).astype(np.uint8), board)
    assert found is not None
    assert np.median(np.linalg.norm(found.pixels - truth(board, CAMERA, pose)[found.marks], axis=1)) < 0.05


@pytest.mark.parametrize("asked", [(7, 5), (9, 5), (5, 8)], ids=str)
def test_a_board_of_other_dimensions_is_not_taken_for_it(asked: tuple[int, int]) -> None:
    there = Chessboard(8, 5, 30.0)
    photo = photograph_board(there, wide_camera(480, 400), board_pose(there, 30, 10, 200, 20, 10))
    found = look_for(photo, Chessboard(*asked, 30.0))
    if asked == (5, 8):  # a quarter turn of the same board
        assert found is not None and len(found.marks) == 40
    else:
        assert found is None
        assert seen_chessboards(photo) == [(8, 5)]


def test_a_board_cut_off_by_the_picture_is_not_found() -> None:
    board = Chessboard(8, 5, 30.0)
    photo = photograph_board(board, CAMERA, board_pose(board, 0, 0, 250))
    assert look_for(photo, board) is not None
    assert look_for(np.ascontiguousarray(photo[:, :400]), board) is None


@pytest.mark.parametrize("kind", ["noise", "plain", "squares", "stripes", "tiny"])
def test_pictures_without_a_board(kind: str) -> None:
    random = np.random.default_rng(2)
    picture = {
        "noise": random.integers(0, 256, (240, 320), np.uint8),
        "plain": np.full((200, 300), 120, np.uint8),
        "squares": np.kron(random.integers(0, 2, (20, 30), np.uint8) * 255, np.ones((12, 12), np.uint8)),
        "stripes": np.tile(np.repeat([20, 230], 12).astype(np.uint8), (200, 12)),
        "tiny": np.zeros((1, 1), np.uint8),
    }[kind]
    assert look_for(picture, Chessboard(6, 8, 30.0)) is None
    assert look_for(picture, Chessboard(4, 3, 30.0)) is None
    if kind != "squares":
        assert seen_chessboards(picture) == []


needs_real = pytest.mark.skipif(not REAL.exists(), reason=f"real data: {REAL} is not here")


def real_views(folder: str, board: Chessboard) -> tuple[list[View], dict[str, list[list[float]]]]:
    """What is found in the photos, and the corners that others found, by the picture's name without its ending."""
    views = []
    for path in sorted((REAL / folder / "images").iterdir()):
        grey = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        found = look_for(grey, board)
        assert found is not None, path.name
        views.append(View(path.stem, board.marks_on_target()[found.marks], found.pixels))
    given: dict[str, list[list[float]]] = {}
    with (REAL / folder / "corners.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            given.setdefault(Path(row["image"]).stem, []).append([float(row["u"]), float(row["v"])])
    return views, given


@needs_real
@pytest.mark.parametrize(
    ("folder", "size", "photos", "picture", "lens", "rms_px", "distance_px"),
    [
        # with the corners given there: 0.3247 and 0.4960
        ("urban-fisheye2", (6, 8), 16, (748, 480), "bakstein-pajdla", 0.105, 0.2),
        ("camodocal", (9, 6), 21, (1280, 960), "kannala-brandt", 0.40, 0.25),
    ],
)
def test_real_photos(
    folder: str,
    size: tuple[int, int],
    photos: int,
    picture: tuple[int, int],
    lens: str,
    rms_px: float,
    distance_px: float,
) -> None:
    board = Chessboard(*size, 100.0)
    views, given = real_views(folder, board)
    assert len(views) == photos
    assert sum(len(view.pixels) for view in views) >= 0.99 * photos * size[0] * size[1]
    assert calibrate(views, picture, lens, reject=False).rms_px < rms_px
    apart = [np.linalg.norm(view.pixels[:, None] - np.array(given[view.image]), axis=-1).min(1) for view in views]
    assert np.median(np.concatenate(apart)) < distance_px
