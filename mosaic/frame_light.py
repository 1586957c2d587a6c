"""A frame's pixels ready to be sampled, and how they become the scene's light."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import decoding_table
from fullsphere.model.icc import SRGB, Profile
from fullsphere.model.source_picture import Samples, SourcePicture, source_picture
from fullsphere.mosaic.edge_shade import shade_at
from fullsphere.mosaic.frame_colour import in_profile, own_profile
from fullsphere.mosaic.masks import used
from fullsphere.mosaic.project import Frame, Mosaic, Picture

_RESOLVED_PX = 2.0  # lenses and colour sensors resolve half of what their pixels could: less needs no average
_CELLS = 512  # of the table of gains


class FrameLight(NamedTuple):
    """A frame's codes as the sampler reads them, and the light (n,) that each code stands for; none if they are light.

    Its channels are three, or four with the last one telling which pixels count.
    """

    picture: SourcePicture
    light_of_code: NDArray[np.float32]


class Gain(NamedTuple):
    """What takes recorded light to the scene's: factors (3,) of the channels, and a table (n,) over cos(theta)."""

    factors: NDArray[np.float32]
    over_z: NDArray[np.float32]
    z_min: float

    def at(self, z: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """(..., 3) for each channel at cosines (...) of the angle from the axis."""
        over_z = np.interp(z, np.linspace(self.z_min, 1, len(self.over_z)), self.over_z).astype(np.float32)
        gain: NDArray[np.float32] = over_z[..., None] * self.factors
        return gain


def gain_of(mosaic: Mosaic, frame: Frame) -> Gain:
    """The inverse of a frame's exposure and white balance, of its camera's vignetting and edge (see `photometry`)."""
    half = mosaic.cameras[frame.camera].half_fov
    z_min = math.cos(half)
    s = (np.arccos(np.linspace(z_min, 1, _CELLS + 1)) / half) ** 2
    w1, w2 = mosaic.vignetting_of(frame.camera)
    factor = (2.0**-frame.exposure_ev / np.array(frame.white_balance)).astype(np.float32)
    lost = w1 * s + w2 * s**2 + shade_at(s, mosaic.shade_of(frame.camera))
    return Gain(factor, np.exp2(-lost).astype(np.float32), z_min)


def codes_of(frame: Frame, profile: Profile = SRGB) -> Picture:
    """The frame's pixels (h, w, 3), or (h, w, 4) where a mask or its own alpha says what counts; codes of `profile`."""
    picture = in_profile(used(frame), own_profile(frame), profile)
    if picture.shape[2] >= 3:
        return picture
    colour = np.repeat(picture[..., :1], 3, axis=2)
    return colour if picture.shape[2] == 1 else np.concatenate([colour, picture[..., 1:]], axis=2)


class FrameLights:
    """The frames of a mosaic as the sampler reads them, the latest used kept in memory; safe to ask from many threads.

    Parameters
    ----------
    cameras
        Those of the mosaic.
    kept_bytes
        Memory for them; a frame that does not fit any more is opened again when it is needed.
    profile
        The colour space that the codes of all are in (`common_profile`).
    """

    def __init__(self, cameras: Sequence[Camera], kept_bytes: int, profile: Profile = SRGB) -> None:
        self._cameras, self._room, self._profile = cameras, kept_bytes, profile
        self._kept: OrderedDict[str, FrameLight] = OrderedDict()
        self._lock = threading.Lock()
        self._loading: dict[str, threading.Lock] = {}

    def of(self, frame: Frame) -> FrameLight:
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
                while len(self._kept) > 1 and self._bytes() > self._room:
                    self._kept.popitem(last=False)
            return light

    def _bytes(self) -> int:
        return sum(light.picture.bordered.nbytes for light in self._kept.values())

    def _open(self, frame: Frame) -> FrameLight:
        codes = codes_of(frame, self._profile)
        samples = Samples(codes.dtype, codes.shape[2], linear_light=False)
        ready = source_picture([(0, codes)], self._cameras[frame.camera], samples)
        return FrameLight(ready.averaged_beyond(_RESOLVED_PX), decoding_table(codes.dtype, self._profile))
