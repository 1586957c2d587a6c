"""A solved mosaic -> the finished panorama, tile by tile: the page of verbs.

Frames are looked at once on the working sphere (`overview`), where it is decided who owns what (`seams`) and how bright
everything is to be (`shares`).  Every tile of any surface is then computed on its own from that and the frames' pixels;
the same bytes come out for any number of threads.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Projection
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.positions import Geometry, Positions, fast
from fullsphere.model.remap import TILE_PX, Tile, tiles
from fullsphere.model.sampling_kernels import LANCZOS3, LINEAR
from fullsphere.model.source_picture import BORDER
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.alignment import local_shifts
from fullsphere.mosaic.compose_kernels import add_frame
from fullsphere.mosaic.frame_colour import common_profile
from fullsphere.mosaic.frame_light import FrameLights, Gain, gain_of
from fullsphere.mosaic.overview import RIM, Overview, overviews, working_sphere
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.seams import find_owners
from fullsphere.mosaic.shares import FLOOR, Share, Shares, feathered, shares_of, whole_share
from fullsphere.mosaic.shift import Shift

FRAME_BYTES = 1 << 30
"""Memory for frames; one that does not fit any more is opened again when it is needed."""

Blend = Literal["multiband", "feather"]
"""How frames are brought together."""

_SHARPER = np.float32(1.2)  # than linear interpolation a frame of light may be: more would ring round a lamp, black
_OPAQUE = 0.999  # of alpha: less is the soft edge of a mask


class Band(NamedTuple):
    """Finished rows of a panorama, from `top`: (n, width, 4), colour encoded and alpha = coverage."""

    top: int
    rows: NDArray[np.generic]


def plan(
    mosaic: Mosaic,
    executor: Executor | None = None,
    blend: Blend = "multiband",
    seen: Sequence[Overview] | None = None,
) -> Shares:
    """Decide on the working sphere what each registered frame gives to a panorama.

    "multiband" has seams where frames agree and mixes in many bands; "feather" mixes all frames softly, and is quick.
    Frames that were looked at before on `working_sphere` may be given as they were `seen`.
    """
    sphere = working_sphere(mosaic)
    seen = overviews(mosaic, sphere, executor) if seen is None else seen
    if blend == "feather":
        return feathered(seen, sphere)
    owners = find_owners(seen, executor)
    shifts = local_shifts(mosaic, owners, sphere, executor)
    if any(shifts):
        seen = overviews(mosaic, sphere, executor, shifts)
    return dataclasses.replace(shares_of(seen, owners, sphere, executor), shifts=shifts)


def compose(
    mosaic: Mosaic,
    surface: Projection,
    dtype: type[np.uint8] | type[np.uint16] | type[np.float32] = np.uint8,
    executor: Executor | None = None,
    shares: Shares | None = None,
    exposure_ev: float = 0.0,
    frame_bytes: int = FRAME_BYTES,
    tile_px: int = TILE_PX,
) -> Iterator[Band]:
    """Render a mosaic.

    Parameters
    ----------
    mosaic
        The solved project; its registered frames are opened through `Frame.load`.
    surface
        What to render into: any projection.
    dtype
        uint8 and uint16 are codes of the frames' common colour space (`common_profile`), float32 is linear light in its
        primaries.
    executor
        Where tiles are computed side by side.
    shares
        What `plan` decided; decided anew by default.
    exposure_ev
        How much brighter than the mosaic's reference the panorama is to be.
    frame_bytes
        Memory for frames.
    tile_px
        Side of the tiles; it changes nothing in the picture.

    Yields
    ------
    Bands of rows from top to bottom that partition the picture.
    """
    shares = plan(mosaic, executor) if shares is None else shares
    profile = common_profile(mosaic.registered)
    lights = FrameLights(mosaic.cameras, frame_bytes, profile)
    composer = _Composer(mosaic, surface, shares, lights, 2.0**exposure_ev)
    width, height = surface.size

    def render(tile: Tile) -> NDArray[Any]:
        light, seen = composer.tile(tile)
        return np.dstack([encoded_from_linear(light, dtype, profile), _alpha(seen, dtype)])

    across = math.ceil(width / tile_px)
    finished = ordered_map(executor, render, tiles(surface.size, tile_px), ahead=2 * across)
    for top in range(0, height, tile_px):
        yield Band(top, np.concatenate([next(finished) for _ in range(across)], axis=1))


def _alpha(seen: NDArray[np.bool_], dtype: type[np.generic]) -> NDArray[Any]:
    full = {"uint8": 255, "uint16": 65535}.get(np.dtype(dtype).name, 1)
    return np.where(seen, full, 0).astype(dtype)


class _Source(NamedTuple):
    """A frame, where its pixels are, and what makes them the scene's light."""

    frame: Frame
    geometry: Geometry
    gain: Gain
    axis: NDArray[np.float64]
    z_rim: float
    shift: Shift | None


class _Sampled(NamedTuple):
    """What a frame shows in a part of a tile."""

    codes: NDArray[Any]
    light_of_code: NDArray[np.float32]
    opaque: float
    u: NDArray[np.floating[Any]]
    z: NDArray[np.float32]


class _Canvas(NamedTuple):
    """A tile under way: its rays and places on the working sphere; light and weight grow with each frame."""

    tile: Tile
    rays: NDArray[np.float32]
    at: NDArray[np.float32]
    light: NDArray[np.float32]
    weight: NDArray[np.float32]


