"""Real frames, and frames rendered by an independent program, where a folder with them stands beside the project."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rooms import Outcome

Run = Callable[..., Outcome]

SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[2].parent / "shared"))
BENCH = SHARED / "bench"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not SHARED.is_dir(), reason=f"the folder with real frames, {SHARED}, is not there"),
]


@pytest.mark.parametrize("name", ["canon815-set1", "canon815-set2"])
def test_real_fisheye_frames_close_the_sphere_without_a_calibration(name: str, fullsphere: Run, tmp_path: Path) -> None:
    frames = sorted((SHARED / "data" / "frames" / name).glob("*.jpg"))
    run = fullsphere("stitch", *frames, "-o", tmp_path / "p.tif", "--json")
    assert run.code == 0, run.err
    summary = json.loads(run.out)
    assert summary["registered"] == 4
    assert summary["residual_median_px"] < 1.0
    alpha = cv2.imread(str(tmp_path / "p.tif"), cv2.IMREAD_UNCHANGED)[..., 3]
    latitude = (np.arange(2048) + 0.5) / 2048 * np.pi - np.pi / 2
    assert np.average((alpha == 255).mean(1), weights=np.cos(latitude)) >= 0.999


def score(folder: Path) -> dict[str, Any]:
    """What the independent scorer says of a mosaic."""
    program = (
        "import json, sys; from score import score;"
        f"print(json.dumps(score({str(folder / 'mosaic.json')!r}, {str(folder / 'truth.json')!r})))"
    )
    run = subprocess.run([sys.executable, "-c", program], cwd=BENCH, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(run.stdout)
    return found


@pytest.mark.parametrize(("calibrated", "median_deg"), [(True, 0.003), (False, 0.1)])
def test_hand_held_frames_find_their_rotations(
    calibrated: bool, median_deg: float, fullsphere: Run, tmp_path: Path
) -> None:
    scene = SHARED / "data" / "scenes" / "view-from-the-deck-6144x3072.jpg"
    subprocess.run([sys.executable, "scene.py", "hand8", str(scene), str(tmp_path)], cwd=BENCH, check=True)
    subprocess.run(
        [sys.executable, "camera.py", str(tmp_path / "truth.json"), str(tmp_path / "camera.json")],
        cwd=BENCH,
        check=True,
    )
    options = ["--camera", tmp_path / "camera.json"] if calibrated else []
    frames = sorted(tmp_path.glob("frame_*.jpg"))
    run = fullsphere(
        *("stitch", *frames, "-o", tmp_path / "p.tif", "--mosaic", tmp_path / "mosaic.json", "--size", 1024, *options)
    )
    assert run.code == 0, run.err
    found = score(tmp_path)
    assert found["registered"] == found["of"] == 8
    assert found["rotation_deg_median"] <= median_deg
