"""What the benchmarks photograph: a room with detail of all scales, or a panorama of the user's own, as light."""

import math
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.images import read_picture
from fullsphere.mosaic.photographer import Scene, panorama, photograph
from fullsphere.mosaic.worlds import environment, furnished_room

Pixels = NDArray[Any]

_FACE_PX = 2560  # texels over 90 degrees: three to four for a pixel of the frames that accuracy is measured with
_ROW = 16384  # cv2.remap takes no longer side: rays are looked up in rows of this length


class Panorama:
    """A scene that is an equirectangular picture, looked up linearly between its pixels."""

    def __init__(self, path: Path) -> None:
        light = linear_from_encoded(read_picture(path).pixels[..., :3])
        self._width, self._height = light.shape[1], light.shape[0]
        wrapped = np.concatenate([light[:, -1:], light, light[:, :1]], axis=1)
        self._padded = np.ascontiguousarray(np.concatenate([wrapped[:1], wrapped, wrapped[-1:]]))

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        """Linear light (..., 3) along rays (..., 3); 0 for a NaN ray."""
        given = np.asarray(rays, float)
        flat = given.reshape(-1, 3)
        rows = -(-len(flat) // _ROW)
        at = np.full((2, rows * _ROW), -10.0, np.float32)
        x, y, z = flat.T
        at[0, : len(flat)] = (np.arctan2(x, z) / (2 * math.pi) + 0.5) * self._width + 0.5
        at[1, : len(flat)] = (np.arctan2(y, np.hypot(x, z)) / math.pi + 0.5) * self._height + 0.5
        u, v = np.nan_to_num(at, nan=-10.0).reshape(2, rows, _ROW)
        light = cv2.remap(self._padded, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(light.reshape(-1, 3)[: len(flat)].reshape(given.shape), np.float32)


class Codes:
    """A scene in sRGB codes 0..1 instead of light, so that an area's mean is the mean of what files hold."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        codes = encoded_from_linear(self._scene.radiance(rays), np.uint16)
        return codes.astype(np.float32) / np.float32(65535)


def scene_of(path: Path | None, executor: Executor) -> Scene:
    """The panorama at `path`, or the furnished room."""
    return Panorama(path) if path else environment(furnished_room(texel_mm=2.0), _FACE_PX, executor)


def frame_of(scene: Scene, camera: Camera, executor: Executor, supersampling: int = 4) -> NDArray[np.uint8]:
    """What a camera that looks to the front sees: sRGB, each pixel the mean of its area."""
    return photograph(scene, camera, np.eye(3), supersampling=supersampling, executor=executor)


def panorama_of(scene: Scene, width: int, executor: Executor, supersampling: int = 4) -> NDArray[np.uint8]:
    """The whole scene as an equirectangular picture: sRGB, each pixel the mean of its area."""
    light = panorama(scene, width, supersampling=supersampling, executor=executor)
    return np.asarray(encoded_from_linear(light, np.uint8))
