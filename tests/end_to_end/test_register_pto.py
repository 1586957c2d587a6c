"""Hugin projects that are not whole: what is left of them is registered, and the rest is said."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from rooms import Outcome, Set

from fullsphere.cli.main import main
from fullsphere.mosaic import Mosaic, load_mosaic
from fullsphere.mosaic.truth import rotation_errors_deg

Run = Callable[..., Outcome]


@pytest.fixture(scope="module")
def project(room_set: Set) -> str:
    """A Hugin project beside the frames, which lie in its folder."""
    path = room_set.camera_file.parent / "set.pto"
    assert main(["register", *map(str, room_set.frames), "-o", str(path), "--camera", str(room_set.camera_file)]) == 0
    return path.read_text()


def changed(room_set: Set, project: str, *changes: tuple[str, str]) -> Path:
    for old, new in changes:
        assert old in project
        project = project.replace(old, new)
    path = room_set.camera_file.parent / "changed.pto"
    path.write_text(project)
    return path


def worst_deg(room_set: Set, mosaic: Mosaic, expected: Sequence[int]) -> float:
    """How far the expected frames are turned from the truth at most; no other may be registered."""
    found = [frame.camera_from_world for frame in mosaic.frames if frame.camera_from_world is not None]
    assert len(found) == len(expected)
    return float(rotation_errors_deg(found, [room_set.shots[k].camera_from_world for k in expected])[0].max())


def test_a_project_without_some_of_its_pictures_goes_on_with_the_others(
    room_set: Set, project: str, fullsphere: Run, tmp_path: Path
) -> None:
    path = changed(room_set, project, ("frame_3.jpg", "gone.jpg"))
    run = fullsphere("register", path, "-o", tmp_path / "m.json", "--json")
    assert run.code == 0
    summary: dict[str, Any] = json.loads(run.out)
    assert summary["registered"] == 4
    (name, reason), *others = summary["left_out"].items()
    assert others == []
    assert "gone.jpg" in name
    assert reason == f"there is no file {path.parent / 'gone.jpg'}"
    assert worst_deg(room_set, load_mosaic(tmp_path / "m.json"), [0, 1, 2, 4]) < 0.03


def test_a_project_without_pictures_is_adjusted_by_its_points_and_says_so_once(
    room_set: Set, project: str, fullsphere: Run, tmp_path: Path
) -> None:
    run = fullsphere("register", changed(room_set, project, ('n"', 'n"away/')), "-o", tmp_path / "m.json")
    assert run.code == 0
    assert len(run.warnings) == 1
    assert "none of its 5 pictures is here" in run.warnings[0]
    assert worst_deg(room_set, load_mosaic(tmp_path / "m.json"), range(5)) < 0.03


def test_a_project_with_one_picture_left_is_no_mosaic(
    room_set: Set, project: str, fullsphere: Run, tmp_path: Path
) -> None:
    path = changed(room_set, project, *((f"frame_{k}.jpg", f"gone_{k}.jpg") for k in range(1, 5)))
    run = fullsphere("register", path, "-o", tmp_path / "m.json")
    assert run.code == 3
    assert "1 of the 5 given can be used" in run.error_line
    assert "there is no file" in run.error_line
    assert list(tmp_path.iterdir()) == []


def test_lines_of_a_project_that_nobody_knows_are_told_and_skipped(
    room_set: Set, project: str, fullsphere: Run, tmp_path: Path
) -> None:
    path = changed(room_set, project + "\nz made by a newer program\n")
    run = fullsphere("register", path, "-o", tmp_path / "m.json")
    assert run.code == 0
    assert len(run.warnings) == 1
    assert f"{path}: line {len(project.splitlines()) + 2}: not understood, and skipped" in run.warnings[0]
    assert len(load_mosaic(tmp_path / "m.json").registered) == 5
