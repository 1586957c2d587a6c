"""Frames in, panorama out: with and without a camera, and calibrated on the way."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rooms import Outcome, Set

from fullsphere.model.images import encoded_from_linear
from fullsphere.mosaic.truth import Turned, psnr_db, rotation_errors_deg
from fullsphere.mosaic.worlds import environment, furnished_room, panorama

Run = Callable[..., Outcome]


def rotations_of(mosaic: Path) -> list[np.ndarray]:
    frames: list[dict[str, Any]] = json.loads(mosaic.read_text())["frames"]
    assert [frame["status"] for frame in frames] == ["registered"] * len(frames)
    return [np.array(frame["camera_from_world"]) for frame in frames]


def test_a_calibrated_set_becomes_the_room_it_was_taken_in(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere(
        "stitch",
        *room_set.frames,
        *("-o", tmp_path / "p.tif", "--mosaic", tmp_path / "m.json"),
        *("--camera", room_set.camera_file, "--size", "1024"),
    )
    assert run.code == 0, run.err
    angles, true_from_found = rotation_errors_deg(
        rotations_of(tmp_path / "m.json"), [shot.camera_from_world for shot in room_set.shots]
    )
    assert np.median(angles) < 0.01
    assert angles.max() < 0.03
    found = cv2.imread(str(tmp_path / "p.tif"), cv2.IMREAD_UNCHANGED)
    room = Turned(environment(furnished_room(1, texel_mm=7.0), face_px=512), true_from_found)
    truth = encoded_from_linear(panorama(room, 1024), np.uint8)
    seen = (found[..., 3] == 255).astype(np.float32)
    assert seen.mean() > 0.999
    assert psnr_db(found[..., 2::-1], truth, seen) > 30


def test_an_uncalibrated_set_finds_its_own_lens(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere(
        "stitch", *room_set.frames, "-o", tmp_path / "p.png", "--mosaic", tmp_path / "m.json", "--size", 512
    )
    assert run.code == 0, run.err
    angles, _ = rotation_errors_deg(
        rotations_of(tmp_path / "m.json"), [shot.camera_from_world for shot in room_set.shots]
    )
    assert np.median(angles) < 0.1
    curve = json.loads((tmp_path / "m.json").read_text())["cameras"][0]["curve"]
    theta = np.radians(np.array(curve["theta_deg"]))
    gap = np.array(curve["r_px"]) - room_set.camera.lens.radius(theta)
    assert np.abs(gap[theta < np.radians(88)]).max() < 0.5


def test_calibration_can_be_the_first_stage(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    write_points(points, room_set)
    run = fullsphere(
        *("stitch", *room_set.frames, "-o", tmp_path / "p.jpg", "--calibrate", points, "--size", 512, "--json"),
    )
    assert run.code == 0, run.err
    summary = json.loads(run.out)
    assert summary["registered"] == 5
    assert not summary["self_calibrated"]
    assert summary["residual_median_px"] < 0.5


def write_points(path: Path, room_set: Set) -> None:
    """Points of a box round the camera, in millimetres, where the true camera images them."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-500, 500, (400, 3))
    points[np.arange(400), rng.integers(0, 3, 400)] = rng.choice([-500.0, 500.0], 400)
    pixels = room_set.camera.project(points + np.array([20, -30, 10])) + rng.normal(0, 0.1, (400, 2))
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["image", "x_mm", "y_mm", "z_mm", "u_px", "v_px"])
        rows.writerows(["a.jpg", *p, *q] for p, q in zip(points, pixels, strict=True) if np.isfinite(q).all())


def test_the_panorama_does_not_depend_on_the_number_of_threads(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    for threads in (1, 3):
        run = fullsphere(
            *(
                "stitch",
                *room_set.frames[:3],
                "-o",
                tmp_path / f"p{threads}.tif",
                "--mosaic",
                tmp_path / f"m{threads}.json",
            ),
            *("--camera", room_set.camera_file, "--size", 1024, "--threads", threads),
        )
        assert run.code == 0, run.err
    assert (tmp_path / "p1.tif").read_bytes() == (tmp_path / "p3.tif").read_bytes()
    assert (tmp_path / "m1.json").read_bytes() == (tmp_path / "m3.json").read_bytes()


def test_a_frame_remapped_and_remapped_back_is_itself(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    frame = room_set.frames[0]
    forth = fullsphere(
        "remap", frame, "--from", room_set.camera_file, "--to", "equirectangular:2048", "-o", tmp_path / "e.png"
    )
    assert forth.code == 0, forth.err
    sphere = cv2.imread(str(tmp_path / "e.png"), cv2.IMREAD_UNCHANGED)
    covered = np.average(
        (sphere[..., 3] > 0).mean(1), weights=np.cos((np.arange(1024) + 0.5) / 1024 * np.pi - np.pi / 2)
    )
    assert covered == pytest.approx((1 - np.cos(np.radians(91.5))) / 2, abs=0.002)
    cv2.imwrite(str(tmp_path / "opaque.png"), sphere[..., :3])
    back = fullsphere(
        *("remap", tmp_path / "opaque.png", "--from", "equirectangular:2048", "--to", room_set.camera_file),
        *("-o", tmp_path / "b.png"),
    )
    assert back.code == 0, back.err
    again, original = cv2.imread(str(tmp_path / "b.png")), cv2.imread(str(frame))
    v, u = np.mgrid[:640, :640]
    inner = np.hypot(u - room_set.camera.centre[0], v - room_set.camera.centre[1]) < 280
    assert np.abs(again[inner].astype(int) - original[inner]).mean() < 4


def test_calibrate_writes_a_camera_that_stitch_can_use(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    write_points(tmp_path / "points.csv", room_set)
    run = fullsphere(
        *("calibrate", "--points", tmp_path / "points.csv", "--image-size", "640x640", "-o", tmp_path / "camera.json")
    )
    assert run.code == 0, run.err
    assert "rms 0.1" in run.out
    stitched = fullsphere(
        *("stitch", *room_set.frames[:3], "--camera", tmp_path / "camera.json", "-o", tmp_path / "p.png", "--size", 256)
    )
    assert stitched.code == 0, stitched.err
