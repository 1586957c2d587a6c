"""What is kept of the frames of a turn after their one reading: rings of pixels.

The mosaic is made of the rays at about 90 degrees from the axis: of a frame only a narrow ring is needed.  All rings of
a turn together take about the same memory whether its frames are many or few.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import decoding_table
from fullsphere.model.icc import SRGB, Profile
from fullsphere.model.source_picture import BORDER, Samples, SourcePicture, source_picture
from fullsphere.mosaic.frame_light import FrameLight, codes_of
from fullsphere.mosaic.project import Frame, Picture

_KERNEL_PX = 6  # what a sampler reads beside a position, and the footprint that it averages
_RESOLVED_PX = 1.2  # lenses and colour sensors resolve half of what their pixels could: less needs no average


class _Kept(NamedTuple):
    texels: NDArray[Any]
    samples: Samples


@dataclasses.dataclass
class _Room:
    """A picture that frames take turns in, and which one is there."""

    picture: SourcePicture
    holds: str = ""


class TurnPictures:
    """The pictures of a turn, each opened once while its ring fits into memory; safe to ask from many threads.

    Parameters
    ----------
    camera
        That took all frames.
    inner
        The angle from the axis, radians, from which on pixels are needed.
    kept_bytes
        Memory for rings; the frames whose rings do not fit any more are opened again when they are needed.
    profile
        The colour space that the codes of all are in (`common_profile`).

    Attributes
    ----------
    z_inner
        The cosine of `inner`: nothing is kept where it is more.
    """

    def __init__(self, camera: Camera, inner: float, kept_bytes: int, profile: Profile = SRGB) -> None:
        self._camera, self._profile = camera, profile
        self.z_inner = math.cos(max(inner, 0.0))
        self._ring, self._room, self._taken = _ring(camera, inner), kept_bytes, 0
        self._kept: dict[str, _Kept] = {}
        self._read: set[str] = set()
        self._lock = threading.Lock()
        self._own = threading.local()

    def read(self, frame: Frame) -> Picture:
        """Open a frame and answer its codes (h, w, 3 or 4); what is needed of it later is kept."""
        codes = codes_of(frame, self._profile)
        ready = self._ready(codes)
        texels = _stored(_texels(ready.bordered)[self._ring])
        with self._lock:
            self._read.add(frame.id)
            if frame.id not in self._kept and self._taken + texels.nbytes <= self._room:
                self._kept[frame.id] = _Kept(texels, ready.samples)
                self._taken += texels.nbytes
        return codes

    def holds(self, frame: Frame) -> bool:
        """Whether the frame was read."""
        return frame.id in self._read

    @property
    def kept_bytes(self) -> int:
        """The memory that rings take."""
        return self._taken

    def of(self, frame: Frame) -> FrameLight:
        """The frame as the sampler reads it: only its ring holds something, and only until this thread asks again."""
        kept = self._kept.get(frame.id)
        if kept is None:
            ready = self._ready(codes_of(frame, self._profile))
        else:
            room = self._room_for(kept.samples)
            ready = room.picture
            if room.holds != frame.id:
                _texels(ready.bordered)[self._ring] = _restored(kept.texels)
                room.holds = frame.id
        table = decoding_table(ready.samples.dtype, self._profile)
        return FrameLight(ready.averaged_beyond(_RESOLVED_PX), table)

    def _ready(self, codes: Picture) -> SourcePicture:
        samples = Samples(codes.dtype, codes.shape[2], linear_light=False)
        return source_picture([(0, codes)], self._camera, samples)

    def _room_for(self, samples: Samples) -> _Room:
        """A picture of this thread's own, of which all frames fill the same pixels."""
        rooms: dict[Samples, _Room] = self._own.__dict__.setdefault("rooms", {})
        if samples not in rooms:
            width, height = self._camera.size
            rooms[samples] = _Room(self._ready(np.zeros((height, width, samples.channels), samples.dtype)))
        return rooms[samples]


def _ring(camera: Camera, inner: float) -> NDArray[np.intp]:
    """The texels of a bordered picture that are seen at `inner` radians and more from the axis, and what is beside."""
    (width, height), (u0, v0) = camera.size, camera.centre
    x = np.arange(-BORDER, width + BORDER) - u0
    y = (np.arange(-BORDER, height + BORDER) - v0) / camera.aspect
    squares = y[:, None] ** 2 + x**2
    margin = _KERNEL_PX / min(1.0, camera.aspect)
    inwards = max(float(camera.lens.radius(max(inner, 0.0))) - margin, 0.0)
    return np.flatnonzero((squares >= inwards**2) & (squares <= (camera.image_radius + margin) ** 2))


def _stored(texels: NDArray[Any]) -> NDArray[Any]:
    """Texels as they are kept: packed ones (n,) without their unused byte, (n, 3)."""
    return np.ascontiguousarray(texels.view(np.uint8).reshape(-1, 4)[:, :3]) if texels.ndim == 1 else texels


def _restored(texels: NDArray[Any]) -> NDArray[Any]:
    """What was stored, as the sampler reads it."""
    if texels.dtype != np.uint8 or texels.shape[1] != 3:
        return texels
    packed = cv2.cvtColor(texels[None], cv2.COLOR_RGB2RGBA)  # ten times as fast as NumPy
    return np.asarray(packed).view(np.uint32).reshape(-1)


def _texels(bordered: NDArray[Any]) -> NDArray[Any]:
    """The texels of a bordered picture in a row: a packed one's as one number each."""
    if bordered.dtype == np.uint8 and bordered.shape[2] == 4:
        return bordered.view(np.uint32).reshape(-1)
    return bordered.reshape(-1, bordered.shape[2])
