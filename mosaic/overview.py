"""Every frame on the working sphere: a small equirectangular picture on which seams and brightness are decided."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import decoding_table
from fullsphere.model.icc import SRGB, Profile
from fullsphere.model.lens import FloatArray
from fullsphere.model.positions import Geometry, Positions
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.frame_colour import common_profile
from fullsphere.mosaic.frame_light import Gain, codes_of, gain_of
from fullsphere.mosaic.overview_kernels import shown_on_sphere
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.shift import Shift
from fullsphere.mosaic.small_light import small_light

RIM = math.radians(0.7)
"""The last of a field of view, which is dark and soft in every lens: nothing is taken from there."""

_LARGEST, _SMALLEST = 1024, 256  # width of the working sphere
_BYTES = 1 << 28  # that the overviews of all frames may take
_WHITE = 0.985  # of the largest code: brighter pixels are clipped
_ANGLES = 256  # from the axis at which it is known how finely a lens resolves
_FAR = 0.3  # radians from rim and border at which a frame is worth half of what it is far from them
_CLIPPED_WORTH = 0.1


@dataclasses.dataclass(frozen=True, eq=False)
class Overview:
    """One frame on the working sphere.

    Attributes
    ----------
    light
        (H, W, 3) linear light of the scene: exposure, white balance and vignetting taken out; 0 where not seen.
    quality
        (H, W) 0 where the frame sees nothing that counts, else in (0, 1]: more where it resolves finely, far from its
        rim and borders, and nothing is clipped.
    """

    light: NDArray[np.float32]
    quality: NDArray[np.float32]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(H, W)."""
        return self.quality > 0


class Reduced(NamedTuple):
    """A frame made `factor` times smaller: its light (h, w, 3) times the share that counts, that share, and how much
    of it is clipped (h, w).
    """

    light: NDArray[np.float32]
    seen: NDArray[np.float32]
    clipped: NDArray[np.float32]
    factor: int


def working_sphere(mosaic: Mosaic) -> Equirectangular:
    """The working sphere of the registered frames: no finer than they are, and smaller for many, to bound memory."""
    frames = len(mosaic.registered)
    resolved = 2 * math.pi * _finest([mosaic.cameras[frame.camera] for frame in mosaic.registered])
    width = _LARGEST
    while width > _SMALLEST and (width > resolved or frames * width * width // 2 * 16 > _BYTES):
        width //= 2
    return Equirectangular((width, width // 2))


def overviews(
    mosaic: Mosaic, sphere: Equirectangular, executor: Executor | None = None, shifts: Sequence[Shift | None] = ()
) -> list[Overview]:
    """The registered frames of a mosaic on the working sphere, each opened once, side by side on `executor`.

    Each is read aside by its shift, if there are any.
    """
    finest = _finest(mosaic.cameras)
    profile = common_profile(mosaic.registered)

    def made(each: tuple[Frame, Shift | None]) -> Overview:
        frame, shift = each
        camera = mosaic.cameras[frame.camera]
        return overview_of(frame, camera, gain_of(mosaic, frame), sphere, finest, profile, shift)

    return list(ordered_map(executor, made, itertools.zip_longest(mosaic.registered, shifts), ahead=4))


def overview_of(
    frame: Frame,
    camera: Camera,
    gain: Gain,
    sphere: Equirectangular,
    finest: float,
    profile: Profile = SRGB,
    shift: Shift | None = None,
) -> Overview:
    """One registered frame on the working sphere, its light in the primaries of `profile`.

    `finest` is the most pixels per radian that any frame has.
    """
    assert frame.camera_from_world is not None
    width, height = sphere.size
    light, quality = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    found = Geometry(camera, sphere, frame.camera_from_world, 0).positions(slice(0, height), slice(0, width))
    if found is None:
        return Overview(light, quality)
    if shift is not None:
        found = Positions(*shift.moved(found.u, found.v, camera.size), all_seen=False)
    z = sphere.window_rays(slice(0, width), slice(0, height)) @ frame.camera_from_world[2]
    rim = camera.half_fov - RIM
    small = reduced_frame(frame, camera, _factor(camera, sphere), profile)
    shown_on_sphere(
        found.u,
        found.v,
        z,
        np.dstack([small.light, small.seen]),
        small.clipped,
        small.factor,
        np.array(camera.size, float),
        gain.factors,
        gain.over_z,
        gain.z_min,
        rim,
        _density(camera, np.linspace(0, rim, _ANGLES)),
        finest,
        _FAR,
        _CLIPPED_WORTH,
        light,
        quality,
    )
    return Overview(light, quality)


def _density(camera: Camera, theta: FloatArray) -> FloatArray:
    """Pixels per radian at theta: the root of those per solid angle, r r'/sin(theta)."""
    safe = np.maximum(theta, 1e-6)
    return np.sqrt(np.maximum(camera.lens.radius(safe) * camera.lens.slope(safe) / np.sin(safe), 0) * camera.aspect)


def _finest(cameras: Iterable[Camera]) -> float:
    """The most pixels per radian anywhere in the fields of view."""
    return max(float(_density(camera, np.linspace(0, camera.half_fov, 200)).max()) for camera in cameras)


def reduced_frame(frame: Frame, camera: Camera, factor: int, profile: Profile = SRGB) -> Reduced:
    """The light of a frame as it was recorded, averaged over squares of `factor` pixels."""
    codes = codes_of(frame, profile)
    white = math.inf if codes.dtype.kind == "f" else _WHITE * np.iinfo(codes.dtype).max
    radius = float(camera.lens.radius(camera.half_fov - RIM))
    disc = np.array([*camera.centre, camera.aspect, radius * radius])
    small = small_light(codes, decoding_table(codes.dtype, profile), white, factor, disc)
    return Reduced(small.light * small.seen[..., None], small.seen, small.clipped, factor)


def _factor(camera: Camera, sphere: Equirectangular) -> int:
    """How much smaller a frame is to be, so that a pixel is about one of the working sphere's."""
    per_radian = sphere.size[0] / (2 * math.pi)
    return max(1, int(float(_density(camera, np.array([(camera.half_fov - RIM) / 2]))[0]) / per_radian))
