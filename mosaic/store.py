"""mosaic.json: the solved project as a file that a person can read."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fullsphere.model.files import write_json
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import camera_to_dict
from fullsphere.mosaic.project import Frame, Link, Mosaic

FORMAT = "fullsphere-mosaic/1"


def yaw_pitch_roll_deg(camera_from_world: FloatArray) -> tuple[float, float, float]:
    """Yaw (right), pitch (up) and roll (clockwise) in degrees: world_from_camera = Ry(yaw) Rx(pitch) Rz(roll)."""
    yaw, pitch, roll = Rotation.from_matrix(camera_from_world.T).as_euler("YXZ", degrees=True)
    return float(yaw), float(pitch), float(roll)


def save_mosaic(path: Path, mosaic: Mosaic, overwrite: bool = False) -> None:
    """Write a mosaic; paths of pictures are stored relative to the file.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    write_json(path, mosaic_to_dict(mosaic, path.parent), overwrite)


def mosaic_to_dict(mosaic: Mosaic, folder: Path) -> dict[str, Any]:
    """The content of mosaic.json for a file in `folder`."""
    camera = {**camera_to_dict(mosaic.camera), "vignetting": list(mosaic.vignetting_ev)}
    return {
        "format": FORMAT,
        "cameras": [camera],
        "frames": [_frame(frame, folder) for frame in mosaic.frames],
        "links": [_link(link, mosaic.frames) for link in mosaic.links],
        "level": mosaic.level,
        "quality": dict(mosaic.quality, self_calibrated=mosaic.self_calibrated),
    }


def _frame(frame: Frame, folder: Path) -> dict[str, Any]:
    common = {
        "id": frame.id,
        "image": _relative(frame.image, folder),
        "sha256": frame.sha256,
        "shot": frame.id,
        "camera": 0,
        "exposure_ev": frame.exposure_ev,
        "white_balance": [1.0, 1.0, 1.0],
        "mask": None,
    }
    if frame.camera_from_world is None or frame.reason:
        return {**common, "status": "left-out", "reason": frame.reason}
    yaw, pitch, roll = yaw_pitch_roll_deg(frame.camera_from_world)
    return {
        **common,
        "status": "registered",
        "camera_from_world": np.asarray(frame.camera_from_world).tolist(),
        "yaw_deg": yaw,
        "pitch_deg": pitch,
        "roll_deg": roll,
        "sigma_deg": frame.sigma_deg,
    }


def _link(link: Link, frames: tuple[Frame, ...]) -> dict[str, Any]:
    return {
        "frames": [frames[link.i].id, frames[link.j].id],
        "matches": len(link.pixels_i),
        "second_from_first": np.asarray(link.j_from_i).tolist(),
    }


def _relative(image: str, folder: Path) -> str:
    """The picture's path seen from the folder, with forward slashes; as it is where there is no such path."""
    try:
        return Path(os.path.relpath(image, folder)).as_posix()
    except ValueError:  # another drive on Windows
        return Path(image).as_posix()
