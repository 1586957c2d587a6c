"""A small solved project as files: frames of a smooth scene from one place, and the mosaic.json that says how."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from turning import frames_of, ring

from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.files import sha256_of
from fullsphere.model.images import open_panorama
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.store import save_mosaic
from laws import fisheye, smooth_light

CAMERA = fisheye(160)
NOTED = {"Make": "Acme", "Model": "Eye", "Exif:LensModel": "Sphere 8", "Exif:DateTimeOriginal": "2026:11:23 09:00:00"}


def coloured(rays: FloatArray) -> FloatArray:
    """Light (n, 3) of the scene, 0 to 0.5."""
    light: FloatArray = 0.5 * smooth_light(rays) * np.array([1.0, 0.8, 0.6])
    return light


def project_in(
    folder: Path,
    count: int = 4,
    ending: str = "tif",
    dtype: type = np.uint8,
    scene: Callable[[FloatArray], FloatArray] = coloured,
    exposures_ev: tuple[float, ...] = (),
) -> Path:
    """Write frame_0, frame_1 ... and the mosaic.json of them; answer its place."""
    folder.mkdir(exist_ok=True)
    exposures = exposures_ev or (0.0,) * count
    gain = functools.partial(_recorded, exposures=exposures, dtype=dtype)
    frames = frames_of(scene, CAMERA, ring(count), gain)
    kept = [
        _saved(dataclasses.replace(frame, exposure_ev=exposures[k]), folder / f"frame_{k}.{ending}")
        for k, frame in enumerate(frames)
    ]
    save_mosaic(folder / "mosaic.json", Mosaic((CAMERA,), tuple(kept), ()), overwrite=True)
    return folder / "mosaic.json"


def frame_files(folder: Path, ending: str = "tif") -> list[Path]:
    return sorted(folder.glob(f"frame_*.{ending}"))


def _recorded(k: int, light: FloatArray, exposures: tuple[float, ...], dtype: type) -> NDArray[Any]:
    return encoded_from_linear((light * 2.0 ** exposures[k]).astype(np.float32), dtype)


def _saved(frame: Frame, path: Path) -> Frame:
    pixels = frame.load()
    with open_panorama(path, frame.size, 3, pixels.dtype, NOTED, overwrite=True) as writer:
        writer.write_rows(0, pixels)
    return dataclasses.replace(frame, id=path.name, image=str(path), sha256=sha256_of(path))
