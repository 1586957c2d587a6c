"""`fullsphere register`: frames in, orientations out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

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
