"""Any projection -> any projection: the page of verbs.

A target is computed in tiles: their positions in the source come from `positions.py`, their values from a picture made
ready by `source_picture.py`.  Neither rays nor maps of a whole picture ever exist, unless a `Remapper` is asked to keep
them for the next frame.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import sampling_kernels as kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.picture_file import PictureFile
from fullsphere.model.positions import Geometry, Positions
from fullsphere.model.source_picture import BORDER, Samples, SourcePicture, bytes_when_ready, source_picture
from fullsphere.model.source_windows import WindowedPicture
from fullsphere.model.surface import Equirectangular
from fullsphere.model.table import RayTable
from fullsphere.model.workers import ordered_map

Interpolation = Literal["nearest", "linear", "cubic", "lanczos3"]

INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
"""The interpolations, in the order of their quality."""

TILE_PX = 512
"""Side of the tiles of `tiles`: their rays and maps stay in the processor's cache."""

_ROWS, _COLUMNS = 64, 512  # of the tiles in here: positions and the part of the source that they need stay in the cache
_GUTTER = 16  # pixels of its neighbours around each face of a cube: footprints and kernels reach over its edges
_WHOLE_BYTES = 2 << 30  # that a picture file may take to be read whole; not by what is free, or bytes would differ
_KINDS = dict(zip(INTERPOLATIONS, (kernels.NEAREST, kernels.LINEAR, kernels.CUBIC, kernels.LANCZOS3), strict=True))

Tile = tuple[slice, slice]


class Band(NamedTuple):
    """Finished rows of a target from `top`: pixels (n, W, ...) and weight (n, W) float32."""

    top: int
    pixels: NDArray[Any]
    weight: NDArray[np.float32]


