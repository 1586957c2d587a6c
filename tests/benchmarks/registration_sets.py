"""What the benchmarks register: folders of frames with a truth.json beside them, and folders of photographs."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import load_camera

PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr")


class Truth(NamedTuple):
    """What is known of rendered frames: rotations (n, 3, 3) by file name, and the lens as a curve.

    `theta` (m,) in radians from 0 to the rim, `radius_px` (m,) there; `camera` is the lens as a camera, None if no
    camera.json lies beside the truth.json.
    """

    rotations: dict[str, FloatArray]
    theta: FloatArray
    radius_px: FloatArray
    camera: Camera | None

    @property
    def half_fov_deg(self) -> float:
        """From the axis to the rim."""
        return float(np.rad2deg(self.theta[-1]))


class FrameSet(NamedTuple):
    """Files that are registered together.

    `truth` is None for photographs; `limit_px` is what the median residual of their matches may be, `places` how many
    were taken from each place, most first, where there are several.
    """

    name: str
    scene: str
    files: tuple[Path, ...]
    truth: Truth | None = None
    limit_px: float | None = None
    places: tuple[int, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Self:
        """FOLDER, FOLDER[FIRST:LAST] for some of its files (a slice, by name), either with =LIMIT_PX or =4+4 behind."""
        parts = re.fullmatch(r"(.+?)(?:\[(\d+):(\d+)\])?(?:=(?:(\d+(?:\+\d+)+)|([\d.]+)))?", text)
        assert parts is not None
        folder, first, last, places, limit = parts.groups()
        files = pictures_of(Path(folder))
        if first is not None:
            files = files[int(first) : int(last)]
        if len(files) < 2:
            raise SystemExit(f"{text}: fewer than two pictures in that folder")
        name = Path(folder).name + (f" {int(first) + 1} to {last}" if first is not None else "")
        found = Path(folder) / "truth.json"
        if found.exists():
            truth, scene = read_truth(found)
            return cls(name, scene, files, truth)
        from_places = tuple(map(int, places.split("+"))) if places else ()
        return cls(name, "photographs", files, None, float(limit) if limit else None, from_places)


def pictures_of(folder: Path) -> tuple[Path, ...]:
    """The pictures in a folder, by name."""
    return tuple(sorted(p for p in folder.glob("*") if p.suffix.lower() in PICTURES and not p.stem.startswith("pano")))


def read_truth(path: Path) -> tuple[Truth, str]:
    """The truth, and the name of the scene.

    The file holds `frames` [{`file`, `R`: camera_from_world}], `theta` and `r` (radians, pixels), and `pano` and `seed`
    for the name.
    """
    held = json.loads(path.read_text())
    camera = path.with_name("camera.json")
    truth = Truth(
        {frame["file"]: np.array(frame["R"], float) for frame in held["frames"]},
        np.array(held["theta"], float),
        np.array(held["r"], float),
        load_camera(camera) if camera.exists() else None,
    )
    return truth, f"{Path(held.get('pano', path.parent.parent.name)).stem[:12]} {held.get('seed', '')}".strip()


def write_truth(
    folder: Path, files: Sequence[str], rotations: Sequence[FloatArray], camera: Camera, scene: str, seed: int
) -> None:
    """The truth.json of frames that were rendered through a camera."""
    theta = np.linspace(0, camera.half_fov, 181)
    held = {
        "frames": [{"file": f, "R": r.tolist()} for f, r in zip(files, rotations, strict=True)],
        "theta": theta.tolist(),
        "r": camera.lens.radius(theta).tolist(),
        "pano": scene,
        "seed": seed,
    }
    (folder / "truth.json").write_text(json.dumps(held, indent=1) + "\n")
