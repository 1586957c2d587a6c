"""What `fullsphere compose` tells of a panorama: a page, and what was hidden of its frames."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from projects import CAMERA, project_in
from rooms import Outcome
from turning import frames_of, orientation

from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.images import open_panorama
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from fullsphere.mosaic.store import save_mosaic

Run = Callable[..., Outcome]


def test_a_page_is_written_beside_the_panorama(fullsphere: Run, tmp_path: Path) -> None:
    project = project_in(tmp_path / "project")
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--size", "200", "--report", tmp_path / "p.html")
    assert run.code == 0, run.err
    assert "Who is shown where" in (tmp_path / "p.html").read_text()
    assert (tmp_path / "p-figures" / "seams.png").is_file()
    again = fullsphere("compose", project, "-o", tmp_path / "q.tif", "--size", "200", "--report", tmp_path / "p.html")
    assert again.code == 5
    assert "p.html" in again.error_line
    assert not (tmp_path / "q.tif").exists()


def test_a_quick_look_has_no_page(fullsphere: Run, tmp_path: Path) -> None:
    project = project_in(tmp_path / "project")
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--preview", "--report", tmp_path / "p.html")
    assert run.code == 2
    assert "--report" in run.error_line


def waves(rays: FloatArray) -> FloatArray:
    rng = np.random.default_rng(3)
    many = rng.normal(size=(50, 3)) * rng.uniform(1, 20, 50)[:, None]
    level = np.sin(rays @ many.T + rng.uniform(0, 6, 50)) @ rng.normal(size=(50, 3)) * 0.15
    return np.asarray(np.clip(0.25 * np.exp(level), 0, 0.9))


def with_a_thing(k: int, light: FloatArray) -> Picture:
    width, height = CAMERA.size
    v, u = np.mgrid[:height, :width]
    thing = np.hypot(u - 0.42 * width, v - 0.87 * height) < 0.075 * width
    pixels: Picture = encoded_from_linear(np.where(thing[..., None], 0.02, light).astype(np.float32), np.uint8)
    return pixels


@pytest.fixture
def shod(tmp_path: Path) -> Path:
    """Six frames with something dark at the same place of each."""
    turns = np.array([orientation(60 * k, 25 * (-1) ** k, 3 * k) for k in range(6)])
    kept = []
    for k, frame in enumerate(frames_of(waves, CAMERA, turns, with_a_thing)):
        path = tmp_path / f"frame_{k}.png"
        with open_panorama(path, frame.size, 3, np.uint8, {}, False) as writer:
            writer.write_rows(0, frame.load())
        kept.append(Frame(path.name, str(path), frame.size, frame.load, camera_from_world=turns[k]))
    save_mosaic(tmp_path / "mosaic.json", Mosaic((CAMERA,), tuple(kept), ()))
    return tmp_path / "mosaic.json"


def test_what_turns_with_the_camera_is_hidden_and_told(shod: Path, fullsphere: Run, tmp_path: Path) -> None:
    hidden = fullsphere("compose", shod, "-o", tmp_path / "a.tif", "--size", "400", "--json")
    assert hidden.code == 0, hidden.err
    assert any("turns with the camera" in warning and "--turning keep" in warning for warning in hidden.warnings)
    assert len(json.loads(hidden.out)["notes"]) == 1
    kept = fullsphere("compose", shod, "-o", tmp_path / "b.tif", "--size", "400", "--json", "--turning", "keep")
    assert kept.code == 0
    assert not kept.warnings
    assert json.loads(kept.out)["notes"] == []
