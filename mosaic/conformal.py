"""A wide picture seen stereographically: without distorting angles anywhere, so that what is turned stays alike.

An equidistant fisheye draws things at 90 degrees from its axis 1.6 times wider than deep, an equisolid one twice.  What
comes from the rim of one frame into the middle of another changes its shape then, and keypoints lie elsewhere in it.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, Stereographic
from fullsphere.model.remap import remap
from fullsphere.model.table import RayTable, tabulate

_NARROWEST, _WIDEST = math.radians(40), math.radians(110)  # of half the field: nothing gained below, too much above
_GRID = 48  # cells of a coarse grid on which the view is laid out
_FULL = 0.999  # weight of a pixel that the frame covers wholly


@dataclasses.dataclass(frozen=True)
class View:
    """A frame as a stereographic camera with the same axes would have taken it.

    Attributes
    ----------
    light
        Its values (H, W).
    inside
        Where it shows what is allowed (H, W), 255 or 0.
    camera, frame_camera
        The stereographic camera, and that of the frame.
    """

    light: NDArray[np.float32]
    inside: NDArray[np.uint8]
    camera: Camera
    frame_camera: Camera

    def in_frame(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels (n, 2) of the frame, NaN where it has none, and how many of its pixels one of the view spans (n,)."""
        rays = self.camera.unproject(pixels)
        scale = self.frame_camera.pixels_per_radian(rays) / self.camera.pixels_per_radian(rays)
        return self.frame_camera.project(rays), scale


def is_wide(camera: Camera) -> bool:
    """Whether the camera's pictures gain by a conformal view."""
    return _NARROWEST < camera.half_fov <= _WIDEST


def conformal_view(
    light: NDArray[np.float32], allowed: NDArray[np.uint8] | None, camera: Camera, most_px: float
) -> View | None:
    """The frame's light (h, w) seen stereographically, what is allowed of it in about as many pixels but `most_px`
    at most; None if nothing is.
    """
    view = _view_of(camera, allowed, most_px)
    if view is None:
        return None
    shown, weight = remap(light[..., None], _table(camera), view)
    inside = weight > _FULL
    if allowed is not None:
        kept, _ = remap(allowed[..., None], _table(camera), view, interpolation="nearest")
        inside &= kept[..., 0] > 0
    return View(shown[..., 0], np.where(inside, np.uint8(255), np.uint8(0)), view, camera)


@functools.lru_cache(maxsize=8)
def _table(camera: Camera) -> RayTable:
    return tabulate(camera)


def _view_of(camera: Camera, allowed: NDArray[np.uint8] | None, most_px: float) -> Camera | None:
    """A stereographic camera of the same axes whose picture just holds what is allowed."""
    width, height = camera.size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, _GRID + 1), np.linspace(-0.5, height - 0.5, _GRID + 1))
    rays = camera.unproject(np.stack([u, v], -1))
    if allowed is not None:
        row, column = np.clip(np.round(v), 0, height - 1).astype(int), np.clip(np.round(u), 0, width - 1).astype(int)
        rays[allowed[row, column] == 0] = np.nan
    flat = 2 * rays[..., :2] / (1 + rays[..., 2:])  # stereographic, of focal length 1
    seen = np.isfinite(flat[..., 0])
    if seen.sum() < 4:
        return None
    across, down = np.diff(flat, axis=1)[:-1], np.diff(flat, axis=0)[:, :-1]
    area = float(np.nansum(np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])))
    cell = (width / _GRID) * (height / _GRID)
    if area <= 0:
        return None
    f = math.sqrt(min(seen.sum() * cell, most_px) / area)
    edge = 2 * f * max(np.ptp(flat[seen], axis=0)) / _GRID  # the grid's points may lie a cell inside
    low, high = f * flat[seen].min(0) - edge, f * flat[seen].max(0) + edge
    size = (math.ceil(high[0] - low[0]), math.ceil(high[1] - low[1]))
    return Camera(Stereographic(f), size, (-float(low[0]), -float(low[1])), half_fov=camera.half_fov)
