"""A picture made ready to be sampled: with a border past which no kernel reaches, in the samples that kernels read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model import sampling_kernels as kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular, SeparableSurface
from fullsphere.model.table import RayTable

Pixels = NDArray[Any]
Places = NDArray[np.floating[Any]]

BORDER = 4
"""Pixels around a picture: the widest kernel reads three to either side of a position that is at most half outside."""

_REACH = 1.5 * BORDER  # beyond a rim: the widest kernel's corner is further than its side
_NO_TEXELS = np.empty(0, np.uint32)
_NEVER = 1e18  # pixels, more than any picture has; its square is still a float32
_HALF_MAX = np.float32(np.finfo(np.float16).max)
_OPAQUE_ENOUGH = 1e-4  # of alpha: less than a code of 8 bits, below it there is no colour to restore


@dataclasses.dataclass(frozen=True)
class Samples:
    """How samples of one kind of picture are worked with.

    Attributes
    ----------
    dtype, channels
        Of the picture; with 2 or 4 channels the last is alpha, colours not multiplied by it.
    linear_light
        Whether integer samples, which are sRGB codes, are averaged in linear light.
    """

    dtype: np.dtype[Any]
    channels: int
    linear_light: bool

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is alpha."""
        return self.channels in (2, 4)

    @property
    def as_light(self) -> bool:
        """Whether samples are turned into float32 first, colours multiplied by alpha."""
        return self.has_alpha or self.dtype == np.float16 or (self.linear_light and self.dtype.kind == "u")

    @property
    def working(self) -> np.dtype[Any]:
        """Type of what kernels read and write."""
        return np.dtype(np.float32) if self.as_light else self.dtype

    @property
    def packed(self) -> bool:
        """Whether a pixel is four bytes in one."""
        return self.working == np.uint8 and self.channels == 3

    @property
    def top(self) -> float:
        """The code that values are clipped to; zero where they are not."""
        return float(np.iinfo(self.working).max) if self.working.kind == "u" else 0.0

    def decoded(self, pixels: Pixels) -> Pixels:
        """Pixels (h, w, c) as kernels work with them."""
        if not self.as_light:
            return pixels
        full = np.float32(np.iinfo(self.dtype).max if self.dtype.kind == "u" else 1)
        colours = self.channels - self.has_alpha
        light = np.empty(pixels.shape, np.float32)
        if self.linear_light:
            light[..., :colours] = linear_from_encoded(np.ascontiguousarray(pixels[..., :colours]))
        else:
            np.divide(pixels[..., :colours], full, out=light[..., :colours])
        if self.has_alpha:
            np.divide(pixels[..., -1], full, out=light[..., -1])
            with np.errstate(invalid="ignore"):
                light[..., :colours] *= light[..., -1:]
            if self.dtype.kind == "f":
                light[light[..., -1] == 0] = 0  # infinities under it would be NaN, and spread
        return light

    def encoded(self, light: Pixels) -> Pixels:
        """What kernels wrote (h, w, c), in the picture's own samples."""
        if not self.as_light:
            return light
        colours = self.channels - self.has_alpha
        if self.has_alpha:
            alpha = np.maximum(light[..., -1:], 0)
            light = np.concatenate([light[..., :colours] / np.maximum(alpha, _OPAQUE_ENOUGH), alpha], -1)
        if self.dtype.kind == "f":
            if self.dtype == np.float16:  # overshoot beside its largest number is not infinite
                np.clip(light, -_HALF_MAX, _HALF_MAX, out=light, where=np.isfinite(light))
            return light.astype(self.dtype)
        codes = np.empty(light.shape, self.dtype)
        if self.linear_light:
            codes[..., :colours] = encoded_from_linear(light[..., :colours], self.dtype)
        full = np.float32(np.iinfo(self.dtype).max)
        plain = light[..., colours:] if self.linear_light else light
        codes[..., codes.shape[-1] - plain.shape[-1] :] = np.clip(plain, 0, 1) * full + np.float32(0.5)
        return codes


