"""Bracketed frames from the command: merged, registered, composed to light, and used again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lamps import LAMP, Lamps, brackets_in, written
from rooms import Outcome
from turning import orientation

from fullsphere.model.images import read_picture
from fullsphere.model.store import save_camera
from fullsphere.model.surface import Equirectangular
from laws import fisheye, pixel_rays

CAMERA = fisheye(300)
TURNS = np.array([orientation(108.0 * k, 4.0 * k) for k in range(3)])
SOFTLY = ("--size", "400", "--blend", "feather")  # seams are not what this is about
Run = Callable[..., Outcome]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("brackets")
    brackets_in(folder, CAMERA, TURNS)
    save_camera(folder / "camera.json", CAMERA)
    return folder


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("[A-H]_?.png"))


def test_brackets_become_a_panorama_of_light(folder: Path, fullsphere: Run, tmp_path: Path) -> None:
    pano, project = tmp_path / "pano.exr", tmp_path / "mosaic.json"
    run = fullsphere(
        "stitch", *files(folder), "--brackets", "auto", "--camera", folder / "camera.json", "--level", "none",
        "-o", pano, "--mosaic", project, *SOFTLY, "--exposure", "none",
    )  # fmt: skip
    assert run.code == 0, run.err
    assert "3 positions of 3 brackets: -2 0 +2 EV" in run.err
    assert not [line for line in run.warnings if "held by" not in line]
    frames = json.loads(project.read_text())["frames"]
    assert [[one["image"][-7:] for one in frame["brackets"]] for frame in frames] == [
        [f"{name}_{k}.png" for k in range(3)] for name in "ABC"
    ]
    picture = read_picture(pano)
    assert picture.pixels.dtype == np.float32 and picture.linear
    seen, light = picture.pixels[..., 3] > 0, picture.pixels[..., :3]
    truth = Lamps().radiance(pixel_rays(Equirectangular((400, 200))) @ TURNS[0])
    close = np.abs(np.log2(light[seen] / truth[seen]))
    assert light[seen].min() > 0.5 * truth[seen].min()  # no black ring round a lamp
    assert seen.mean() > 0.97
    assert np.median(close) < 0.05
    assert np.median(np.abs(light[(truth.min(-1) == LAMP) & seen] / LAMP - 1)) < 0.02

    run = fullsphere("inspect", project)
    assert run.code == 0 and "merged: 3 positions of 3 brackets: -2 0 +2 EV\n" in run.out

    again = tmp_path / "again.exr"
    run = fullsphere("compose", project, "-o", again, *SOFTLY, "--exposure", "none")
    assert run.code == 0, run.err
    assert np.array_equal(read_picture(again).pixels, picture.pixels)
    run = fullsphere("compose", project, "-o", tmp_path / "plain.jpg", *SOFTLY)
    assert run.code == 0, run.err
    codes = read_picture(tmp_path / "plain.jpg").pixels
    assert codes.dtype == np.uint8 and 15 < np.median(codes) < 100 and np.median(codes[truth.min(-1) == LAMP]) > 240

    new = brackets_in(tmp_path / "new", CAMERA, TURNS, (0.0, 2.0), noted=False)
    run = fullsphere("compose", project, "--frames", *new, "--brackets", 2, "-o", tmp_path / "new.exr", *SOFTLY)
    assert run.code == 0, run.err
    assert "3 positions of 2 brackets: 0 +2 EV" in run.err
    assert read_picture(tmp_path / "new.exr").pixels[..., :3].max() < 1.3  # no darker bracket knows the lamps

    (tmp_path / "gone").mkdir()
    value = json.loads(project.read_text())
    value["frames"][1]["brackets"][2]["image"] = "gone/B_2.png"
    project.write_text(json.dumps(value))
    run = fullsphere("compose", project, "-o", tmp_path / "gone.exr")
    assert run.code == 3 and "B_2.png: there is no such file" in run.error_line


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--brackets", "2"], 2, "9 pictures are no brackets of 2"),
        (["--brackets", "1"], 2, "'1' is no number of pictures from 2 to 15, and not auto"),
        (["--brackets", "many"], 2, "'many' is no number of pictures"),
        (["--brackets", "9"], 3, "a mosaic needs at least two frames, and "),
    ],
)
def test_what_are_no_brackets_is_refused(
    options: list[str], code: int, message: str, folder: Path, fullsphere: Run, tmp_path: Path
) -> None:
    try:
        run = fullsphere("register", *files(folder), *options, "-o", tmp_path / "mosaic.json")
    except SystemExit as error:
        pytest.fail(f"exit {error.code}")
    assert (run.code, message in run.err) == (code, True), run.err
    assert not (tmp_path / "mosaic.json").exists()


def test_equal_pictures_are_no_brackets(folder: Path, fullsphere: Run, tmp_path: Path) -> None:
    middle = files(folder)[1::3]
    run = fullsphere("register", *middle, "--brackets", "auto", "-o", tmp_path / "mosaic.json")
    assert run.code == 3 and "one exposure by what the camera noted: they are no brackets" in run.error_line
    plain = [written(tmp_path / path.name, read_picture(path).pixels) for path in files(folder)[:6]]
    run = fullsphere("register", *plain, "--brackets", "auto", "-o", tmp_path / "mosaic.json")
    assert run.code == 3 and "A_0.png: notes no exposure" in run.error_line


def test_brackets_are_not_for_what_tells_them_itself(folder: Path, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "project.pto").write_text("p f2 w100 h50\n")
    run = fullsphere("register", tmp_path / "project.pto", "--brackets", "3", "-o", tmp_path / "mosaic.json")
    assert run.code == 2
    (tmp_path / "other.json").write_text("{}")
    run = fullsphere("compose", tmp_path / "other.json", "--brackets", "3", "-o", tmp_path / "p.exr")
    assert run.code == 2 and "--brackets is about the new pictures of --frames" in run.error_line
