"""A scene of more light than one exposure holds, and brackets of it as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.images import open_panorama
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.worlds import photograph

LAMP, SHADE = 3.0, 0.004
STEPS_EV = (-2.0, 0.0, 2.0)


class Lamps:
    """Light over ten stops: tiles everywhere, dark below and bright above, lamps all round, and a ball at times."""

    def __init__(self, ball: FloatArray | None = None) -> None:
        self._ball = ball

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        """Light (..., 3) along rays."""
        ray = np.asarray(rays, float)
        ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        x, y, z = np.moveaxis(ray, -1, 0)
        cell = np.floor(7 * np.nan_to_num(ray)).astype(int) + 8
        tone = np.random.default_rng(0).uniform(-1.5, 1.5, (16, 16, 16))[tuple(np.moveaxis(cell, -1, 0))]
        light = (0.04 * 2.0 ** (-2.5 * y + tone + 0.3 * np.sin(17 * z)))[..., None] * np.array([1.0, 0.85, 0.7])
        for azimuth in np.arange(5) * 2 * np.pi / 5 + 0.3:
            lamp = np.array([np.sin(azimuth), -0.4, np.cos(azimuth)])
            light[ray @ lamp > np.cos(0.13) * np.linalg.norm(lamp)] = LAMP
        if self._ball is not None:
            light[ray @ self._ball > np.cos(0.16)] = 0.5
        light[~np.isfinite(x)] = 0
        return np.asarray(light, np.float32)


def bracket(
    camera: Camera, turn: FloatArray, ev: float, seed: int, scene: Lamps | None = None, noise: float = 0.004
) -> NDArray[np.uint8]:
    """One picture (h, w, 3)."""
    return photograph(scene or Lamps(), camera, turn, exposure_ev=ev, noise=noise, seed=seed)


def brackets_in(
    folder: Path,
    camera: Camera,
    turns: FloatArray,
    steps_ev: Sequence[float] = STEPS_EV,
    noted: bool = True,
) -> list[Path]:
    """Write the brackets of each position, A_0 A_1 A_2 B_0 ..., with or without the camera's notes; answer them."""
    folder.mkdir(exist_ok=True)
    paths = []
    for k, turn in enumerate(turns):
        for n, ev in enumerate(steps_ev):
            path = folder / f"{'ABCDEFGH'[k]}_{n}.png"
            paths.append(written(path, bracket(camera, turn, ev, 100 * k + n), ev if noted else None))
    return paths


def written(path: Path, pixels: NDArray[Any], ev: float | None = None) -> Path:
    """Write a picture, with the notes of a camera that took it at `ev` if that is given."""
    height, width, channels = pixels.shape
    notes = {} if ev is None else {"ExposureTime": 2.0**ev / 60, "FNumber": 8.0, "Exif:PhotographicSensitivity": 200.0}
    with open_panorama(path, (width, height), channels, pixels.dtype, notes, overwrite=True) as writer:
        writer.write_rows(0, pixels)
    return path
