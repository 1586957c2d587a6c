"""Boards that look the same after a turn, and views that are made to number their marks alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.board import Board, Placement
from fullsphere.model.calibration.boards import CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.lattice import numbered
from fullsphere.model.calibration.mark_order import aligned, equivalent_orders, viewer_orders

TILTED = Placement(
    np.block([[Rotation.from_euler("XYZ", [0.4, -0.3, 1.0]).as_matrix(), np.ones((3, 1))], [np.array([0, 0, 0, 1.0])]])
)


@pytest.mark.parametrize(
    ("board", "count"),
    [
        (Chessboard(9, 6, 10.0), 1),  # the other end's square is white
        (Chessboard(8, 6, 10.0), 2),
        (Chessboard(7, 5, 10.0), 2),
        (Chessboard(6, 6, 10.0), 4),
        (Chessboard(5, 5, 10.0), 2),  # a quarter turn exchanges black and white
        (Chessboard(33, 32, 10.0), 1),
        (CirclesGrid(7, 6, 10.0, 5.0), 2),
        (CirclesGrid(6, 6, 10.0, 5.0), 4),
        (CirclesGrid(4, 11, 10.0, 5.0, True), 1),
        (CirclesGrid(4, 10, 10.0, 5.0, True), 2),
        (CharucoBoard(7, 5, 10.0, 7.0), 1),
    ],
    ids=lambda value: f"{type(value).__name__}" if isinstance(value, Board) else str(value),
)
def test_as_many_orders_as_turns_that_look_the_same(board: Board, count: int) -> None:
    orders, marks = equivalent_orders(board), board.marks_on_paper()
    assert orders.shape == (count, len(marks))
    assert np.array_equal(orders[0], np.arange(len(marks)))
    for order in orders:
        assert np.array_equal(np.sort(order), np.arange(len(marks)))
        turned = marks[order] - marks.mean(0)
        rotation, _, _, _ = np.linalg.lstsq(marks - marks.mean(0), turned, rcond=None)
        assert np.linalg.det(rotation) == pytest.approx(1)
        np.testing.assert_allclose((marks - marks.mean(0)) @ rotation, turned, atol=1e-9)


@pytest.mark.parametrize("mirror", [False, True])
def test_a_mirrored_reading_is_put_right(mirror: bool) -> None:
    marks = Chessboard(7, 5, 10.0).marks_on_paper()
    pixels = marks @ np.array([[3.0, 1.0], [-1.0, 2.0]])
    shown = pixels.reshape(5, 7, 2)[:, ::-1].reshape(-1, 2) if mirror else pixels
    readings = [shown[order] for order in viewer_orders(marks, shown)]
    assert len(readings) == 2
    assert any(np.array_equal(reading, pixels) for reading in readings)


@pytest.mark.parametrize("placement", [Placement(), TILTED], ids=["plain", "tilted"])
@pytest.mark.parametrize("size", [(8, 6), (6, 6)], ids=str)
def test_views_are_numbered_alike(size: tuple[int, int], placement: Placement) -> None:
    board = Chessboard(*size, 10.0, placement)
    orders, marks = equivalent_orders(board), board.marks_on_target()
    rng = np.random.default_rng(0)
    true = Rotation.from_rotvec(rng.normal(0, 0.25, (12, 3))).as_matrix()
    as_found, taken = [], rng.integers(0, len(orders), 12)
    for rotation, number in zip(true, taken, strict=True):
        seen = (marks @ rotation.T)[orders[number]]  # where each mark was thought to be
        centred = marks - marks.mean(0)
        found, _ = Rotation.align_vectors(seen - seen.mean(0), centred)
        as_found.append(found.as_matrix())
    rows = aligned(board, np.array(as_found))
    final = [orders[number][orders[row]] for number, row in zip(taken, rows, strict=True)]
    assert len({tuple(order) for order in final}) == 1
    assert len(set(taken.tolist())) > 1


def test_a_board_with_one_order_needs_no_alignment() -> None:
    assert aligned(Chessboard(9, 6, 10.0), np.tile(np.eye(3), (3, 1, 1))).tolist() == [0, 0, 0]
    assert aligned(Chessboard(8, 6, 10.0), np.empty((0, 3, 3))).tolist() == []


def test_a_bent_foreshortened_lattice_is_numbered_among_other_spots() -> None:
    places = np.stack(np.meshgrid(np.arange(7), np.arange(5)), -1).reshape(-1, 2)
    x, y = places.T.astype(float)
    points = np.stack([20 * x + 0.8 * x * y + 100, 8 * y - 0.4 * (x - 3) ** 2 + 100 + 0.4 * y**2], -1)
    rng = np.random.default_rng(1)
    shuffle = rng.permutation(len(points))
    others = rng.uniform(300, 600, (15, 2))
    found = numbered(np.concatenate([points[shuffle], others]), np.ones(50), places)
    assert found is not None
    readings = [points[shuffle][found[order]] for order in equivalent_orders(CirclesGrid(7, 5, 1.0, 0.5))]
    assert any(np.array_equal(reading, points) for reading in readings)
    assert numbered(points[1:], np.ones(34), places) is None
    assert numbered(points, np.ones(35), places[:30]) is None
