"""A picture made ready to be sampled: with a border past which no kernel reaches, in the samples that kernels read."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model import sampling_kernels as kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.surface import Equirectangular, Mosaic360, SeparableSurface
from fullsphere.model.table import RayTable

Pixels = NDArray[Any]

BORDER = 4
"""Pixels around a picture: the widest kernel reads three to either side of a position that is at most half outside."""

_NO_TEXELS = np.empty(0, np.uint32)
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
            light[..., :colours] *= light[..., -1:]
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
    """A bordered picture, or the window of one that starts at `origin`, in the arrays that kernels read.

    Attributes
    ----------
    samples
        How to work with its samples.
    texels, values, stride
        As `sampling_kernels.sample_tile` wants them.
    origin
        Column and row of the window's first pixel, border included, in the bordered picture.
    limits
        As `sample_tile` wants them, for the whole bordered picture.
    """

    samples: Samples
    texels: NDArray[np.uint32]
    values: Pixels
    stride: int
    origin: tuple[int, int]
    limits: NDArray[np.float64]

    def sampled(
        self, u: NDArray[np.floating[Any]], v: NDArray[np.floating[Any]], kind: int, shape: tuple[int, int]
    ) -> Pixels:
        """Values (h, w, c) in the picture's type at positions in the bordered picture.

        `u` and `v` have `shape` (h, w), or a pixel more all around; then large footprints are averaged.
        """
        texels, values, limits = self.texels, self.values, self.limits
        left, top = self.origin
        if u.dtype != np.float32:  # the place of the nearest whole pixel is taken off before digits are lost
            x, y = max(0, int(np.nanmin(u)) - BORDER - left), max(0, int(np.nanmin(v)) - BORDER - top)
            left, top = left + x, top + y
            start = y * self.stride + x
            texels, values = texels[start:], values[start * self.samples.channels :]
        if (left, top) != (0, 0):
            u, v = (u - left).astype(np.float32), (v - top).astype(np.float32)
            limits = limits - np.array([left, top, left, top, 0, left, top, 0, 0])
        channels = 4 if self.samples.packed else self.samples.channels
        out = np.empty((*shape, self.samples.channels), self.samples.working)
        kernels.sample_tile(
            texels,
            values,
            self.stride,
            channels,
            kind,
            u,
            v,
            limits.astype(np.float32),
            self.samples.top,
            out,
        )
        return self.samples.encoded(out)


def source_picture(pixels: Pixels, projection: Projection, samples: Samples) -> SourcePicture:
    """Make a whole picture (h, w, c) ready, its edges and its rim those of the projection."""
    height, width = pixels.shape[:2]
    bordered = empty_bordered(width, height, samples)
    put_rows(bordered, 0, pixels, samples)
    finish_border(bordered, projection, samples)
    return of_bordered(bordered, projection, samples, (0, 0))


def empty_bordered(width: int, height: int, samples: Samples) -> Pixels:
    """Room for a picture and its border, (h + 8, w + 8, c); a packed picture has four channels."""
    channels = 4 if samples.packed else samples.channels
    return np.empty((height + 2 * BORDER, width + 2 * BORDER, channels), samples.working)


def put_rows(bordered: Pixels, top: int, rows: Pixels, samples: Samples) -> None:
    """Copy rows (n, w, c) to where they belong from row `top` of the picture."""
    inner = bordered[BORDER + top : BORDER + top + len(rows), BORDER:-BORDER]
    if samples.packed:
        cv2.cvtColor(np.ascontiguousarray(rows), cv2.COLOR_RGB2RGBA, dst=inner)  # ten times as fast as NumPy's copy
    else:
        inner[:] = samples.decoded(rows)


def finish_border(bordered: Pixels, projection: Projection, samples: Samples) -> None:
    """Fill the border, and what a lens does not see along the rim of its field of view."""
    height, width = bordered.shape[0] - 2 * BORDER, bordered.shape[1] - 2 * BORDER
    disc = _disc(projection)
    if math.isfinite(disc[3]):
        _fill_rim(bordered[BORDER:-BORDER, BORDER:-BORDER], disc)
    meets = _meeting(projection)
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


def of_bordered(bordered: Pixels, projection: Projection, samples: Samples, origin: tuple[int, int]) -> SourcePicture:
    """A bordered picture, or a window of one, in the arrays that kernels read."""
    flat = bordered.reshape(-1)
    packed = samples.packed
    width, height = projection.size
    first, last = BORDER - 0.5, BORDER - 0.5
    centre_u, centre_v, aspect, radius = _disc(projection)
    return SourcePicture(
        samples,
        flat.view(np.uint32) if packed else _NO_TEXELS,
        flat[:0] if packed else flat,
        bordered.shape[1],
        origin,
        np.array(
            [
                first,
                first,
                width + last,
                height + last,
                _meeting(projection),
                centre_u + BORDER,
                centre_v + BORDER,
                aspect,
                radius,
            ]
        ),
    )


def _fill_rim(inner: Pixels, disc: tuple[float, float, float, float]) -> None:
    centre_u, centre_v, aspect, radius = disc
    if radius > 2 * BORDER:
        kernels.fill_rim(inner, centre_u, centre_v, aspect, radius, float(BORDER))


def _disc(projection: Projection) -> tuple[float, float, float, float]:
    """Centre, aspect and radius of what a lens sees of its picture; an infinite radius where that is all of it."""
    camera = projection.camera if isinstance(projection, RayTable) else projection
    if not isinstance(camera, Camera):
        return 0.0, 0.0, 1.0, math.inf
    (u0, v0), (width, height) = camera.centre, camera.size
    corner = math.hypot(max(u0, width - 1 - u0), max(v0, height - 1 - v0) / camera.aspect)
    return u0, v0, camera.aspect, camera.image_radius if camera.image_radius < corner else math.inf


def _meeting(projection: Projection) -> int:
    """How the edges of a picture meet: 0 not at all, 1 left and right, 2 as a sphere's."""
    if isinstance(projection, Mosaic360):
        return 1
    if isinstance(projection, Equirectangular) and projection.whole and projection.size[0] % 2 == 0:
        return 2
    return int(isinstance(projection, SeparableSurface) and projection.wraps)
