"""`fullsphere calibrate`: photos or points to a camera and a report; what is wrong is said in one line."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from board_photos import board_pose, photograph_board, wide_camera
from fullsphere.cli import main as frame
from fullsphere.cli.main import main
from fullsphere.model.calibration.boards import CharucoBoard, Chessboard
from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, FloatArray
from fullsphere.model.store import load_camera

CAMERA = wide_camera(480, 400)
BOARD, SPEC = CharucoBoard(8, 6, 40.0, 29.0), "charuco:8x6:40mm:29mm"
PLACES = ((0, 0, 150, 20), (35, 20, 150, -20), (40, 140, 170, 15), (35, 260, 150, 20), (60, 60, 190, 0))
SIZE = ("--image-size", "640x600")
HEADER = "image,x_mm,y_mm,z_mm,u_px,v_px"

Calibrate = Callable[..., tuple[int, str, str]]


@pytest.fixture
def calibrate(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Calibrate:
    """Runs the command in a folder of its own; answers its exit code, standard output and standard error."""
    monkeypatch.setattr(frame, "_LIBRARY_THREADS", ())  # the environment of the tests stays as it is
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        code = main(["calibrate", *map(str, arguments)])
        return code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    """Photos of the ChArUco board at `PLACES`."""
    return [photograph_board(BOARD, CAMERA, board_pose(BOARD, *place, roll_deg=10 * place[0])) for place in PLACES]


@pytest.fixture
def photos(pictures: list[np.ndarray], tmp_path: Path) -> list[str]:
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"board_{k}.png"), picture)
    return [f"board_{k}.png" for k in range(len(pictures))]


def empty_photo(folder: Path, size: tuple[int, int] = CAMERA.size) -> str:
    noise = np.random.default_rng(0).normal(120, 3, size[::-1])
    cv2.imwrite(str(folder / "empty.png"), noise.clip(0, 255).astype(np.uint8))
    return "empty.png"


def assert_one_line(err: str) -> None:
    assert err.startswith("fullsphere: error: ") and err.count("\n") == 1, err


def write_points(folder: Path, bow_mm: float = 0.0, noise_px: float = 0.03, side: int = 9) -> str:
    """Six pictures of a flat grid of 240 mm, its middle `bow_mm` off along x; the camera is of 640 x 600 pixels."""
    half = math.radians(92)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    camera = Camera(lens.scaled(290 / float(lens.radius(half))), (640, 600), (318.0, 301.0), half_fov=half)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 240, side)] * 2))
    bowed = np.stack([x, y, bow_mm * (1 - (x / 120 - 1) ** 2)], -1)
    board = Chessboard(side - 2, side - 2, 30.0)  # its marks have the middle that the poses need
    rng = np.random.default_rng(1)
    lines = [HEADER]
    for k, place in enumerate(((0, 0, 110, 25), (40, 30, 110, -20), (45, 120, 120, 20), (40, 210, 110, 25),
                               (50, 300, 120, -15), (20, 80, 200, 30))):  # fmt: skip
        turn, shift = board_pose(board, *place, roll_deg=40 * k)
        pixels = camera.project(bowed @ turn.T + shift)
        pixels += rng.normal(0, noise_px, pixels.shape)
        rows = [(px, py, 0.0, u, v) for px, py, (u, v) in zip(x, y, pixels, strict=True) if math.isfinite(u)]
        lines += [f"view_{k}," + ",".join(f"{value:.5f}" for value in row) for row in rows]
    (folder / "points.csv").write_text("\n".join(lines) + "\n")
    return "points.csv"


def curve_error_px(camera: Camera, truth: Camera, to_deg: float) -> FloatArray:
    theta = np.radians(np.arange(0, to_deg))
    return np.abs(camera.lens.radius(theta) - truth.lens.radius(theta))


def test_photos_of_a_target_make_a_camera_and_a_report(calibrate: Calibrate, photos: list[str], tmp_path: Path) -> None:
    code, out, err = calibrate(*photos, "--target", SPEC, "-o", "camera.json", "--report", "report.html")
    assert code == 0, err
    assert f"{SPEC} found in 5 of 5 photos" in err
    assert re.search(r"camera\.json: bakstein-pajdla lens, rms 0\.\d+ px over \d+ points in 5 views", out)
    assert curve_error_px(load_camera(tmp_path / "camera.json"), CAMERA, 80).max() < 0.3
    assert "<html" in (tmp_path / "report.html").read_text()
    assert len(list((tmp_path / "report-figures").glob("*.png"))) >= 8


def test_json_says_what_was_found_and_nothing_else(calibrate: Calibrate, photos: list[str]) -> None:
    code, out, err = calibrate(*photos[:3], "--target", SPEC, "-o", "camera.json", "--json")
    assert (code, err) == (0, "")
    value = json.loads(out)
    assert set(value) == {
        "camera", "lens", "values", "half_field_of_view_deg", "rms_px", "rms_with_rejected_px", "points",
        "rejected_points", "views", "left_out", "observed_theta_deg", "photos", "found",
    }  # fmt: skip
    assert (value["camera"], value["photos"], value["found"], value["views"]) == ("camera.json", 3, 3, 3)
    assert (value["left_out"], value["rejected_points"]) == ({}, 0)
    assert value["values"].keys() >= {"a_px", "b", "c_px", "d", "centre_u_px", "centre_v_px", "aspect"}
    assert value["rms_px"] < 0.15 and value["points"] > 80


def test_a_photo_without_the_target_is_named_and_left_out(
    calibrate: Calibrate, photos: list[str], tmp_path: Path
) -> None:
    empty = empty_photo(tmp_path)
    (tmp_path / "copy.png").write_bytes((tmp_path / photos[0]).read_bytes())
    code, out, err = calibrate(*photos[:3], empty, "copy.png", "--target", SPEC, "-o", "camera.json", "--strict")
    assert code == 3
    assert f"fullsphere: warning: {empty} is left out: no marks of {SPEC} found in it" in err
    assert f"fullsphere: warning: copy.png is left out: it is the same picture as {photos[0]}" in err
    assert f"{SPEC} found in 4 of 5 photos" in err
    assert "in 3 views" in out
    assert (tmp_path / "camera.json").exists()


def test_no_target_in_any_photo(calibrate: Calibrate, tmp_path: Path) -> None:
    code, out, err = calibrate(empty_photo(tmp_path), "--target", SPEC, "-o", "camera.json", "--json")
    assert (code, out) == (3, "")
    assert_one_line(err)
    assert f"empty.png: no {SPEC} found" in err
    assert not (tmp_path / "camera.json").exists()


def test_a_target_of_other_dimensions_is_named_as_it_is_seen(calibrate: Calibrate, tmp_path: Path) -> None:
    board = Chessboard(7, 5, 40.0)
    cv2.imwrite(str(tmp_path / "seen.png"), photograph_board(board, CAMERA, board_pose(board, 0, 0, 170, 20)))
    code, _, err = calibrate("seen.png", "--target", "chessboard:6x5:40mm", "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert "seen.png: no chessboard:6x5:40mm found; a chessboard of 7 x 5 inner corners is seen, not 6 x 5" in err


def test_other_markers_are_named_as_they_are_seen(calibrate: Calibrate, photos: list[str]) -> None:
    other = f"{SPEC}:DICT_4X4_100"
    code, _, err = calibrate(photos[0], "--target", other, "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert "markers of DICT_5X5_1000 are seen, not of DICT_4X4_100" in err


def test_mirrored_photos_are_told(calibrate: Calibrate, pictures: list[np.ndarray], tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "mirrored.png"), pictures[0][:, ::-1])
    code, _, err = calibrate("mirrored.png", "--target", SPEC, "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert "mirrored" in err.split("found; ")[1]


def test_photos_of_two_sizes(calibrate: Calibrate, photos: list[str], tmp_path: Path) -> None:
    odd = empty_photo(tmp_path, (300, 200))
    code, _, err = calibrate(*photos[:2], odd, "--target", SPEC, "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert f"{odd}: 300 x 200 pixels, but most photos have 480 x 400" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["board_0.png"], "photos need --target"),
        (["board_0.png", "--points", "points.csv", *SIZE], "either photos with --target, or --points"),
        ([], "either photos with --target, or --points"),
        (["--points", "points.csv"], "--points needs --image-size"),
        (["--points", "points.csv", *SIZE, "--target", SPEC], "--target is for photos"),
        (["board_0.png", "--target", SPEC, *SIZE], "--image-size is for --points"),
        (["--points", "points.csv", "--image-size", "640"], "'640' is not a size like 1280x800"),
        (["--points", "points.csv", *SIZE, "--field-of-view", "400"], "'400' is not an angle"),
        (["--points", "points.csv", *SIZE, "--lens", "magic"], "there is no lens 'magic'; the lenses are"),
        (["board_0.png", "--target", "chessboard:6x8"], "is not of the form chessboard:COLUMNSxROWS:SQUARE"),
        (["board_0.png", "--target", "chessboard:6x8:30"], "'30' has no unit"),
    ],
)
def test_wrong_usage_is_one_line(
    calibrate: Calibrate, photos: list[str], tmp_path: Path, arguments: list[str], said: str
) -> None:
    write_points(tmp_path, side=5)
    code, out, err = calibrate(*arguments, "-o", "camera.json")
    assert (code, out) == (2, "")
    assert_one_line(err)
    assert said in err
    assert not (tmp_path / "camera.json").exists()


@pytest.mark.parametrize("missing", ["gone.png", "gone.csv", "gone.json"])
def test_a_file_that_is_not_there_is_named(calibrate: Calibrate, photos: list[str], missing: str) -> None:
    arguments = {
        "gone.png": [*photos[:1], missing, "--target", SPEC],
        "gone.csv": ["--points", missing, *SIZE],
        "gone.json": [*photos[:1], "--target", missing],
    }[missing]
    code, _, err = calibrate(*arguments, "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert missing in err


@pytest.mark.parametrize("existing", ["camera.json", "report.html"])
def test_outputs_that_exist_stay(calibrate: Calibrate, photos: list[str], tmp_path: Path, existing: str) -> None:
    (tmp_path / existing).write_text("mine")
    code, _, err = calibrate(*photos, "--target", SPEC, "-o", "camera.json", "--report", "report.html")
    assert code == 5
    assert_one_line(err)
    assert existing in err and "--overwrite" in err
    assert (tmp_path / existing).read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {existing, *photos}


def test_an_input_is_never_an_output(calibrate: Calibrate, photos: list[str], tmp_path: Path) -> None:
    before = (tmp_path / photos[0]).read_bytes()
    code, _, err = calibrate(*photos, "--target", SPEC, "-o", photos[0], "--overwrite")
    assert code == 5
    assert_one_line(err)
    assert (tmp_path / photos[0]).read_bytes() == before


def test_all_lenses_are_compared_on_request(calibrate: Calibrate, tmp_path: Path) -> None:
    points = write_points(tmp_path, side=7)
    code, out, err = calibrate("--points", points, *SIZE, "--lens", "auto", "-o", "camera.json")
    assert code == 0, err
    table, _, rest = out.partition("\nUse the ")
    assert table.startswith("lens ") and "held out" in table
    for lens in ("bakstein-pajdla", "kannala-brandt", "equidistant", "perspective"):
        assert re.search(rf"^{lens} ", table, re.MULTILINE)
    assert " lens: " in rest.splitlines()[0] and "px rms on points that its fit never saw" in rest.splitlines()[0]
    chosen = rest.split()[0]
    assert load_camera(tmp_path / "camera.json").lens.projection == chosen
    assert f"camera.json: {chosen} lens, rms" in rest


def test_the_bow_of_a_board_is_solved_for_on_request(calibrate: Calibrate, tmp_path: Path) -> None:
    points = write_points(tmp_path, bow_mm=1.5)
    code, out, err = calibrate("--points", points, *SIZE, "--bow", "-o", "camera.json")
    assert code == 0, err
    found = re.search(r"bow of the board ([+-]\d+\.\d+) mm along x, ([+-]\d+\.\d+) mm along y", out)
    assert found
    assert math.isclose(float(found[1]), 1.5, abs_tol=0.1) and abs(float(found[2])) < 0.1
    code, flat, _ = calibrate("--points", points, *SIZE, "-o", "flat.json", "--json")
    code, bowed, _ = calibrate("--points", points, *SIZE, "--bow", "-o", "camera.json", "--overwrite", "--json")
    assert json.loads(bowed)["rms_px"] < 0.5 * json.loads(flat)["rms_px"]
    assert "bow_mm" not in json.loads(flat) and len(json.loads(bowed)["bow_mm"]) == 2


def test_wrong_points_are_named(calibrate: Calibrate, tmp_path: Path) -> None:
    table = tmp_path / write_points(tmp_path)
    lines = table.read_text().splitlines()
    *place, u, v = lines[40].split(",")
    lines[40] = ",".join([*place, str(float(u) + 25), v])
    table.write_text("\n".join(lines) + "\n")
    code, out, err = calibrate("--points", table.name, *SIZE, "-o", "camera.json", "--strict")
    assert code == 3
    assert re.search(rf"view_0: 1 of \d+ points rejected, the worst at \({float(u) + 25:.0f}, \d+\), 2[45]\.\d px", err)
    assert "with 1 rejected points)" in out


def test_the_field_of_view_is_as_given(calibrate: Calibrate, tmp_path: Path) -> None:
    points = write_points(tmp_path)
    code, out, _ = calibrate("--points", points, *SIZE, "--field-of-view", "183", "-o", "camera.json")
    assert code == 0 and "field of view 183.0 degrees" in out
    assert math.isclose(math.degrees(load_camera(tmp_path / "camera.json").half_fov), 91.5, abs_tol=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "points.csv: the file is empty"),
        (f"{HEADER}\n", "points.csv: no rows below"),
        ("image,x_mm,y_mm,u_px,v_px\na,1,2,3,4\n", "points.csv: no column z_mm"),
        (f"{HEADER}\na,1,2,3,4,5\n".replace(",", ";"), "points.csv: the columns look separated by semicolons"),
        (f"{HEADER}\na,1,2,3,4,5\na,1,2,3,nan,5\n", "points.csv: line 3, column u_px: nan is not finite"),
        (f"{HEADER}\na,1,2,3,4,x\n", "points.csv: line 2, column v_px: 'x' is not a number"),
        (f"{HEADER}\na,1,2,3,4\n", "points.csv: line 2 has 5 fields"),
    ],
)
def test_faults_of_a_table_name_their_line(calibrate: Calibrate, tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "points.csv").write_text(text)
    code, _, err = calibrate("--points", "points.csv", *SIZE, "-o", "camera.json", "--json")
    assert code == 3
    assert_one_line(err)
    assert said in err


def test_points_outside_the_picture_are_not_calibrated_from(calibrate: Calibrate, tmp_path: Path) -> None:
    points = write_points(tmp_path)
    code, _, err = calibrate("--points", points, "--image-size", "300x300", "-o", "camera.json", "--json")
    assert code == 4
    assert_one_line(err)
    assert "outside the picture of 300 x 300 pixels" in err


def test_points_on_a_line_fix_no_pose(calibrate: Calibrate, tmp_path: Path) -> None:
    rows = [f"a,{10 * k},0,0,{300 + 10 * k},300" for k in range(20)]
    (tmp_path / "points.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    code, _, err = calibrate("--points", "points.csv", *SIZE, "-o", "camera.json", "--json")
    assert code == 4
    assert_one_line(err)
    assert "lie on one line" in err


def test_the_same_photos_give_the_same_bytes(calibrate: Calibrate, photos: list[str], tmp_path: Path) -> None:
    for name in ("one.json", "two.json"):
        assert calibrate(*photos[:2], "--target", SPEC, "-o", name, "--json")[0] == 0
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
