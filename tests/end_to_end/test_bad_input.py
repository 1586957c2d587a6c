"""What goes wrong, each with its exit code, one clear line, and nothing left behind."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rooms import Outcome, Set

Run = Callable[..., Outcome]


def test_a_missing_frame_is_named(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("stitch", *room_set.frames, tmp_path / "nowhere.jpg", "-o", tmp_path / "p.tif")
    assert run.code == 3
    assert "nowhere.jpg" in run.error_line
    assert list(tmp_path.iterdir()) == []


def test_text_named_jpg_is_no_picture(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "notes.jpg").write_text("these are words")
    run = fullsphere("stitch", tmp_path / "notes.jpg", room_set.frames[0], "-o", tmp_path / "p.tif")
    assert run.code == 3
    assert "notes.jpg" in run.error_line
    assert "not a picture" in run.error_line


def test_a_truncated_frame_is_left_out_by_name(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    whole = room_set.frames[1].read_bytes()
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    frames = [room_set.frames[0], tmp_path / "cut.jpg", *room_set.frames[2:]]
    common = ("--camera", room_set.camera_file, "--size", 256)
    run = fullsphere("stitch", *frames, "-o", tmp_path / "p.tif", *common, "--mosaic", tmp_path / "m.json")
    assert run.code == 0
    assert len(run.warnings) == 1
    assert "cut.jpg" in run.warnings[0]
    status = {f["id"]: f["status"] for f in json.loads((tmp_path / "m.json").read_text())["frames"]}
    assert status["cut.jpg"] == "left-out"
    assert fullsphere("stitch", *frames, "-o", tmp_path / "q.tif", *common, "--strict").code == 3


def test_a_frame_of_another_place_is_left_out(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere(
        *("stitch", *room_set.frames, room_set.other_room, "-o", tmp_path / "p.tif"),
        *("--camera", room_set.camera_file, "--size", 256),
    )
    assert run.code == 0
    assert len(run.warnings) == 1
    assert "other_room.jpg" in run.warnings[0]


def test_one_frame_is_no_mosaic(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("stitch", room_set.frames[0], "-o", tmp_path / "p.tif")
    assert run.code == 3
    assert "two frames" in run.error_line


def test_the_same_frame_twice_is_no_mosaic(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    copy = tmp_path / "copy.jpg"
    copy.write_bytes(room_set.frames[0].read_bytes())
    run = fullsphere("stitch", room_set.frames[0], copy, "-o", tmp_path / "p.tif")
    assert run.code == 3
    assert "same file as frame_0.jpg" in run.error_line


def test_frames_that_do_not_overlap_cannot_be_solved(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere(
        *("stitch", room_set.frames[0], room_set.other_room, "-o", tmp_path / "p.tif", "--camera", room_set.camera_file)
    )
    assert run.code == 4
    assert "overlap" in run.error_line
    assert list(tmp_path.iterdir()) == []


def test_blank_frames_cannot_be_solved(fullsphere: Run, tmp_path: Path) -> None:
    for k, level in enumerate((90, 120)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((300, 400, 3), level, np.uint8))
    run = fullsphere("stitch", tmp_path / "0.png", tmp_path / "1.png", "-o", tmp_path / "p.tif")
    assert run.code == 4
    assert not (tmp_path / "p.tif").exists()


def test_a_camera_of_another_size_is_refused(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    camera = json.loads(room_set.camera_file.read_text())
    camera["image_size_px"] = [1280, 800]
    (tmp_path / "other.json").write_text(json.dumps(camera))
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.tif", "--camera", tmp_path / "other.json")
    assert run.code == 3
    assert "1280 x 800" in run.error_line
    assert "640 x 640" in run.error_line


@pytest.mark.parametrize("number", ["NaN", "1e999", "-Infinity", "true", '"wide"'])
@pytest.mark.parametrize("key", ["aspect", "half_field_of_view_deg"])
def test_a_camera_with_a_senseless_number_is_refused(
    room_set: Set, fullsphere: Run, tmp_path: Path, key: str, number: str
) -> None:
    camera = json.loads(room_set.camera_file.read_text())
    text = json.dumps({**camera, key: "HERE"}).replace('"HERE"', number)
    (tmp_path / "bad.json").write_text(text)
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.tif", "--camera", tmp_path / "bad.json")
    assert run.code == 3
    assert "bad.json" in run.error_line


def test_an_existing_output_is_kept(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "p.tif").write_bytes(b"precious")
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.tif")
    assert run.code == 5
    assert "--overwrite" in run.error_line
    assert (tmp_path / "p.tif").read_bytes() == b"precious"


def test_an_input_is_never_overwritten(room_set: Set, fullsphere: Run) -> None:
    before = room_set.frames[0].read_bytes()
    run = fullsphere("stitch", *room_set.frames, "-o", room_set.frames[0], "--overwrite")
    assert run.code == 5
    assert room_set.frames[0].read_bytes() == before


def test_a_folder_that_does_not_exist_is_told_before_the_work(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "nowhere" / "p.tif")
    assert run.code == 5
    assert "reading frames" not in run.err


@pytest.mark.parametrize("size", [1001, 0, -2, 3_000_000])
def test_a_size_that_cannot_be_is_a_usage_error(room_set: Set, fullsphere: Run, tmp_path: Path, size: int) -> None:
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.tif", f"--size={size}")
    assert run.code == 2
    assert list(tmp_path.iterdir()) == []


def test_a_size_that_has_no_room_is_told_before_the_work(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.png", "--size", 1_000_000)
    assert run.code == 6
    assert "reading frames" not in run.err
    assert fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.jpg", "--size", 65600).code == 2


@pytest.mark.parametrize("name", ["shot.CR2", "shot.nef", "shot.heic"])
def test_raw_and_heic_say_what_to_convert_to(room_set: Set, fullsphere: Run, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bytes(range(256)) * 8)
    run = fullsphere("stitch", tmp_path / name, room_set.frames[0], "-o", tmp_path / "p.tif")
    assert run.code == 3
    assert "TIFF" in run.error_line or "JPEG" in run.error_line


@pytest.mark.parametrize(
    "arguments", [["--bogus"], ["--size", "wide"], ["--camera", "a.json", "--calibrate", "b.csv"], ["--threads", "0"]]
)
def test_a_wrong_option_is_a_usage_error(room_set: Set, fullsphere: Run, tmp_path: Path, arguments: list[str]) -> None:
    run = fullsphere("stitch", *room_set.frames, "-o", tmp_path / "p.tif", *arguments)
    assert run.code == 2
    assert run.error_line


def test_a_picture_of_another_size_is_not_remapped(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((20, 30, 3), np.uint8))
    run = fullsphere(
        *("remap", tmp_path / "small.png", "--from", room_set.camera_file, "--to", "equirectangular:64"),
        *("-o", tmp_path / "p.png"),
    )
    assert run.code == 3
    assert "30 x 20" in run.error_line


@pytest.mark.parametrize("spelling", ["equirectangular", "equirectangular:0", "equirectangular:63", "sphere:64", "x"])
def test_a_misspelt_projection_is_a_usage_error(room_set: Set, fullsphere: Run, tmp_path: Path, spelling: str) -> None:
    run = fullsphere(
        "remap", room_set.frames[0], "--from", room_set.camera_file, "--to", spelling, "-o", tmp_path / "p.png"
    )
    assert run.code == 2


@pytest.mark.parametrize(("kind", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_leaves_nothing(room_set: Set, tmp_path: Path, kind: signal.Signals, code: int) -> None:
    # Ctrl-C is switched back on: a runner in the background may have left it ignored.
    program = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        "from fullsphere.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    given = [*room_set.frames[:3], "--camera", room_set.camera_file, "-o", tmp_path / "p.tif", "--size", "8192"]
    command = [sys.executable, "-c", program, "stitch", *map(str, given)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stderr is not None
        said = []
        for line in process.stderr:  # once it says that it composes, the output is open
            said.append(line)
            if "composing" in line:
                break
        time.sleep(0.5)
        process.send_signal(kind)
        said.append(process.stderr.read())
        assert process.wait(timeout=120) == code, said
    assert list(tmp_path.iterdir()) == []