@dataclasses.dataclass(frozen=True, eq=False)
class SourcePicture:
    """A bordered picture, or the window of one that starts at `origin`, as kernels read it.

    Attributes
    ----------
    samples
        How to work with its samples.
    bordered
        (h, w, c), in C order, as kernels work with it; a packed picture has four channels.
    origin
        Column and row of its first pixel in the bordered picture.
    limits
        As `sampling_kernels.sample_tile` wants them, in the bordered picture.
    """

    samples: Samples
    bordered: Pixels
    origin: tuple[int, int]
    limits: FloatArray

    def averaged_beyond(self, footprint_px: float) -> SourcePicture:
        """The picture, of which footprints are averaged only where they are wider than so many of its pixels."""
        return dataclasses.replace(self, limits=np.append(self.limits[:-1], footprint_px**2))

    def sampled(self, u: Places, v: Places, kind: int, shape: tuple[int, int]) -> Pixels:
        """Values (h, w, c) in the picture's type at positions in the bordered picture.

        `u` and `v` have `shape` (h, w), or a pixel more all around; then pixels are averages over their squares.
        """
        out = np.empty((*shape, self.samples.channels), self.samples.dtype)
        self.sample_into(u, v, kind, out, slice(0, shape[1]))
        return out

    def sample_into(self, u: Places, v: Places, kind: int, out: Pixels, columns: slice) -> None:
        """Write the same values into columns of `out` (h, W, c), rows of a whole target."""
        limits, (x, y) = self.limits, self.origin
        if self.origin != (0, 0):
            u, v = u - u.dtype.type(x), v - v.dtype.type(y)
            limits = limits - np.array([x, y, x, y, 0, x, y, 0, 0, 0, 0, 0])
        width = columns.stop - columns.start
        direct = not self.samples.as_light
        room = out if direct else np.empty((len(out), width, out.shape[2]), self.samples.working)
        flat = self.bordered.reshape(-1)
        kernels.sample_tile(
            flat.view(np.uint32) if self.samples.packed else _NO_TEXELS,
            flat[:0] if self.samples.packed else flat,
            self.bordered.shape[1],
            self.bordered.shape[2],
            kind,
            u,
            v,
            limits.astype(u.dtype),
            self.samples.top,
            columns.start if direct else 0,
            width,
            room,
        )
        if not direct:
            out[:, columns] = self.samples.encoded(room)


def source_picture(strips: Iterable[tuple[int, Pixels]], projection: Projection, samples: Samples) -> SourcePicture:
    """Make a whole picture ready, its edges and its rim those of the projection.

    `strips` are its rows from the top: the first row's number and the pixels (n, w, c).
    """
    width, height = projection.size
    bordered = _room(width + 2 * BORDER, height + 2 * BORDER, samples)
    for top, rows in strips:
        put(bordered[BORDER + top : BORDER + top + len(rows), BORDER:-BORDER], rows, samples)
    disc = _disc(projection)
    fill_rim(bordered[BORDER:-BORDER, BORDER:-BORDER], disc)
    _fill_border(bordered, meeting(projection))
    return SourcePicture(samples, bordered, (0, 0), _limits(projection))


def source_window(pixels: Pixels, origin: tuple[int, int], projection: Projection, samples: Samples) -> SourcePicture:
    """Make pixels (h, w, c) from `origin` in the bordered picture ready; what is past its edges is among them."""
    bordered = _room(pixels.shape[1], pixels.shape[0], samples)
    put(bordered, pixels, samples)
    centre_u, centre_v, aspect, radius = _disc(projection)
    left, top = origin
    fill_rim(bordered, (centre_u + BORDER - left, centre_v + BORDER - top, aspect, radius))
    limits = _limits(projection)
    if limits[4] > 0:  # the window goes on past these edges
        limits[[0, 2]] = -np.inf, np.inf
    if limits[4] > 1:
        limits[[1, 3]] = -np.inf, np.inf
    limits[4] = 0
    return SourcePicture(samples, bordered, origin, limits)


