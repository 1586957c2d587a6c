"""Calibrations of the full size, used for resized frames."""

from pathlib import Path

import numpy as np
from picture_files import picture_file, scene

from fullsphere.mosaic.frame_camera import frame_camera
from laws import fisheye

CAMERA = fisheye(96)


def pictures(folder: Path, *sizes: tuple[int, int]) -> list[Path]:
    return [picture_file(folder / f"f{k}.png", scene(k, size)) for k, size in enumerate(sizes)]


def test_a_camera_is_scaled_to_frames_that_were_all_resized(tmp_path: Path) -> None:
    width, height = CAMERA.size
    half = (width // 2, height // 2)
    scaled = frame_camera(CAMERA, pictures(tmp_path, half, half, (5, 7)))
    assert scaled.size == half
    rays = CAMERA.unproject(np.array([[20.5, 40.5], [60.5, 30.5]]))
    assert np.allclose(scaled.project(rays), [[10.0, 20.0], [30.0, 15.0]])


def test_one_frame_of_the_cameras_own_size_keeps_the_camera(tmp_path: Path) -> None:
    width, height = CAMERA.size
    half = (width // 2, height // 2)
    assert frame_camera(CAMERA, pictures(tmp_path, half, half, CAMERA.size)) is CAMERA


def test_frames_of_other_proportions_keep_the_camera(tmp_path: Path) -> None:
    assert frame_camera(CAMERA, pictures(tmp_path, (90, 60), (90, 60))) is CAMERA


def test_files_that_cannot_be_read_say_nothing(tmp_path: Path) -> None:
    (tmp_path / "empty.png").write_bytes(b"")
    assert frame_camera(CAMERA, [tmp_path / "empty.png", tmp_path / "missing.png"]) is CAMERA
