"""What a frame of a turning arm shows along the rays of the mosaic.

The ray of a pixel leaves the circle at the point of its column, where no camera stood: a frame that stood beside it
sees what the ray meets in a slightly other direction, by how near it is.  With a guide that tells how near things are,
frames are read in that direction.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.model.sampling_kernels import LANCZOS3
from fullsphere.model.source_picture import BORDER
from fullsphere.model.surface import Mosaic360
from fullsphere.model.table import tabulate
from fullsphere.mosaic.arm import ArmTurn, positions
from fullsphere.mosaic.turn_pictures import TurnPictures

_OPAQUE = 0.999  # of alpha: less is the soft edge of a mask
_RIM_PX = 2.0  # of the field of view, and
_RIM = math.radians(0.1)  # at least: not used, and
_SOFT = math.radians(0.5)  # from there on used more and more
_LEAST = 1e-3  # of a weight


class Seen(NamedTuple):
    """What a frame shows of some columns: linear light (H, w, 3), and how much it is worth (H, w), 0 to about 1."""

    light: NDArray[np.float32]
    worth: NDArray[np.float32]


class TurnReader:
    """A turn made ready to be read; asked from several threads.

    Parameters
    ----------
    turn, pictures
        The frames, how they look, and their pixels.
    surface
        The mosaic whose columns are asked for.
    guide
        (h, w) one over the distance along the ray, in arm lengths, on a mosaic of any size; None for all at infinity.
    """

    def __init__(
        self, turn: ArmTurn, pictures: TurnPictures, surface: Mosaic360, guide: NDArray[np.float32] | None
    ) -> None:
        self.turn, self.surface = turn, surface
        self._pictures, self._table = pictures, tabulate(turn.camera, 1e-4)
        self._guide = None if guide is None else _Guide(guide, surface.size)
        self._rotations = turn.camera_from_world(turn.angles)
        camera = turn.camera
        rim = camera.half_fov - max(_RIM, _RIM_PX / float(camera.lens.slope(np.array([camera.half_fov]))[0]))
        self._z_rim, self._z_full = math.cos(rim), math.cos(rim - _SOFT)

    def angles(self, columns: slice) -> FloatArray:
        """Turn angles (w,) of columns."""
        return np.asarray((np.arange(columns.start, columns.stop) + 0.5) * (2 * math.pi / self.surface.size[0]))

    def read(self, k: int, columns: slice) -> Seen:
        """Frame k along the rays of columns, which may reach past the mosaic's borders."""
        rays = self._rays(k, columns)
        pixels = self._table.project(rays, self._rotations[k], np.float32) + np.float32(BORDER)
        u, v = np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1])
        frame = self._pictures.of(self.turn.frames[k])
        codes = frame.picture.sampled(u, v, LANCZOS3, (u.shape[0] - 2, u.shape[1] - 2))
        z = rays[1:-1, 1:-1] @ self._rotations[k, 2].astype(np.float32)
        worth = np.clip((z - self._z_rim) / (self._z_full - self._z_rim), 0, 1) + np.float32(_LEAST)
        kept = (z > self._z_rim) & (z < self._pictures.z_inner) & np.isfinite(u[1:-1, 1:-1])
        if codes.shape[2] == 4:
            kept &= codes[..., 3] >= _OPAQUE * _full(codes)
        table = frame.light_of_code
        light = table[codes[..., :3]] if table.size else np.maximum(codes[..., :3], 0).astype(np.float32)
        return Seen(light, np.where(kept, worth, 0).astype(np.float32))

    def _rays(self, k: int, columns: slice) -> NDArray[np.float32]:
        """Unit rays (H + 2, w + 2, 3) from where frame k stood, of columns and a pixel more all around."""
        wide, high = slice(columns.start - 1, columns.stop + 1), slice(-1, self.surface.size[1] + 1)
        rays: NDArray[np.float32] = self.surface.window_rays(wide, high, np.float32)
        if self._guide is not None:
            aside = positions(self.angles(wide)) - positions(self.turn.angles[k])
            rays += self._guide.of(wide, high)[..., None] * aside.astype(np.float32)
            rays /= np.sqrt(np.einsum("hwc,hwc->hw", rays, rays))[..., None]
        return rays


class _Guide:
    """One over the distance along each ray, read between the pixels of a smaller mosaic, which goes round."""

    def __init__(self, nearness: NDArray[np.float32], size: tuple[int, int]) -> None:
        self._around = cv2.copyMakeBorder(nearness, 2, 2, 2, 2, cv2.BORDER_WRAP)
        self._shape, self._size = nearness.shape, size

    def of(self, columns: slice, rows: slice) -> NDArray[np.float32]:
        """(h, w) of a rectangle of the mosaic, which may reach past its borders."""
        x = self._places(columns, self._shape[1], self._size[0])
        y = self._places(rows, self._shape[0], self._size[1])
        across, down = np.meshgrid(x, y)
        return np.asarray(cv2.remap(self._around, across, down, cv2.INTER_LINEAR), np.float32)

    @staticmethod
    def _places(span: slice, small: int, large: int) -> NDArray[np.float32]:
        places = ((np.arange(span.start, span.stop) + 0.5) * small / large - 0.5) % small
        return (places + 2).astype(np.float32)


def _full(codes: NDArray[Any]) -> float:
    return 1.0 if codes.dtype.kind == "f" else float(np.iinfo(codes.dtype).max)