def meeting(projection: Projection) -> int:
    """How the edges of a picture meet: 0 not at all, 1 left and right, 2 as a sphere's."""
    if isinstance(projection, Equirectangular) and projection.whole and projection.size[0] % 2 == 0:
        return 2
    return int(isinstance(projection, SeparableSurface) and projection.wraps)


def bytes_when_ready(size: tuple[int, int], samples: Samples) -> int:
    """Memory that a whole picture takes when it is made ready."""
    channels = 4 if samples.packed else samples.channels
    return (size[0] + 2 * BORDER) * (size[1] + 2 * BORDER) * channels * samples.working.itemsize


def _room(width: int, height: int, samples: Samples) -> Pixels:
    return np.empty((height, width, 4 if samples.packed else samples.channels), samples.working)


def put(room: Pixels, rows: Pixels, samples: Samples) -> None:
    """Copy pixels (h, w, c) of the picture's type into those that kernels work with."""
    if samples.packed:
        cv2.cvtColor(np.ascontiguousarray(rows), cv2.COLOR_RGB2RGBA, dst=room)  # ten times as fast as NumPy's copy
    else:
        room[:] = samples.decoded(rows)


def fill_rim(room: Pixels, disc: tuple[float, float, float, float]) -> None:
    """Fill what a lens does not see along the rim of its field of view, where kernels reach it."""
    centre_u, centre_v, aspect, radius = disc
    if math.isfinite(radius) and radius > 2 * BORDER:
        kernels.fill_rim(room, centre_u, centre_v, aspect, radius, _REACH / min(1.0, aspect))


def _fill_border(bordered: Pixels, meets: int) -> None:
    height, width = bordered.shape[0] - 2 * BORDER, bordered.shape[1] - 2 * BORDER
    b = BORDER
    if meets > 0:
        around = np.arange(-b, width + b) % width + b
        bordered[b:-b, :b], bordered[b:-b, -b:] = bordered[b:-b, around[:b]], bordered[b:-b, around[-b:]]
    else:
        bordered[b:-b, :b], bordered[b:-b, -b:] = bordered[b:-b, b : b + 1], bordered[b:-b, -b - 1 : -b]
    if meets > 1:
        beyond = (np.arange(-b, width + b) + width // 2) % width + b
        for k in range(b):
            bordered[b - 1 - k] = bordered[b + min(k, height - 1), beyond]
            bordered[b + height + k] = bordered[b + max(height - 1 - k, 0), beyond]
    else:
        bordered[:b], bordered[-b:] = bordered[b], bordered[-b - 1]


def _limits(projection: Projection) -> FloatArray:
    (width, height), meets = projection.size, meeting(projection)
    least = BORDER - 0.5
    centre_u, centre_v, aspect, radius = _disc(projection)
    around = width if meets else _NEVER
    longest = projection.side / 2 if isinstance(projection, CubeMap) else _NEVER
    edges = [least, least, width + least, height + least, meets]
    centre = centre_u + BORDER, centre_v + BORDER
    return np.array([*edges, *centre, aspect, radius, around, longest, kernels.SHARP_PX**2])


def _disc(projection: Projection) -> tuple[float, float, float, float]:
    """Centre, aspect and radius of what a lens sees of its picture; an infinite radius where that is all of it."""
    camera = projection.camera if isinstance(projection, RayTable) else projection
    if not isinstance(camera, Camera):
        return 0.0, 0.0, 1.0, math.inf
    (u0, v0), (width, height) = camera.centre, camera.size
    corner = math.hypot(max(u0, width - 1 - u0), max(v0, height - 1 - v0) / camera.aspect)
    return u0, v0, camera.aspect, camera.image_radius if camera.image_radius < corner else math.inf
