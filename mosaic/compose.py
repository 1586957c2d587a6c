"""A solved mosaic -> the finished panorama, tile by tile: the page of verbs.

Every tile is computed on its own from the mosaic and the frames' pixels; the same bytes come out for any number of
threads.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.positions import Geometry
from fullsphere.model.remap import TILE_PX, Tile, tiles
from fullsphere.model.sampling_kernels import CUBIC
from fullsphere.model.source_picture import BORDER, Samples, SourcePicture, source_picture
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.blend import Feather
from fullsphere.mosaic.masks import used
from fullsphere.mosaic.project import Frame, Mosaic

FRAME_CACHE_BYTES = 2 << 30
"""Memory for frames in linear light; a frame that does not fit any more is opened again when it is needed."""

_RIM = math.radians(0.7)  # the last of the field of view is dark and soft in every lens
_FEATHER_POWER = 6  # higher hides parallax in a narrower seam, lower hides differences of brightness in a wider one
_BORDER = 0.05  # of the frame's shorter side: how far a straight border of the picture is feathered
_BRIGHT, _CLIPPED = 0.8, 0.98  # linear light: between them a pixel loses trust, as it may have been brighter
_CLIPPED_WEIGHT = 0.1  # not less: the soft, dark rim of another frame would win over a clipped light


class Band(NamedTuple):
    """Finished rows of a panorama, from `top`: (n, width, 4), colour encoded and alpha = coverage."""

    top: int
    rows: NDArray[np.generic]


class _Light(NamedTuple):
    """A frame in linear light, with its mask as alpha where it has one."""

    picture: SourcePicture
    clips: bool


def compose(
    mosaic: Mosaic,
    surface: Equirectangular,
    dtype: type[np.uint8] | type[np.uint16] | type[np.float32] = np.uint8,
    executor: Executor | None = None,
) -> Iterator[Band]:
    """Render a mosaic.

    Parameters
    ----------
    mosaic
        The solved project; its registered frames are opened through `Frame.load`.
    surface
        What to render into.
    dtype
        uint8 and uint16 are sRGB, float32 is linear light.
    executor
        Where tiles are computed side by side.

    Yields
    ------
    Bands of rows from top to bottom that partition the picture.
    """
    lights = _LightCache(mosaic.cameras)
    geometries = {
        frame.id: Geometry(mosaic.cameras[frame.camera], surface, frame.camera_from_world, BORDER)
        for frame in mosaic.registered
        if frame.camera_from_world is not None
    }
    width, height = surface.size

    def render(tile: Tile) -> NDArray[np.generic]:
        light, alpha = _blended_tile(mosaic, geometries, lights, surface, tile)
        return np.dstack([encoded_from_linear(light, dtype), _alpha(alpha, dtype)])

    across = math.ceil(width / TILE_PX)
    finished = ordered_map(executor, render, tiles(surface.size), ahead=2 * across)
    for top in range(0, height, TILE_PX):
        yield Band(top, np.concatenate([next(finished) for _ in range(across)], axis=1))


def _alpha(coverage: NDArray[np.float32], dtype: type[np.generic]) -> NDArray[np.generic]:
    full = {"uint8": 255, "uint16": 65535}.get(np.dtype(dtype).name, 1)
    return np.asarray(coverage * np.float32(full)).astype(dtype)


def _blended_tile(
    mosaic: Mosaic, geometries: Mapping[str, Geometry], lights: _LightCache, surface: Equirectangular, tile: Tile
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rows, columns = tile
    rays = surface.window_rays(columns, rows)
    blender = Feather(*rays.shape[:2])
    middle = rays[rays.shape[0] // 2, rays.shape[1] // 2]
    reach = float(np.arccos(np.clip((rays @ middle).min(), -1, 1)))
    for frame in mosaic.registered:
        turn, camera = frame.camera_from_world, mosaic.cameras[frame.camera]
        assert turn is not None
        if math.acos(float(np.clip(turn[2] @ middle, -1, 1))) > camera.half_fov + reach:
            continue
        around = slice(rows.start - 1, rows.stop + 1), slice(columns.start - 1, columns.stop + 1)
        found = geometries[frame.id].positions(*around)
        if found is None:
            continue
        pixels = np.stack([found.u[1:-1, 1:-1], found.v[1:-1, 1:-1]], -1, dtype=np.float32) - np.float32(BORDER)
        theta = np.arccos(np.clip(rays @ turn[2], -1, 1)).astype(np.float32)
        weight = frame_weight(camera, theta, pixels)
        if not weight.any():
            continue
        light = lights.of(frame)
        sampled = light.picture.sampled(found.u, found.v, CUBIC, weight.shape)
        colour = sampled[..., :3]
        if light.clips:
            weight *= _trust(colour.max(-1))
        if sampled.shape[-1] == 4:
            weight = weight * (sampled[..., 3] > 0.999)
        s = (theta / camera.half_fov) ** 2
        w1, w2 = mosaic.vignetting_of(frame.camera)
        gain = np.exp2(-(frame.exposure_ev + w1 * s + w2 * s**2), dtype=np.float32)
        tint = np.array(frame.white_balance, np.float32)
        blender.feed(np.maximum(colour, 0) * (gain[..., None] / tint), weight.astype(np.float32))
    return blender.blended()


def frame_weight(camera: Camera, theta: NDArray[np.float32], pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """How much a frame is trusted at pixels (h, w, 2) seen at theta (h, w): 1 on the axis, 0 at the rim and outside.

    Falls with the cosine of theta, rescaled to reach zero just inside the rim, and over a narrow strip along the
    straight borders of the picture.
    """
    limit = math.cos(camera.half_fov - _RIM)
    inner = np.clip((np.cos(theta) - limit) / (1 - limit), 0, 1) ** _FEATHER_POWER
    width, height = camera.size
    u, v = pixels[..., 0], pixels[..., 1]
    with np.errstate(invalid="ignore"):
        border = np.minimum(np.minimum(u, width - 1 - u), np.minimum(v, height - 1 - v)) / (
            _BORDER * min(width, height)
        )
        inner *= np.clip(np.nan_to_num(border, nan=0.0), 0, 1) ** 2
    return np.asarray(inner, np.float32)


def _trust(brightest: NDArray[np.float32]) -> NDArray[np.float32]:
    """Factor (h, w) on the weight of pixels by their brightest channel: falls smoothly where they are near clipping."""
    t = np.clip((brightest - _BRIGHT) / (_CLIPPED - _BRIGHT), 0, 1)
    return np.asarray(1 - (1 - _CLIPPED_WEIGHT) * t * t * (3 - 2 * t), np.float32)


class _LightCache:
    """The frames' linear light, the latest used kept in memory; safe to ask from several threads."""

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self._cameras = cameras
        self._kept: OrderedDict[str, _Light] = OrderedDict()
        self._lock = threading.Lock()
        self._loading: dict[str, threading.Lock] = {}

    def of(self, frame: Frame) -> _Light:
        """The frame's light, opened once for all the threads that wait for it."""
        with self._lock:
            loading = self._loading.setdefault(frame.id, threading.Lock())
        with loading:
            with self._lock:
                if frame.id in self._kept:
                    self._kept.move_to_end(frame.id)
                    return self._kept[frame.id]
            light = self._open(frame)
            with self._lock:
                self._kept[frame.id] = light
                while len(self._kept) > 1 and self._bytes() > FRAME_CACHE_BYTES:
                    self._kept.popitem(last=False)
            return light

    def _bytes(self) -> int:
        return sum(light.picture.bordered.nbytes for light in self._kept.values())

    def _open(self, frame: Frame) -> _Light:
        picture = used(frame)
        colour = linear_from_encoded(picture[..., :3])
        if colour.shape[2] == 1:
            colour = np.repeat(colour, 3, axis=2)
        if picture.shape[2] == 4:
            colour = np.concatenate([colour, (picture[..., 3:] > 0).astype(np.float32)], axis=2)
        samples = Samples(colour.dtype, colour.shape[2], linear_light=False)
        return _Light(source_picture([(0, colour)], self._cameras[frame.camera], samples), picture.dtype != np.float32)
