from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fullsphere.model.calibration.points import Sightings, View, read_points
from fullsphere.model.errors import GeometryError, InputError

HEADER = "image,x_mm,y_mm,z_mm,u_px,v_px\n"
ROW = "a.png,1,2,3,4,5\n"


def test_rows_become_views_in_the_order_of_their_first_row(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text(
        "v_px,note,u_px,image,z_mm,y_mm,x_mm\n5,x,4,b.png,3,2,1\n15,,14,a.png,13,12,11\n\n25,,24,b.png,23,22,21\n"
    )
    views = read_points(file)
    assert [view.image for view in views] == ["b.png", "a.png"]
    np.testing.assert_array_equal(views[0].points_on_target, [[1, 2, 3], [21, 22, 23]])
    np.testing.assert_array_equal(views[0].pixels, [[4, 5], [24, 25]])
    np.testing.assert_array_equal(views[1].points_on_target, [[11, 12, 13]])


def test_a_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_bytes(b"\xef\xbb\xbf" + (HEADER + ROW).replace("\n", "\r\n").encode())
    assert read_points(str(file))[0].image == "a.png"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", ["empty"]),
        (HEADER, ["no rows"]),
        ("image,x,y,z,u_px,v_px\n" + ROW, ["no column x_mm, y_mm, z_mm", "'x'"]),
        (HEADER.replace(",", ";") + ROW.replace(",", ";"), ["semicolons", "commas"]),
        (HEADER.replace(",", "\t") + ROW.replace(",", "\t"), ["tabs", "commas"]),
        ("u_px," + HEADER + "1," + ROW, ["u_px", "twice"]),
        (HEADER + ROW + "a.png,1,zwei,3,4,5\n", ["line 3", "column y_mm", "'zwei'"]),
        (HEADER + ROW + "a.png,1,2,3,nan,5\n", ["line 3", "column u_px", "nan"]),
        (HEADER + ROW + "a.png,1,2,3,4,1e999\n", ["line 3", "column v_px", "1e999"]),
        (HEADER + "a.png,1,2,3,4,\n", ["line 2", "column v_px"]),
        (HEADER + "a.png,1,5,2,3,4,5\n", ["line 2", "7 fields", "6"]),
        (HEADER + ",1,2,3,4,5\n", ["line 2", "column image"]),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", ["text table"]),
    ],
    ids=str,
)
def test_a_bad_table_is_refused_in_one_line(tmp_path: Path, content: str | bytes, said: list[str]) -> None:
    file = tmp_path / "points.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as error:
        read_points(file)
    message = str(error.value)
    assert message.startswith(str(file))
    assert "\n" not in message
    assert [part for part in said if part not in message] == []


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_points(tmp_path / "none.csv")
    with pytest.raises(InputError, match="directory"):
        read_points(tmp_path)


def test_a_view_refuses_arrays_that_do_not_belong_together() -> None:
    with pytest.raises(GeometryError, match=r"a\.png"):
        View("a.png", np.zeros((5, 3)), np.zeros((4, 2)))
    with pytest.raises(GeometryError, match="NaN"):
        View("a.png", np.zeros((5, 3)), np.full((5, 2), np.nan))


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (np.zeros((0, 3)), "0 points"),
        (np.eye(3), "3 points"),
        (np.outer(np.arange(20.0), [1, 2, 3]), "one line"),
        (np.zeros((9, 3)), "one line"),
        (np.random.default_rng(0).normal(size=(5, 3)), "at least 6"),
    ],
)
def test_a_view_that_fixes_no_pose_is_named(points: np.ndarray, said: str) -> None:
    with pytest.raises(GeometryError, match=said) as error:
        Sightings.of([View("b.png", points, np.zeros((len(points), 2)))])
    assert "b.png" in str(error.value)


def test_no_view_at_all_is_refused() -> None:
    with pytest.raises(GeometryError, match="no view"):
        Sightings.of([])


def test_split_undoes_the_joining_of_views() -> None:
    rng = np.random.default_rng(1)
    views = [View(f"{n}", rng.normal(size=(n, 3)), rng.normal(size=(n, 2))) for n in (7, 30, 6)]
    sightings = Sightings.of(views)
    for view, part in zip(views, sightings.split(sightings.pixels), strict=True):
        np.testing.assert_array_equal(view.pixels, part)
