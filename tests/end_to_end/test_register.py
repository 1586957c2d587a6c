"""`fullsphere register`: frames in, orientations out, and what it says of frames that do not belong."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from rooms import Outcome, Set

from fullsphere.mosaic import load_mosaic
from fullsphere.mosaic.truth import rotation_errors_deg

Run = Callable[..., Outcome]


def test_orientations_are_written_and_read(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("register", *room_set.frames, "-o", tmp_path / "m.json", "--camera", room_set.camera_file)
    assert run.code == 0, run.err
    assert "matches that no fit saw" in run.out
    mosaic = load_mosaic(tmp_path / "m.json")
    found = [frame.camera_from_world for frame in mosaic.registered if frame.camera_from_world is not None]
    angles, _ = rotation_errors_deg(found, [shot.camera_from_world for shot in room_set.shots])
    assert len(found) == len(room_set.frames)
    assert angles.max() < 0.03
    assert mosaic.quality["held_out_matches"] > 100
    assert mosaic.quality["held_out_median_px"] < 1


def test_frames_that_do_not_belong_are_named(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    height, width = cv2.imread(str(room_set.frames[0])).shape[:2]
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3)).astype(np.uint8)
    odd = {
        "blank.png": np.full_like(noise, 90),
        "white.png": np.full_like(noise, 255),
        "noise.png": noise,
        "mirrored.png": cv2.imread(str(room_set.frames[2]))[:, ::-1],
        "half.png": cv2.resize(noise, (width // 2, height // 2)),
    }
    for name, picture in odd.items():
        cv2.imwrite(str(tmp_path / name), picture)
    names = [tmp_path / name for name in odd]
    common = ("--camera", room_set.camera_file, "--json", "--strict")
    run = fullsphere("register", *room_set.frames, *names, "-o", tmp_path / "m.json", *common)
    assert run.code == 3  # --strict: frames were left out
    summary = json.loads(run.out)
    assert summary["registered"] == len(room_set.frames)
    assert set(summary["left_out"]) == set(odd)
    assert "blank" in summary["left_out"]["blank.png"]
    assert "mirrored" in summary["left_out"]["mirrored.png"]
    assert "pixels" in summary["left_out"]["half.png"]


def test_what_cannot_be_done_is_refused(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    frames, out = room_set.frames, tmp_path / "m.json"
    assert fullsphere("register", frames[0], "-o", out).code == 3
    assert fullsphere("register", *frames, tmp_path / "no.jpg", "-o", out).code == 3
    assert fullsphere("register", *frames, "-o", out, "--refine").code == 2
    assert fullsphere("register", *frames, "-o", out, "--level", "sideways").code == 2
    small = tmp_path / "mask.png"
    cv2.imwrite(str(small), np.full((10, 20), 255, np.uint8))
    wrong = fullsphere("register", *frames, "-o", out, "--mask", small)
    assert wrong.code == 3
    assert "20 x 10" in wrong.error_line
    assert not out.exists()
    out.write_text("mine")
    assert fullsphere("register", *frames, "-o", out).code == 5
    assert out.read_text() == "mine"
