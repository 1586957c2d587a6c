"""Any projection -> any projection."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.sampling import INTERPOLATIONS, Interpolation, sample, smoothed
from fullsphere.model.surface import Equirectangular
from fullsphere.model.table import RayTable, tabulate
from fullsphere.model.workers import ordered_map

TILE_PX = 512
"""Side of the tiles in which a target is computed: their rays and maps stay in the processor's cache."""

_PAD = 4  # pixels added around a panorama as source, enough for every kernel; smoothing reaches 1.8 ratios further
_LEAST_COVER = 0.5  # share of the kernel's weight that must lie on seen pixels

Tile = tuple[slice, slice]


def tiles(size: tuple[int, int], side: int = TILE_PX) -> list[Tile]:
    """(rows, columns) of the tiles that partition a picture of (width, height), row by row."""
    width, height = size
    return [
        (slice(y, min(y + side, height)), slice(x, min(x + side, width)))
        for y in range(0, height, side)
        for x in range(0, width, side)
    ]


def window_rays(target: Projection, tile: Tile) -> FloatArray:
    """Unit rays (rows, columns, 3) of a tile of any projection, NaN where it looks nowhere."""
    rows, columns = tile
    if isinstance(target, Equirectangular):
        return target.window_rays(columns, rows)
    u, v = np.meshgrid(
        np.arange(columns.start, columns.stop, dtype=float), np.arange(rows.start, rows.stop, dtype=float)
    )
    return target.unproject(np.stack([u, v], -1))


def pixels_per_radian(projection: Projection) -> float:
    """The scale of a picture where it is plainest: on the optical axis, on the equator."""
    if isinstance(projection, Camera):
        return float(projection.lens.slope(0.0))
    if isinstance(projection, RayTable):
        return pixels_per_radian(projection.camera)
    return projection.size[0] / (2 * math.pi)


def remap(
    image: NDArray[Any],
    source: Projection,
    target: Projection,
    target_from_source: ArrayLike | None = None,
    interpolation: Interpolation = "cubic",
    executor: Executor | None = None,
) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Resample a picture from one projection into another.

    Parameters
    ----------
    image
        Pixels (h, w) or (h, w, c) of `source`, uint8, uint16 or float32, c at most 4.
    source, target
        The two projections; a Camera is tabulated first.
    target_from_source
        Rotation (3, 3) that takes rays of the source's frame into the target's; none by default.
    interpolation
        "nearest", "linear" or "cubic".
    executor
        Where tiles are computed side by side.

    Returns
    -------
    image
        The target's pixels in the type of `image`; zero where the source saw nothing.
    weight
        (H, W) float32: 1 where the source saw the direction, 0 where it did not.  Near the rim of the field of view
        only seen pixels count, so that the dark beyond it leaves no fringe.

    Raises
    ------
    UsageError
        If the image is not of the source's size, or the interpolation is not known.
    """
    if (image.shape[1], image.shape[0]) != source.size:
        raise UsageError(f"the picture is {image.shape[1]} x {image.shape[0]} but its projection is for {source.size}")
    if interpolation not in INTERPOLATIONS:
        raise UsageError(f"interpolation {interpolation!r} is not one of {', '.join(INTERPOLATIONS)}")
    source_from_target = np.eye(3) if target_from_source is None else np.asarray(target_from_source, float).T
    ratio = 1.0 if interpolation == "nearest" else pixels_per_radian(source) / pixels_per_radian(target)
    read = _reader(image, source, source_from_target, interpolation, ratio)
    width, height = target.size
    result = np.zeros((height, width, *image.shape[2:]), image.dtype)
    weight = np.zeros((height, width), np.float32)

    def fill(tile: Tile) -> None:
        result[tile], weight[tile] = read(window_rays(target, tile))

    for _ in ordered_map(executor, fill, tiles(target.size)):
        pass
    return result, weight


_Reader = Callable[[FloatArray], tuple[NDArray[Any], NDArray[np.float32]]]


def _reader(
    image: NDArray[Any], source: Projection, turn: FloatArray, interpolation: Interpolation, ratio: float
) -> _Reader:
    """A function from target rays (h, w, 3) to values and weights; `ratio` is how much coarser the target is."""
    if isinstance(source, Equirectangular):
        return _panorama_reader(image, source, turn, interpolation, ratio)
    fast = tabulate(source) if isinstance(source, Camera) else source
    width, height = source.size
    seen = _seen(fast)
    if seen is not None:
        image = image * seen.reshape(*seen.shape, *[1] * (image.ndim - 2)).astype(image.dtype)
        seen = smoothed(seen, ratio)
    image = smoothed(image, ratio)

    def read(rays: FloatArray) -> tuple[NDArray[Any], NDArray[np.float32]]:
        if isinstance(fast, RayTable):
            pixels = fast.project(rays, turn, np.float32)
        else:
            pixels = fast.project(rays @ turn.T).astype(np.float32)
        u, v = pixels[..., 0], pixels[..., 1]
        with np.errstate(invalid="ignore"):
            inside = (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)
        pixels[~inside] = np.nan
        values = sample(image, pixels, interpolation)
        if seen is not None:
            cover = sample(seen, pixels, interpolation)
            inside &= cover >= _LEAST_COVER
            values = _divided(values, cover)
        values[~inside] = 0
        return values, inside.astype(np.float32)

    return read


def _seen(projection: Projection) -> NDArray[np.float32] | None:
    """1 for the pixels (h, w) of a picture that look somewhere, 0 for the rest; None where all do."""
    width, height = projection.size
    seen = np.empty((height, width), np.float32)
    for tile in tiles(projection.size):
        seen[tile] = np.isfinite(window_rays(projection, tile)[..., 0])
    return None if seen.all() else seen


def _divided(values: NDArray[Any], cover: NDArray[np.float32]) -> NDArray[Any]:
    """Values over the share of the kernel that lay on seen pixels, in the type of `values`."""
    partial = (cover != 1) & (cover >= _LEAST_COVER)
    if partial.any():
        share = cover[partial].reshape(-1, *[1] * (values.ndim - 2))
        exact = values[partial] / share
        if np.issubdtype(values.dtype, np.integer):
            exact = np.clip(np.round(exact), 0, np.iinfo(values.dtype).max)
        values[partial] = exact
    return values


def _panorama_reader(
    image: NDArray[Any], source: Equirectangular, turn: FloatArray, interpolation: Interpolation, ratio: float
) -> _Reader:
    """The panorama is padded once, before it is smoothed: wrapped sideways, turned by half past the poles."""
    height, width = image.shape[:2]
    pad = min(_PAD + math.ceil(2 * ratio), height)
    top, bottom = (np.roll(rows[::-1], width // 2, axis=1) for rows in (image[:pad], image[-pad:]))
    tall = np.concatenate([top, image, bottom])
    padded = smoothed(np.ascontiguousarray(np.concatenate([tall[:, -pad:], tall, tall[:, :pad]], axis=1)), ratio)

    def read(rays: FloatArray) -> tuple[NDArray[Any], NDArray[np.float32]]:
        pixels = (source.project(rays @ turn.T) + pad).astype(np.float32)
        return sample(padded, pixels, interpolation), np.isfinite(pixels[..., 0]).astype(np.float32)

    return read
