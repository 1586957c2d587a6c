"""How frames recorded the scene's light: exposure, white balance and the falloff of the lenses, from the overlaps.

In linear light a frame records 2^(e + t + w1 s + w2 s^2) of the scene's light, s = (theta/half_fov)^2: its exposure e,
its tint t, which green has none of, and the vignetting (w1, w2) of its camera, all in EV; less at the edge
(`edge_shade`).  In a direction that several frames see the scene drops out (`photometry_fit`).  Directions are spread
evenly over the sphere, so that every part of it counts by its solid angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import decoding_table
from fullsphere.model.icc import Profile
from fullsphere.model.lens import FloatArray
from fullsphere.model.sampling import sample
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.edge_shade import edge_shade
from fullsphere.mosaic.frame_colour import common_profile
from fullsphere.mosaic.frame_light import codes_of
from fullsphere.mosaic.photometry_fit import Photometry, fit, scene_of
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.small_light import small_light

__all__ = ["Photometry", "estimate_photometry"]

_DIRECTIONS, _VALUES = 20_000, 1_000_000  # and no more values than this, of many frames together
_SIDE_PX = 600  # brightness is compared on pictures of this size: what is left of parallax and noise averages out
_RIM = 0.95  # of s: vignetting is fitted up to there; then a lens' edge and that of the image circle darken the picture
_CLIPPED, _DARK = 0.9, 0.004  # linear light, of full scale: beyond them a pixel says nothing of the brightness
_DARK_LIGHT = 1e-3  # the same for pictures that hold light, of their mean


def estimate_photometry(
    frames: Sequence[Frame], cameras: Camera | Sequence[Camera], executor: Executor | None = None
) -> Photometry:
    """Exposure and white balance of registered frames, vignetting and edges of the cameras, in the order of `cameras`.

    Frames are opened side by side on `executor`.  One that shares no usable direction with any other has the exposure
    that the cameras noted where all frames have that (`Frame.told_ev`), else the mean.
    """
    each = (cameras,) if isinstance(cameras, Camera) else tuple(cameras)
    tables = [tabulate(camera, 1e-3) for camera in each]
    rays = _even_directions(min(_DIRECTIONS, max(_VALUES // max(len(frames), 1), 1000)))

    profile = common_profile(frames)

    def measured(frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        assert frame.camera_from_world is not None
        codes = codes_of(frame, profile)
        return _levels(codes, profile, tables[frame.camera], rays, frame.camera_from_world)

    values = list(ordered_map(executor, measured, frames, ahead=4))
    levels = np.array([level for level, _ in values]).reshape(len(values), len(rays), 3)
    s = np.array([at for _, at in values]).reshape(len(values), len(rays))
    told = [frame.told_ev for frame in frames if frame.told_ev is not None]
    noted = np.array(told) if len(told) == len(frames) else None
    camera = np.array([frame.camera for frame in frames], np.intp)
    found = fit(np.where((s < _RIM)[..., None], levels, np.float32(np.nan)), s, camera, len(each), noted)
    return found._replace(shade_ev=edge_shade(scene_of(levels, s, camera, found), s, camera, len(each)))


def _even_directions(count: int) -> FloatArray:
    """Unit rays (count, 3) spread evenly over the sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    y, phi = 1 - 2 * k / count, k * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - y**2)
    return np.stack([radius * np.cos(phi), y, radius * np.sin(phi)], -1)


def _levels(
    codes: Picture, profile: Profile, table: RayTable, rays: FloatArray, camera_from_world: FloatArray
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """log2 of a frame's light (n, 3) along each ray, NaN where it is not to be trusted, and s = (theta/half_fov)^2."""
    s = (np.arccos(np.clip(rays @ camera_from_world[2], -1, 1)) / table.camera.half_fov) ** 2
    factor = max(1, round(max(codes.shape[:2]) / _SIDE_PX))
    light, trusted = _reduced(codes, decoding_table(codes.dtype, profile), factor)
    pixels = (table.project(rays, camera_from_world, np.float32) + np.float32(0.5)) / np.float32(factor)
    pixels -= np.float32(0.5)
    height, width = trusted.shape[:2]
    u, v = pixels[:, 0], pixels[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (u > 1) & (u < width - 2) & (v > 1) & (v < height - 2) & (s < 1)
    at = np.where(inside[:, None], pixels, np.float32(np.nan))[None]
    usable = inside[:, None] & (sample(trusted, at, "linear")[0] > 0.999)
    value = np.where(usable, sample(light, at, "linear")[0], 1)
    return np.where(usable, np.log2(value), np.nan).astype(np.float32), s.astype(np.float32)


def _reduced(
    codes: Picture, table: NDArray[np.float32], factor: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A frame's light averaged over squares of pixels (h, w, 3), and 1 where all of them are to be trusted."""
    white = float(np.searchsorted(table, _CLIPPED)) if table.size else math.inf
    light, seen, clipped = small_light(codes, table, white, factor)
    whole = (seen == 1) & (clipped == 0)
    dark = _DARK if table.size else _DARK_LIGHT * float(light[whole].mean(dtype=np.float64)) if whole.any() else 0.0
    return light, (whole[..., None] & (light > dark)).astype(np.float32)
