"""`fullsphere inspect`: every kind of file described, two cameras compared, wrong kinds named."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from calibrations import CAMERA, made_calibration

from fullsphere.cli import main as frame
from fullsphere.cli.main import main
from fullsphere.model.calibration.record import save_calibration
from fullsphere.model.calibration.target_file import parse_target, save_target
from fullsphere.model.camera import Camera
from fullsphere.model.files import write_json
from fullsphere.model.images import gpano, open_panorama
from fullsphere.model.store import camera_to_dict, save_camera

Inspect = Callable[..., tuple[int, str, str]]


@pytest.fixture
def inspect(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Inspect:
    """Runs the command; answers its exit code, standard output and standard error."""
    monkeypatch.setattr(frame, "_LIBRARY_THREADS", ())  # the environment of the tests stays as it is

    def run(*arguments: object) -> tuple[int, str, str]:
        code = main(["inspect", *map(str, arguments)])
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    path, points = tmp_path / "calibrated.json", tmp_path / "points.csv"
    points.write_text("image")
    save_calibration(path, made_calibration(points=40), [points])
    return path


def saved(path: Path, camera: Camera) -> Path:
    save_camera(path, camera)
    return path


def test_a_calibrated_camera_is_described(inspect: Inspect, calibrated: Path) -> None:
    code, out, err = inspect(calibrated)
    assert (code, err) == (0, "")
    for stated in (
        "bakstein-pajdla lens", "640 x 600 pixels", "(318.00, 301.00) px, aspect 1.01000, field of view 184.0 degrees",
        "over 80 points in 2 views", "points seen from 2.0 to 90.0 degrees", "made from points.csv",
    ):  # fmt: skip
        assert stated in out
    table = out.split("sigma (px)\n")[1].splitlines()
    assert [line.split()[0] for line in table] == [*map(str, range(0, 91, 10)), "92"]
    assert [line.endswith("extrapolated") for line in table] == [False] * 10 + [True]
    code, out, _ = inspect(calibrated, "--json")
    value = json.loads(out)
    assert (value["kind"], value["calibration"]["points"], value["curve"][-1]["extrapolated"]) == ("camera", 80, True)


def test_a_camera_typed_by_hand_is_described_without_what_it_does_not_say(inspect: Inspect, tmp_path: Path) -> None:
    bare = {key: value for key, value in camera_to_dict(CAMERA).items() if key != "curve"}
    write_json(tmp_path / "camera.json", {**bare, "calibration": {"rms_px": "?", "observed_theta_deg": [1]}}, False)
    code, out, _ = inspect(tmp_path / "camera.json")
    assert code == 0
    assert "rms" not in out
    assert "extrapolated" not in out
    assert f"{float(CAMERA.lens.radius(math.radians(50))):.3f}          -" in out


def test_a_target_is_described(inspect: Inspect, tmp_path: Path) -> None:
    save_target(tmp_path / "target.json", parse_target("chessboard:6x8:117mm"))
    code, out, _ = inspect(tmp_path / "target.json")
    assert code == 0
    assert "1 board, 48 marks over 585, 819, 0 mm" in out
    assert "chessboard, columns 6, rows 8, square_mm 117.0, flat" in out
    write_json(tmp_path / "bad.json", {"format": "fullsphere-target/1"}, False)
    code, _, err = inspect(tmp_path / "bad.json")
    assert code == 3
    assert "boards" in err


@pytest.mark.parametrize("ending", ["tif", "jpg", "png"])
def test_a_panorama_is_told_from_a_picture(inspect: Inspect, tmp_path: Path, ending: str) -> None:
    for name, fields in (("sphere", gpano((64, 32))), ("plain", {})):
        with open_panorama(tmp_path / f"{name}.{ending}", (64, 32), 4, "uint8", fields, False) as file:
            file.write_rows(0, np.full((32, 64, 4), 200, np.uint8))
    code, out, _ = inspect(tmp_path / f"sphere.{ending}")
    assert code == 0
    assert "64 x 32 pixels" in out
    assert "GPano: equirectangular, the whole sphere" in out
    assert json.loads(inspect(tmp_path / f"sphere.{ending}", "--json")[1])["gpano"] == "equirectangular"
    assert "no GPano fields" in inspect(tmp_path / f"plain.{ending}")[1]


def test_equal_cameras_do_not_differ_and_a_shifted_one_differs_by_its_turn(inspect: Inspect, tmp_path: Path) -> None:
    first = saved(tmp_path / "first.json", CAMERA)
    moved = dataclasses.replace(CAMERA, centre=(CAMERA.centre[0] + 2, CAMERA.centre[1]))
    code, out, _ = inspect(first, saved(tmp_path / "same.json", CAMERA), "--json")
    same = json.loads(out)
    assert code == 0
    assert max(same["largest_deg"], same["largest_px"], same["rotation_deg"]) < 1e-6
    code, out, _ = inspect(first, saved(tmp_path / "moved.json", moved), "--json")
    value = json.loads(out)
    assert code == 0
    assert 0.5 < math.radians(value["rotation_deg"]) * float(CAMERA.lens.slope(0.0)) / 2 < 2
    assert 0 < value["rms_px"] < 2  # most of the two pixels is the turn
    assert value["rms_deg"] < value["largest_deg"]
    assert len(value["theta_deg"]) == len(value["profile_deg"]) > 10
    code, out, _ = inspect(first, tmp_path / "moved.json")
    assert f"rms {value['rms_deg']:.5f} degrees" in out
    assert f"a common rotation of {value['rotation_deg']:.4f} degrees" in out


def test_figure_and_page_are_written_and_the_same_in_every_process(tmp_path: Path, calibrated: Path) -> None:
    other = dataclasses.replace(made_calibration().camera, aspect=1.0)
    saved(tmp_path / "other.json", other)
    code = "import sys; from fullsphere.cli.main import main; sys.exit(main(sys.argv[1:]))"
    contents = []
    for seed in ("1", "2"):
        done = subprocess.run(
            [
                *(sys.executable, "-c", code, "inspect", "calibrated.json", "other.json"),
                *("--figure", "map.svg", "--report", "page.html", "--overwrite"),
            ],
            cwd=tmp_path,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, "")
        files = [tmp_path / "map.svg", tmp_path / "page.html", *sorted((tmp_path / "page-figures").iterdir())]
        contents.append([file.read_bytes() for file in files])
    assert contents[0] == contents[1]
    assert [file.name for file in files[2:]] == ["difference.pdf", "difference.png"]
    assert b"calibrated.json and other.json compared" in contents[0][1]


def test_a_page_of_one_camera_shows_its_curve(inspect: Inspect, calibrated: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert inspect(calibrated, "--report", page)[0] == 0
    names = {path.stem for path in (tmp_path / "page-figures").iterdir()}
    assert names == {"projection-functions", "curve-sigma"}
    before = page.read_bytes()
    code, _, err = inspect(calibrated, "--report", page)
    assert code == 5
    assert "--overwrite" in err
    assert page.read_bytes() == before


def test_wrong_files_and_options_are_named(inspect: Inspect, calibrated: Path, tmp_path: Path) -> None:
    larger = saved(tmp_path / "larger.json", CAMERA.scaled(2))
    save_target(tmp_path / "target.json", parse_target("chessboard:6x8:117mm"))
    write_json(tmp_path / "other.json", {"format": "kalibr"}, False)
    write_json(tmp_path / "list.json", [1], False)
    (tmp_path / "text.txt").write_text("hello")
    cases: list[tuple[list[object], int, list[str]]] = [
        ([calibrated, larger], 3, ["larger.json", "1280 x 1200", "640 x 600"]),
        ([calibrated, tmp_path / "target.json"], 3, ["target.json", "is it a camera file?"]),
        ([calibrated, tmp_path / "text.txt"], 3, ["text.txt", "both are a camera.json"]),
        ([tmp_path / "other.json"], 3, ["other.json", "'kalibr'", "mosaic.json"]),
        ([tmp_path / "list.json"], 3, ["list.json", "no file that fullsphere wrote"]),
        ([tmp_path / "text.txt"], 3, ["text.txt", "not a picture"]),
        ([tmp_path / "absent.json"], 3, ["absent.json", "no such file"]),
        ([calibrated] * 3, 2, ["3 files"]),
        ([calibrated, "--figure", tmp_path / "a.png"], 2, ["two cameras"]),
        ([calibrated, larger, "--figure", tmp_path / "a.gif"], 2, ["a.gif", ".png, .pdf or .svg"]),
        ([calibrated, calibrated, "--figure", tmp_path / "a.png", "--report", tmp_path / "a.png"], 2, ["same file"]),
        ([tmp_path / "target.json", "--report", tmp_path / "a.html"], 2, ["target.json", "cameras and mosaics only"]),
        ([calibrated, larger, "--report", calibrated, "--overwrite"], 5, ["calibrated.json", "is an input"]),
    ]
    before = sorted(tmp_path.rglob("*"))
    for arguments, expected, named in cases:
        code, out, err = inspect(*arguments)
        assert (code, out) == (expected, ""), arguments
        assert err.count("\n") == 1
        assert all(part in err for part in named), err
    assert sorted(tmp_path.rglob("*")) == before
