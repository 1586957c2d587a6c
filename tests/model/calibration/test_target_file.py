"""Targets are named by short texts and files; what is wrong in either is said by its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fullsphere.model.calibration.board import Placement
from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.target_file import load_target, parse_target, save_target
from fullsphere.model.calibration.target_text import FORMS, length_mm
from fullsphere.model.calibration.targets import Target
from fullsphere.model.errors import InputError, OutputError, UsageError

TURNED = np.array([[0, 0, 1, 10], [1, 0, 0, 20], [0, 1, 0, 30], [0, 0, 0, 1.0]])
BOX = Target(
    "box",
    (CharucoBoard(4, 5, 30.0, 20.0), CharucoBoard(6, 4, 30.0, 20.0, 10, placement=Placement(TURNED))),
)


@pytest.mark.parametrize(
    ("text", "board"),
    [
        ("chessboard:6x8:117mm", Chessboard(6, 8, 117.0)),
        ("chessboard:6X8:11.7cm", Chessboard(6, 8, 117.0)),
        ("charuco:11x8:30mm:22mm", CharucoBoard(11, 8, 30.0, 22.0)),
        ("charuco:11x8:0.03m:22mm:DICT_4X4_100", CharucoBoard(11, 8, 30.0, 22.0, 0, "DICT_4X4_100")),
        ("aprilgrid:6x5:88mm:0.3", AprilGrid(6, 5, 88.0, 0.3)),
        ("aprilgrid:6x5:2in:.3:1", AprilGrid(6, 5, 50.8, 0.3, 0, 1)),
        ("circles:7x10:20mm", CirclesGrid(7, 10, 20.0, 10.0)),
        ("acircles:4x11:20mm:15 mm", CirclesGrid(4, 11, 20.0, 15.0, True)),
    ],
)
def test_texts_name_boards(text: str, board: Any) -> None:
    target = parse_target(text)
    assert target.name == text
    assert len(target.boards) == 1
    assert type(target.boards[0]) is type(board)
    same = {name: value for name, value in vars(target.boards[0]).items() if name != "placement"}
    assert same == pytest.approx({name: value for name, value in vars(board).items() if name != "placement"})


def test_texts_name_cylinders() -> None:
    whole, half = (parse_target(f"{kind}:150mm:42cm:36mm:26mm").boards[0] for kind in ("cylinder", "half-cylinder"))
    assert isinstance(whole, CharucoBoard)
    assert isinstance(half, CharucoBoard)
    assert (whole.squares_x, half.squares_x, half.placement.radius_mm) == (26, 13, 150.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("chessbord:6x8:117mm", FORMS[0]),
        ("", FORMS[-1]),
        ("nowhere", FORMS[1]),
        ("x" * 5000, FORMS[1]),
        ("chessboard:6x8", FORMS[0]),
        ("chessboard:6x8:117mm:3", FORMS[0]),
        ("chessboard:6x8:117", "117mm"),
        ("chessboard:6x8:117km", "length"),
        ("chessboard:6x8:-1mm", "length"),
        ("chessboard:6x8:nanmm", "length"),
        ("chessboard:6:117mm", "columns and rows"),
        ("chessboard:2x8:117mm", "at least 3 x 3"),
        ("charuco:5x5:30mm:31mm", "does not fit"),
        ("charuco:5x5:30mm:20mm:DICT_X", "DICT_X"),
        ("aprilgrid:6x6:88mm:30mm", "sides of a tag"),
        ("aprilgrid:6x6:88mm:0.3:3", "border"),
        ("acircles:4x11:20mm:99mm", "do not fit a spacing"),
        ("cylinder:150mm:420mm:9mm", "larger squares"),
    ],
)
def test_wrong_texts_say_what_is_expected(text: str, says: str) -> None:
    with pytest.raises(UsageError) as raised:
        parse_target(text)
    assert says in str(raised.value)
    assert repr(text) in str(raised.value)


def test_lengths_are_in_millimetres() -> None:
    assert [length_mm(text) for text in ("1.5mm", "2 cm", "0.5m", "1in")] == [1.5, 20.0, 500.0, 25.4]


@pytest.mark.parametrize(
    "target",
    [BOX, *(parse_target(text) for text in ("chessboard:6x8:117mm", "acircles:4x11:20mm", "aprilgrid:6x6:88mm:0.3")),
     parse_target("cylinder:150mm:420mm:36mm")],
    ids=lambda target: str(target.name),
)  # fmt: skip
def test_files_keep_every_digit(target: Target, tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    save_target(path, target)
    again = load_target(path)
    assert again.name == str(path)
    np.testing.assert_array_equal(again.points, target.points)
    for one, other in zip(again.boards, target.boards, strict=True):
        assert type(one) is type(other)
        np.testing.assert_array_equal(one.placement.target_from_board, other.placement.target_from_board)
        assert {**vars(one), "placement": one.placement.radius_mm} == {
            **vars(other),
            "placement": other.placement.radius_mm,
        }
    np.testing.assert_array_equal(parse_target(str(path)).points, target.points)
    with pytest.raises(OutputError):
        save_target(path, target)


def content(**changes: Any) -> dict[str, Any]:
    board = {"kind": "charuco", "squares_x": 4, "squares_y": 5, "square_mm": 30, "marker_mm": 20.5}
    return {"format": "fullsphere-target/1", "boards": [board | changes]}


def test_a_person_may_leave_out_what_has_a_default(tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    path.write_text(json.dumps(content()))
    (board,) = load_target(path).boards
    assert isinstance(board, CharucoBoard)
    assert (board.first_id, board.dictionary, board.placement.is_flat) == (0, "DICT_5X5_1000", True)
    assert type(board.square_mm) is float


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ([], "object"),
        ({}, "format"),
        (content() | {"format": "fullsphere-camera/1"}, "format"),
        ({"format": "fullsphere-target/1"}, "'boards' is missing"),
        (content() | {"boards": {}}, "boards"),
        (content() | {"boards": []}, "at least one board"),
        (content() | {"boards": [3]}, "boards[0]"),
        (content() | {"name": "x"}, "'name' is unknown"),
        (content(kind="halma"), "halma"),
        (content(kind=["charuco"]), "kind"),
        (content(colour="red"), "'colour' is unknown"),
        (content(kind="chessboard"), "'columns' is missing"),
        (content(squares_x=4.5), "squares_x"),
        (content(squares_x=True), "squares_x"),
        (content(square_mm="30"), "square_mm"),
        (content(square_mm=10), "boards[0]: board: a marker"),
        (content(dictionary=3), "dictionary"),
        (content(placement=None), "placement"),
        (content(placement={}), "target_from_board"),
        (content(placement={"target_from_board": [[1, 0], [0, 1]]}), "4 rows"),
        (content(placement={"target_from_board": np.diag([2, 1, 1, 1]).tolist()}), "rigid"),
        (content(placement={"target_from_board": np.eye(4).tolist(), "radius_mm": -3}), "positive radius"),
        (content(placement={"target_from_board": np.eye(4).tolist(), "radius_mm": "wide"}), "radius_mm"),
        (content(placement={"target_from_board": np.eye(4).tolist(), "axis": 3}), "axis"),
        ({"format": "fullsphere-target/1", "boards": content()["boards"] * 2}, "marker 0"),
    ],
)
def test_wrong_files_are_refused_by_the_key(data: Any, says: str, tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as raised:
        parse_target(str(path))
    assert says in str(raised.value)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"format": "fullsphere-target/1", "format": "fullsphere-target/1", "boards": []}', "twice"),
        (json.dumps(content()).replace("20.5", "NaN"), "marker_mm"),
        (json.dumps(content()).replace("20.5", "1e999"), "marker_mm"),
        ("{", "not JSON"),
    ],
)
def test_broken_files_are_refused(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        parse_target(str(path))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.json"):
        parse_target("nowhere.json")
