"""Sets for the benchmarks that are given none: frames of a built-in room, with their truth and their camera."""

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

import cv2
import numpy as np
from registration_sets import FrameSet, write_truth
from remap_table import note
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, Equisolid, FloatArray
from fullsphere.model.store import save_camera
from fullsphere.mosaic.photographer import Scene, photograph
from fullsphere.mosaic.worlds import environment, furnished_room

_SIDE_PX = 1400
_SEED = 7


def room(executor: Executor) -> Scene:
    """A room as a camera that only turns sees it."""
    return environment(furnished_room(texel_mm=2.0), 1600, executor)


def circular(side: int, half_fov_deg: float = 91.5) -> Camera:
    """A circular fisheye like the paper's, its centre off the middle."""
    half = math.radians(half_fov_deg)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    scaled = lens.scaled(0.485 * side / float(lens.radius(half)))
    return Camera(scaled, (side, side), (side / 2 + 2.3, side / 2 - 3.1), half_fov=half)


def diagonal(width: int, height: int, half_fov_deg: float = 92.0) -> Camera:
    """A fisheye that fills the frame to its corners."""
    half = math.radians(half_fov_deg)
    lens = Equisolid(math.hypot(width, height) / 2 / (2 * math.sin(half / 2)))
    return Camera(lens, (width, height), ((width - 1) / 2 + 3, (height - 1) / 2 - 2), half_fov=half)


def rendered_sets(folder: Path, executor: Executor) -> list[FrameSet]:
    """A turn on a tripod, one by hand, and one of a diagonal fisheye with zenith and nadir."""
    random = np.random.default_rng(_SEED)
    tripod = [(y, 0, 0) for y in (0, 90, 180, 270)]
    hand = [(45 * i, 25 * (-1) ** i, 10 * (i % 3 - 1)) for i in range(8)]
    around = [*((60 * i, 0, 90) for i in range(6)), (0, 88, 0), (40, -88, 0)]
    scene = room(executor)
    sets = []
    for name, angles, jitter, camera in (
        ("tripod", tripod, 1.5, circular(_SIDE_PX)),
        ("hand", hand, 8.0, circular(_SIDE_PX)),
        ("diagonal", around, 2.0, diagonal(3 * _SIDE_PX // 2, _SIDE_PX)),
    ):
        note(f"rendering {name}")
        jittered = np.array(angles, float) + random.normal(0, jitter, (len(angles), 3))
        render(folder / name, scene, jittered, camera, executor)
        sets.append(FrameSet.parse(str(folder / name)))
    return sets


def render(
    folder: Path, scene: Scene, angles_deg: FloatArray | Sequence[FloatArray], camera: Camera, executor: Executor
) -> list[Path]:
    """Frames at yaw, pitch and roll (n, 3), with truth.json and camera.json beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    rotations = Rotation.from_euler("YXZ", angles_deg, degrees=True).inv().as_matrix()
    exposures = np.random.default_rng(_SEED).uniform(-0.4, 0.4, len(rotations))
    files = [folder / f"frame_{k:03d}.jpg" for k in range(len(rotations))]
    for k, (file, rotation) in enumerate(zip(files, rotations, strict=True)):
        shown = photograph(
            scene, camera, rotation, exposure_ev=float(exposures[k]), noise=0.006, seed=k, executor=executor
        )
        cv2.imwrite(str(file), shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
    write_truth(folder, [f.name for f in files], list(rotations), camera, "room", _SEED)
    save_camera(folder / "camera.json", camera, overwrite=True)
    return files
