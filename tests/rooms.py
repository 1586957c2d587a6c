"""What the end-to-end tests share: a set of frames with known truth, and what a run of the command answered."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import cv2

from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla
from fullsphere.mosaic.worlds import PanelScene, Shot, photograph

SIDE = 640


@dataclasses.dataclass(frozen=True)
class Set:
    """Frames taken of one room by one camera, all with known truth."""

    frames: tuple[Path, ...]
    shots: tuple[Shot, ...]
    camera: Camera
    camera_file: Path
    other_room: Path


def true_camera() -> Camera:
    half_fov = math.radians(91.5)
    shape = BaksteinPajdla(1.35, 2.11, 0.42, 1.13)
    lens = shape.scaled(0.96 * SIDE / 2 / float(shape.radius(half_fov)))
    return Camera(lens, (SIDE, SIDE), (SIDE / 2 + 1.7, SIDE / 2 - 3.2), half_fov=half_fov)


def take(room: PanelScene, camera: Camera, shot: Shot, path: Path) -> Path:
    photo = photograph(room, camera, shot.camera_from_world, exposure_ev=shot.exposure_ev, noise=0.004, seed=shot.seed)
    cv2.imwrite(str(path), photo[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
    return path


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a run of the command answered."""

    code: int
    out: str
    err: str

    @property
    def error_line(self) -> str:
        """The one line that says what went wrong."""
        lines = [line for line in self.err.splitlines() if line.startswith("fullsphere: error:")]
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.err
        return lines[0]

    @property
    def warnings(self) -> list[str]:
        return [line for line in self.err.splitlines() if line.startswith("fullsphere: warning:")]
