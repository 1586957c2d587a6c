"""Beside the panorama: a quick look, the frames one by one, and what nobody sees."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from projects import coloured, project_in
from rooms import Outcome

from fullsphere.model.images import linear_from_encoded, read_picture
from fullsphere.model.projection_text import parse_projection

Run = Callable[..., Outcome]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return project_in(tmp_path_factory.mktemp("project"), 3, exposures_ev=(0.0, 0.4, -0.3))


def truth_of(surface: str) -> np.ndarray:
    projection = parse_projection(surface).projection
    v, u = np.mgrid[: projection.size[1], : projection.size[0]].astype(float)
    return coloured(projection.unproject(np.stack([u, v], -1)))


@pytest.mark.parametrize("name", ["p.jpg", "p.exr"])
def test_a_preview_shows_the_scene(name: str, project: Path, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("compose", project, "-o", tmp_path / name, "--preview", "--json")
    assert run.code == 0, run.err
    assert json.loads(run.out)["size_px"] == [256, 128]  # no finer than its frames
    light = linear_from_encoded(read_picture(tmp_path / name).pixels)[..., :3]
    seen = light.max(-1) > 0.01
    assert seen.mean() > 0.95
    assert np.abs(light - truth_of("equirectangular:256"))[seen].max() < 0.05


def test_a_preview_does_nothing_beside(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    for options in (["--resume"], ["--layers", tmp_path / "l"], ["--nadir", "fill"], ["--size", "512"]):
        run = fullsphere("compose", project, "-o", tmp_path / "p.jpg", "--preview", *options)
        assert run.code == 2, run.err
        assert not list(tmp_path.iterdir())


def test_layers_are_the_frames_and_masks_say_who_owns_what(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    folder = tmp_path / "layers"
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--size", 300, "--layers", folder)
    assert run.code == 0, run.err
    names = {f"frame_{k}{end}.tif" for k in range(3) for end in ("", "_mask")}
    assert {path.name for path in folder.iterdir()} == names
    truth, whole = truth_of("equirectangular:300"), read_picture(tmp_path / "p.tif").pixels
    owners = np.zeros((150, 300), int)
    for k in range(3):
        layer = read_picture(folder / f"frame_{k}.tif").pixels
        mask = read_picture(folder / f"frame_{k}_mask.tif").pixels[..., 0]
        seen = layer[..., 3] > 0
        assert 0.3 < seen.mean() < 0.8
        assert np.abs(linear_from_encoded(layer)[..., :3] - truth)[seen].max() < 0.02
        assert set(np.unique(mask)) == {0, 255}
        owners += mask > 0
        alike = np.abs(layer[..., :3].astype(int) - whole[..., :3])[(mask > 0) & seen]
        assert np.median(alike) <= 1
    assert (owners == 1).all()


def test_layers_that_exist_are_left_alone(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "frame_1.tif").write_bytes(b"mine")
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--size", 128, "--layers", tmp_path)
    assert (run.code, (tmp_path / "frame_1.tif").read_bytes()) == (5, b"mine")
    assert not (tmp_path / "p.tif").exists()


@pytest.mark.parametrize("name", ["p.tif", "p.exr"])
def test_what_nobody_sees_is_continued_smoothly(name: str, fullsphere: Run, tmp_path: Path) -> None:
    ahead = project_in(tmp_path / "ahead", 1)
    left = fullsphere("compose", ahead, "-o", tmp_path / f"left{name}", "--size", 400)
    filled = fullsphere("compose", ahead, "-o", tmp_path / name, "--size", 400, "--nadir", "fill")
    assert (left.code, filled.code) == (0, 0), filled.err
    assert "the others filled" in filled.out
    before, after = (read_picture(tmp_path / file).pixels for file in (f"left{name}", name))
    seen = before[..., 3] > 0
    assert 0.4 < seen.mean() < 0.6
    np.testing.assert_array_equal(after[seen], before[seen])
    assert (after[..., 3] == after[..., 3].max()).all()
    light = linear_from_encoded(after)[..., :3]
    steps = np.abs(np.diff(light, axis=1))
    assert steps[seen[:, 1:] != seen[:, :-1]].max() < 0.05  # the rim shows no edge
    assert light.min() > 0.02