def remap(
    image: NDArray[Any],
    source: Projection,
    target: Projection,
    target_from_source: ArrayLike | None = None,
    interpolation: Interpolation = "cubic",
    executor: Executor | None = None,
    *,
    antialias: bool = True,
    linear_light: bool = False,
) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Resample a picture from one projection into another.

    Parameters
    ----------
    image
        Pixels (h, w) or (h, w, c) of `source`, uint8, uint16, float16 or float32, c at most 4; with 2 or 4 channels the
        last is alpha, colours not multiplied by it.
    source, target
        The two projections; a Camera is tabulated.
    target_from_source
        Rotation (3, 3) that takes rays of the source's frame into the target's; none by default.
    interpolation
        "nearest", "linear", "cubic" (Keys 1981, slope -0.6) or "lanczos3".
    executor
        Where tiles are computed side by side.
    antialias
        Take pixels for averages over their squares: where those of the target are the larger, average over their
        footprint; where they are smaller, "cubic" and "lanczos3" restore the contrast that the source's took away.
    linear_light
        Average integer samples, which are sRGB codes, in linear light instead of by their codes.

    Returns
    -------
    image
        The target's pixels (H, W, ...) in the type of `image`; zero where the source saw nothing.
    weight
        (H, W) float32: 1 where the source saw the direction, 0 where it did not.  Along the rim of a field of view
        only seen pixels count, so that the dark beyond it leaves no fringe.

    Raises
    ------
    UsageError
        If the image is not of the source's size, has other samples or channels, the interpolation is not known, or the
        rotation is none.
    """
    remapper = Remapper(
        source,
        target,
        target_from_source,
        interpolation,
        antialias=antialias,
        linear_light=linear_light,
        executor=executor,
    )
    result, weight = remapper(image)
    weight.flags.writeable = True
    return result, weight


class Remapper:
    """`remap` for frame after frame: what does not change from one to the next is made once.

    Parameters
    ----------
    source, target, target_from_source, interpolation, antialias, linear_light, executor
        As `remap`.
    kept_bytes
        Memory that positions may take to be kept for the next frame, 8 bytes for each pixel that the source sees; what
        does not fit is computed anew each time.  The pixels that come out are the same.
    """

    def __init__(
        self,
        source: Projection,
        target: Projection,
        target_from_source: ArrayLike | None = None,
        interpolation: Interpolation = "cubic",
        *,
        antialias: bool = True,
        linear_light: bool = False,
        kept_bytes: int = 0,
        executor: Executor | None = None,
    ) -> None:
        if interpolation not in INTERPOLATIONS:
            raise UsageError(f"interpolation {interpolation!r} is not one of {', '.join(INTERPOLATIONS)}")
        self.source, self.target = source, target
        turn = np.eye(3) if target_from_source is None else np.asarray(target_from_source, float).T
        self._kind = _KINDS[interpolation]
        self._read: Projection = source  # what pixels are read from: a cube's faces with their neighbours around them
        if isinstance(source, CubeMap) and self._kind != kernels.NEAREST and not source.gutter:
            self._read = dataclasses.replace(source, gutter=min(_GUTTER, source.side))
        self._geometry = Geometry(self._read, target, turn, BORDER)
        averages = self._kind > kernels.LINEAR or self._geometry.largest_step > kernels.SHARP_PX
        self._halo = int(antialias and averages and self._kind != kernels.NEAREST)
        self._linear_light, self._executor = linear_light, executor
        self._kept: dict[tuple[int, int, int], Positions | None] = {}
        self._weight: NDArray[np.float32] | None = None
        self._room, self._lock = kept_bytes, threading.Lock()

    def __call__(self, image: NDArray[Any] | PictureFile) -> tuple[NDArray[Any], NDArray[np.float32]]:
        """The whole target's pixels and weight, as `remap` gives them.

        A picture file that takes more than 2 GiB when it is made ready is read by region.  The weight is the same
        array for every frame, and not to be written to.
        """
        picture = self._made_ready(image)
        width, height = self.target.size
        result = np.zeros((height, width, picture.samples.channels), image.dtype)
        weight = np.zeros((height, width), np.float32) if self._weight is None else None

        def fill(rows: slice) -> None:
            self._fill(picture, rows, result[rows], None if weight is None else weight[rows])

        for _ in ordered_map(self._executor, fill, _rows_of(height)):
            pass
        if weight is not None:
            weight.flags.writeable = False
            self._weight = weight
        assert self._weight is not None
        return result.reshape(height, width, *_channels_of(image)), self._weight

    def bands(self, image: NDArray[Any] | PictureFile, rows: int = _ROWS) -> Iterator[Band]:
        """The target in bands of `rows` rows from the top, for a file that is written as it is computed.

        Only a few bands exist at a time.  The pixels are those of a call.
        """
        if rows < 1:
            raise UsageError(f"bands of {rows} rows: a band has at least one")
        picture = self._made_ready(image)
        width, height = self.target.size

        def made(band: slice) -> Band:
            count = band.stop - band.start
            pixels = np.zeros((count, width, picture.samples.channels), image.dtype)
            weight = np.zeros((count, width), np.float32)
            self._fill(picture, band, pixels, weight)
            return Band(band.start, pixels.reshape(count, width, *_channels_of(image)), weight)

        yield from ordered_map(self._executor, made, _rows_of(height, rows), ahead=4)

    def _made_ready(self, image: NDArray[Any] | PictureFile) -> SourcePicture | WindowedPicture:
        if isinstance(image, PictureFile):
            size, channels = image.size, image.channels
        elif image.ndim not in (2, 3):
            raise UsageError(f"a picture is an array (h, w) or (h, w, c), not one of {image.ndim} dimensions")
        else:
            size, channels = (image.shape[1], image.shape[0]), image.shape[2] if image.ndim == 3 else 1
        if size != self.source.size:
            raise UsageError(
                f"the picture is {size[0]} x {size[1]} but its projection is for "
                f"{self.source.size[0]} x {self.source.size[1]}"
            )
        if image.dtype not in (np.uint8, np.uint16, np.float16, np.float32) or not 1 <= channels <= 4:
            raise UsageError(
                f"a picture of {channels} channels of {image.dtype}: give 1 to 4 channels of uint8, uint16, float16 or "
                "float32"
            )
        samples = Samples(np.dtype(image.dtype), channels, self._linear_light)
        if isinstance(self._read, CubeMap) and isinstance(self.source, CubeMap) and self._read is not self.source:
            whole = image.window(0, 0, *size) if isinstance(image, PictureFile) else image
            image, _ = self.source.with_gutters(whole, self._read.gutter)
        if not isinstance(image, PictureFile):
            return source_picture([(0, image.reshape(*image.shape[:2], channels))], self._read, samples)
        if bytes_when_ready(size, samples) > _WHOLE_BYTES:
            return WindowedPicture(image, self.source, samples)
        return source_picture(image.strips(), self.source, samples)

    def _fill(
        self,
        picture: SourcePicture | WindowedPicture,
        rows: slice,
        pixels: NDArray[Any],
        weight: NDArray[np.float32] | None,
    ) -> None:
        """Compute rows of the target into `pixels` and `weight`, which are zero."""
        for top in range(rows.start, rows.stop, _ROWS):
            bottom = min(top + _ROWS, rows.stop)
            here = slice(top - rows.start, bottom - rows.start)
            for left in range(0, self.target.size[0], _COLUMNS):
                columns = slice(left, min(left + _COLUMNS, self.target.size[0]))
                found = self._positions(slice(top, bottom), columns)
                if found is None:
                    continue
                picture.sample_into(found.u, found.v, self._kind, pixels[here], columns)
                if weight is not None and found.all_seen:
                    weight[here, columns] = 1
                elif weight is not None:
                    kernels.mark_seen(found.u, columns.start, columns.stop - columns.start, weight[here])

    def _positions(self, rows: slice, columns: slice) -> Positions | None:
        """Positions of a tile and, where pixels are averages, of those around it; kept where there is room."""
        place = (rows.start, rows.stop, columns.start)
        if place in self._kept:
            return self._kept[place]
        halo = self._halo
        found = self._geometry.positions(
            slice(rows.start - halo, rows.stop + halo), slice(columns.start - halo, columns.stop + halo)
        )
        if found is not None and halo and self._kind == kernels.LINEAR and not kernels.some_are_large(found.u, found.v):
            found = found.inner
        needed = 0 if found is None else found.u.nbytes + found.v.nbytes
        with self._lock:
            if place not in self._kept and needed <= self._room:  # another frame under way may have kept it
                self._kept[place] = found
                self._room -= needed
        return found


def _channels_of(image: NDArray[Any] | PictureFile) -> tuple[int, ...]:
    return (image.channels,) if isinstance(image, PictureFile) else image.shape[2:]


def _rows_of(height: int, count: int = _ROWS) -> Iterator[slice]:
    for top in range(0, height, count):
        yield slice(top, min(top + count, height))


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