class _Composer:
    """The mosaic and the surface made ready for tile after tile; asked from several threads."""

    def __init__(
        self, mosaic: Mosaic, surface: Projection, shares: Shares, lights: FrameLights, brightness: float
    ) -> None:
        self._shares, self._lights, self._brightness = shares, lights, np.float32(brightness)
        self._surface, self._whole = fast(surface), whole_share(shares.sphere)
        self._sources = [
            _source(mosaic, frame, surface, shift)
            for frame, shift in itertools.zip_longest(mosaic.registered, shares.shifts)
        ]

    def tile(self, tile: Tile) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """The light (h, w, 3) of a tile, and where any frame shows something (h, w)."""
        rows, columns = tile
        rays = self._surface.window_rays(columns, rows, np.float32)
        at = self._shares.sphere.project(rays, dtype=np.float32)
        canvas = _Canvas(tile, rays, at, np.zeros(rays.shape, np.float32), np.zeros(rays.shape[:2], np.float32))
        places, looks = _places(at, self._shares.sphere.size), np.isfinite(at[..., 0])
        for k, part in _parts(self._shares.owning[places], looks):
            share = self._shares.of[k]
            assert share is not None
            self._add(k, canvas, part, share)
        for k, part in _parts(self._shares.seeing[places], looks & (canvas.weight == 0)):
            self._add(k, canvas, part, self._whole, only_gaps=True)  # along rims, where the owner sees no more
        seen = canvas.weight > 0
        light = canvas.light
        np.divide(light, canvas.weight[..., None], out=light, where=seen[..., None])
        return light * self._brightness, seen

    def _add(self, k: int, canvas: _Canvas, part: Tile, share: Share, only_gaps: bool = False) -> None:
        """Bring a frame into a part of the tile, by its share; or only where those before have left nothing."""
        found = self._sampled(k, canvas, part)
        if found is None:
            return
        source, weight = self._sources[k], canvas.weight[part]
        add_frame(
            found.codes,
            found.light_of_code,
            found.opaque,
            np.where(weight > 0, np.nan, found.u).astype(found.u.dtype) if only_gaps else found.u,
            found.z,
            source.z_rim,
            source.gain.factors,
            source.gain.over_z,
            source.gain.z_min,
            canvas.at[part],
            self._shares.sphere.size[0],
            share.values,
            share.left,
            share.top,
            FLOOR,
            float(1 / self._brightness),
            canvas.light[part],
            weight,
        )

    def _sampled(self, k: int, canvas: _Canvas, part: Tile) -> _Sampled | None:
        source = self._sources[k]
        (rows, columns), (down, across) = canvas.tile, part
        top, left = rows.start + down.start, columns.start + across.start
        shape = (down.stop - down.start, across.stop - across.start)
        found = source.geometry.positions(
            slice(top - 1, top + shape[0] + 1), slice(left - 1, left + shape[1] + 1)
        )  # with those around, from which the sampler takes the footprints
        if found is None:
            return None
        if source.shift is not None:
            u, v = source.shift.moved(found.u, found.v, source.frame.size, BORDER)
            found = Positions(u, v, all_seen=False)
        light = self._lights.of(source.frame)
        codes = light.picture.sampled(found.u, found.v, LANCZOS3, shape)
        if codes.dtype.kind == "f":
            between = light.picture.sampled(found.u, found.v, LINEAR, shape)[..., :3]
            np.clip(codes[..., :3], between / _SHARPER, between * _SHARPER, out=codes[..., :3])
        full = 1.0 if codes.dtype.kind == "f" else float(np.iinfo(codes.dtype).max)
        rays, axis = canvas.rays[part], source.axis.astype(np.float32)
        # A matrix product would round by where in the tile a pixel lies.
        z = rays[..., 0] * axis[0] + rays[..., 1] * axis[1] + rays[..., 2] * axis[2]
        return _Sampled(codes, light.light_of_code, _OPAQUE * full, found.inner.u, z)


def _source(mosaic: Mosaic, frame: Frame, surface: Projection, shift: Shift | None) -> _Source:
    assert frame.camera_from_world is not None
    camera = mosaic.cameras[frame.camera]
    geometry = Geometry(camera, surface, frame.camera_from_world, BORDER)
    z_rim = math.cos(camera.half_fov - RIM)
    return _Source(frame, geometry, gain_of(mosaic, frame), frame.camera_from_world[2], z_rim, shift)


def _places(at: NDArray[np.float32], size: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The pixels (h, w) of the working sphere that places on it are nearest to; of those that are none the first."""
    width, height = size
    near = np.nan_to_num(np.floor(at + np.float32(0.5))).astype(np.intp)
    return np.clip(near[..., 1], 0, height - 1), near[..., 0] % width


def _parts(bits: NDArray[np.uint64], wanted: NDArray[np.bool_]) -> Iterator[tuple[int, Tile]]:
    """The frames of which a bit is set where it is wanted (h, w), each with the rectangle in which that is so."""
    chosen = np.where(wanted[..., None], bits, np.uint64(0))
    present = np.bitwise_or.reduce(chosen, axis=(0, 1))
    for word, some in enumerate(present.tolist()):
        for bit in range(some.bit_length()):
            if some >> bit & 1:
                mask = (chosen[..., word] >> np.uint64(bit)) & np.uint64(1)
                rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
                yield (
                    64 * word + bit,
                    (slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)),
                )
