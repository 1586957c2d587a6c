"""A small set of frames of a rendered room, and the camera that took them, as files; and the command."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rooms import Outcome, Set, take, true_camera

from fullsphere.cli.main import main
from fullsphere.model.store import save_camera
from fullsphere.mosaic.worlds import Shot, environment, furnished_room, turn


@pytest.fixture(scope="session")
def room_set(tmp_path_factory: pytest.TempPathFactory) -> Set:
    folder = tmp_path_factory.mktemp("room")
    camera, shots = true_camera(), turn(5, pitch_deg=12, jitter_deg=3, exposure_ev=0.3, seed=3)
    room = environment(furnished_room(1, texel_mm=7.0), face_px=512)
    frames = tuple(take(room, camera, shot, folder / f"frame_{k}.jpg") for k, shot in enumerate(shots))
    elsewhere = environment(furnished_room(9, texel_mm=9.0).seen_from((0.9, 0.1, -0.6)), face_px=384)
    other = take(elsewhere, camera, Shot(np.eye(3), 0.0, 5), folder / "other_room.jpg")
    save_camera(folder / "camera.json", camera)
    return Set(frames, shots, camera, folder / "camera.json", other)


@pytest.fixture
def fullsphere(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    def run(*arguments: str | Path) -> Outcome:
        code = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run
