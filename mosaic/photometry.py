"""How much brighter each frame recorded the scene, and how the lens darkens towards its rim, from the overlaps.

In linear light a frame records 2^(e + w1 s + w2 s^2) of the scene's brightness, s = (theta/half_fov)^2: its exposure e
and the vignetting (w1, w2) all frames share, both in EV.  Seen in the same direction by two frames the scene drops out:
one robust linear least-squares problem (after Brown & Lowe, IJCV 2007, section 6; d'Angelo, ICVS 2007).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.colour import linear_from_encoded
from fullsphere.model.lens import FloatArray
from fullsphere.model.sampling import sample
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.masks import used
from fullsphere.mosaic.project import Frame, Picture

_DIRECTIONS = 20_000
_SIDE_PX = 600  # brightness is compared on pictures of this size: what is left of parallax and noise averages out
_CLIPPED, _DARK = 0.9, 0.004  # linear light, of full scale: beyond them a pixel says nothing of the brightness
_HUBER_EV = 0.15


class Photometry(NamedTuple):
    """Exposures (n,) in EV, their mean zero, and the vignetting (w1, w2) in EV."""

    exposure_ev: FloatArray
    vignetting_ev: tuple[float, float]


def estimate_photometry(
    frames: Sequence[Frame], cameras: Camera | Sequence[Camera], executor: Executor | None = None
) -> Photometry:
    """Exposures of registered frames and the vignetting they share; frames are opened side by side on `executor`.

    Frames that share no usable direction with any other keep the mean exposure.  `cameras` are in the order of
    `Frame.camera`.
    """
    each = (cameras,) if isinstance(cameras, Camera) else cameras
    tables, rays = [tabulate(camera, 1e-3) for camera in each], _even_directions(_DIRECTIONS)

    def levels(frame: Frame) -> tuple[FloatArray, FloatArray]:
        assert frame.camera_from_world is not None
        return _levels(used(frame), tables[frame.camera], rays, frame.camera_from_world)

    level, s = zip(*ordered_map(executor, levels, frames, ahead=4), strict=True)
    return _solve(np.array(level), np.array(s))


def _even_directions(count: int) -> FloatArray:
    """Unit rays (count, 3) spread evenly over the sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    y, phi = 1 - 2 * k / count, k * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - y**2)
    return np.stack([radius * np.cos(phi), y, radius * np.sin(phi)], -1)


def _levels(
    picture: Picture, table: RayTable, rays: FloatArray, camera_from_world: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """log2 of a frame's brightness along each ray, NaN where it is not to be trusted, and s = (theta/half_fov)^2."""
    pixels = table.project(rays, camera_from_world, np.float32)
    s = (np.arccos(np.clip(rays @ camera_from_world[2], -1, 1)) / table.camera.half_fov) ** 2
    colour = linear_from_encoded(picture[..., :3])
    limit = 1.0 if picture.dtype != np.float32 else math.inf
    channels = np.moveaxis(colour, -1, 0)
    grey, brightest = sum(channels) / np.float32(len(channels)), functools.reduce(np.maximum, channels)
    usable = ((brightest < _CLIPPED * limit) & (grey > _DARK)).astype(np.float32)
    if picture.shape[2] == 4:
        usable *= picture[..., 3] > 0
    factor = min(1.0, _SIDE_PX / max(picture.shape[:2]))
    grey = cv2.blur(grey, (round(1 / factor),) * 2)
    usable = cv2.blur(usable, (round(1 / factor),) * 2)
    height, width = picture.shape[:2]
    with np.errstate(invalid="ignore"):
        u, v = pixels[:, 0], pixels[:, 1]
        inside = (u > 1 / factor) & (u < width - 1 / factor) & (v > 1 / factor) & (v < height - 1 / factor) & (s < 0.95)
    at = np.where(inside[:, None], pixels, np.float32(np.nan))[None]
    trusted = inside & (sample(usable, at, "linear")[0] > 0.999)
    value = np.where(trusted, sample(grey, at, "linear")[0], 1.0)
    return np.where(trusted, np.log2(value), np.nan), s


def _solve(level: FloatArray, s: FloatArray) -> Photometry:
    """Least squares with Huber weights; the scene's own brightness in each direction is eliminated by its mean."""
    count = len(level)
    seen = np.isfinite(level)
    several = seen.sum(0) >= 2
    frame, direction = np.nonzero(seen & several)
    exposure, vignetting = np.zeros(count), np.zeros(2)
    if direction.size == 0:
        return Photometry(exposure, (0.0, 0.0))
    y, sv = level[frame, direction], s[frame, direction]
    design = np.column_stack([(frame[:, None] == np.arange(count)).astype(float), sv, sv**2])
    # Weak priors: exposures near their mean, no vignetting where the overlaps say nothing of it.
    prior = np.diag([*[1e-2] * count, 0.3, 0.3])
    weight = np.ones(len(y))
    for _ in range(15):
        total = np.maximum(np.bincount(direction, weight, several.size), 1e-12)
        centre = [np.bincount(direction, weight * column, several.size) / total for column in (*design.T, y)]
        a = design - np.stack(centre[:-1], -1)[direction]
        b = y - centre[-1][direction]
        root = np.sqrt(weight)
        x, *_ = np.linalg.lstsq(
            np.vstack([a * root[:, None], prior]), np.concatenate([b * root, np.zeros(count + 2)]), rcond=None
        )
        residual = np.abs(b - a @ x)
        weight = 1 / np.maximum(residual / _HUBER_EV, 1.0)
    exposure, vignetting = x[:count] - x[:count].mean(), x[count:]
    return Photometry(exposure, (float(vignetting[0]), float(vignetting[1])))
