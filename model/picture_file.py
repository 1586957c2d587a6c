"""An opened picture file, read by region: a picture larger than the memory is a source like any other.

Pixels are in sensor coordinates, as stored: the EXIF orientation is kept beside them and never applied.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.block_cache import BlockCache
from fullsphere.model.errors import InputError
from fullsphere.model.image_library import ImageSpec, attribute_of
from fullsphere.model.picture_blocks import PictureBlocks
from fullsphere.model.picture_metadata import CAPTURE_NAMES, Attributes, Value, sound
from fullsphere.model.resources import require_memory

CACHE_BYTES = 1 << 26
"""What a file keeps of the blocks that were read last, unless it is told another amount."""

# What is asked of OpenImageIO for each type of sample in a file; integers of 32 bits hold no photograph.
_SAMPLE_TYPES = {"uint8": "uint8", "uint16": "uint16", "half": "half", "float": "float", "double": "float"}
_DTYPES = {"uint8": np.uint8, "uint16": np.uint16, "half": np.float16, "float": np.float32}

Pixels = NDArray[Any]


class PictureFile:
    """An opened picture file; several threads may read from it.

    A tiled TIFF or OpenEXR file is read in its tiles, any other in bands of rows.  The blocks read last are kept, so
    windows that go down a picture decode each row once.  For a row above those, a JPEG or PNG begins again from its
    first row, which is right, and slow.  WebP, JPEG 2000 and JPEG XL files are decoded whole by the first read.

    Attributes
    ----------
    path
        Where it is read from.
    size
        Width and height in pixels.
    channels
        1 (grey), 2 (grey and alpha), 3 (RGB) or 4 (RGB and alpha); colours are not multiplied by alpha.
    dtype
        uint8, uint16, float16 or float32, as the file holds its samples (float64 as float32).
    linear
        Whether the samples are linear light (floating-point files) instead of sRGB codes.
    orientation
        EXIF orientation, 1 to 8: how to turn the picture for show.
    icc_profile
        The colour profile in the file, or None.
    metadata
        What the camera noted about the exposure, by OpenImageIO's names ("Make", "GPS:Latitude", ...).
    """

    size: tuple[int, int]
    channels: int
    dtype: np.dtype[Any]
    linear: bool
    orientation: int
    icc_profile: bytes | None
    metadata: Attributes

    def __init__(self, path: Path, cache_bytes: int = CACHE_BYTES, *, by_region: bool = True) -> None:
        """As `open_picture`, which closes it; without `by_region` no larger than what is read whole."""
        self.path = Path(path)
        self._blocks = PictureBlocks(self.path, by_region, _SAMPLE_TYPES)
        try:
            self._take_header(self._blocks.spec)
        except BaseException:
            self._blocks.close()
            raise
        self._cache = BlockCache(self._blocks, cache_bytes, self._made)

    def window(self, left: int, top: int, width: int, height: int) -> Pixels:
        """The pixels (height, width, c) of a rectangle of the picture, C order, of the file's type.

        Raises
        ------
        InputError
            If a part of the file that holds them is damaged.
        ValueError
            If the rectangle is empty or not within the picture, or the file is closed.
        """
        right, bottom = left + width, top + height
        if not (0 <= left < right <= self.size[0] and 0 <= top < bottom <= self.size[1]):
            raise ValueError(f"{width} x {height} pixels at ({left}, {top}) are not within {self.size}")
        pixels = np.empty((height, width, self.channels), self.dtype)
        block_width, block_height = self._blocks.block_size
        for block_top in range(top - top % block_height, bottom, block_height):
            for block_left in range(left - left % block_width, right, block_width):
                block = self._cache.block(block_left, block_top)
                x0, x1 = max(left, block_left), min(right, block_left + block_width)
                y0, y1 = max(top, block_top), min(bottom, block_top + block_height)
                part = block[y0 - block_top : y1 - block_top, x0 - block_left : x1 - block_left]
                pixels[y0 - top : y1 - top, x0 - left : x1 - left] = part
        return pixels

    def strips(self, rows: int = 256) -> Iterator[tuple[int, Pixels]]:
        """The whole picture from the top in strips as wide as it is: the first row's number and the pixels (n, w, c).

        For filling an array of the caller's with little memory beside it: nothing is kept.

        Parameters
        ----------
        rows
            About as many rows a strip; a strip is whole blocks of the file.

        Raises
        ------
        InputError
            When a part of the file that is damaged is met.
        """
        width, height = self.size
        step = self._blocks.block_size[1] * max(1, rows // self._blocks.block_size[1])
        for top in range(0, height, step):
            yield top, self._cache.read(0, top, width, min(top + step, height))

    def close(self) -> None:
        """Let go of the file."""
        self._cache.close()

    def _take_header(self, spec: ImageSpec) -> None:
        if not (spec.nchannels in (1, 3, 4) or (spec.nchannels == 2 and spec.alpha_channel == 1)):
            raise InputError(f"{self.path}: has {spec.nchannels} channels; export it as grey, RGB or RGBA")
        self.size, self.channels = (spec.width, spec.height), spec.nchannels
        self.dtype = np.dtype(_DTYPES[self._blocks.sample_type])
        self.linear = self.dtype.kind == "f"
        self.orientation = _orientation(spec)
        self.icc_profile = _icc_profile(spec)
        self.metadata = _capture_metadata(spec)
        # An OpenEXR file's colours are multiplied by its alpha; in every other format they come as they are.
        self._multiplied = self._blocks.kind == "openexr" and self.channels in (2, 4)
        block_bytes = self._blocks.block_size[0] * self._blocks.block_size[1] * self.channels * self.dtype.itemsize
        require_memory(block_bytes, f"{self.path}:", "its tiles are too large; export it again")

    def _made(self, samples: Pixels) -> Pixels:
        return divided_by_alpha(samples) if self._multiplied else samples


@contextlib.contextmanager
def open_picture(path: Path, cache_bytes: int = CACHE_BYTES) -> Iterator[PictureFile]:
    """Open a picture to be read by region; it is closed when the block ends.

    Parameters
    ----------
    path
        A picture of any kind that `read_picture` reads.  TIFF and OpenEXR files may have 2^36 pixels, others 2^30.
    cache_bytes
        How much of what was decoded last is kept.

    Raises
    ------
    InputError
        If the file is missing, empty, no picture, of a kind that is not read (RAW, HEIC), damaged in its header, too
        large, or has a number of channels or a type of sample that no photograph has.  Damage further on is met where
        it is read.
    ResourceError
        If one tile does not fit into memory.
    """
    with contextlib.closing(PictureFile(path, cache_bytes)) as file:
        yield file


def divided_by_alpha(pixels: Pixels) -> Pixels:
    """Floating-point pixels (..., c), the last channel alpha, with the product of colour and alpha divided by alpha.

    Where alpha is 0 the colour stays as it is.
    """
    alpha = pixels[..., -1:].astype(np.float32)
    colour = pixels[..., :-1].astype(np.float32)
    straight = pixels.copy()
    with np.errstate(over="ignore"):  # beyond the range of half: infinite
        straight[..., :-1] = np.divide(colour, alpha, out=colour, where=alpha > 0)
    return straight


def _orientation(spec: ImageSpec) -> int:
    orientation = int(spec.get_int_attribute("Orientation", 1))
    return orientation if 1 <= orientation <= 8 else 1


def _icc_profile(spec: ImageSpec) -> bytes | None:
    profile = attribute_of(spec, "ICCProfile")
    return np.asarray(profile, np.uint8).tobytes() if isinstance(profile, np.ndarray | tuple) else None


def _capture_metadata(spec: ImageSpec) -> dict[str, Value]:
    """The known capture attributes that hold something sound."""
    found = {name: sound(name, attribute_of(spec, name)) for name in CAPTURE_NAMES}
    return {name: value for name, value in found.items() if value is not None}
