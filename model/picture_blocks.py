"""The samples of an opened picture in blocks: its own tiles, or bands of whole rows where the file has no tiles.

Decoders of rows go down only: OpenImageIO opens a file again for a row above, some formats without the settings it was
opened with.  Here it is opened again by us.  And they report damage once, when they meet it, and answer grey after it
without a word: here everything below stays refused.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError
from fullsphere.model.image_library import ImageInput, ImageSpec, attribute_of, opened, read_part

_BAND_BYTES = 1 << 24
"""The largest band of rows, unless one row is larger."""

_BAND_ROWS = 64
_DECODED_AT_ONCE = ("webp", "jpeg2000", "jpegxl")  # whole, by the first read
_ROWS_CODED_TOGETHER = {"dwab": 256}  # in an OpenEXR file, where that is more than a band


class PictureBlocks:
    """An opened picture, read in blocks.  Not for several threads at once.

    Attributes
    ----------
    spec
        The header.
    kind
        The format by OpenImageIO's name ("jpeg", "tiff", ...).
    tiled
        Whether a block is a tile of the file; else it is a band of whole rows.
    block_size
        Width and height of a block; those at the right and the lower border are cut off there.
    at_random
        Whether blocks may be read in any order, and by several readers, as fast as in the order of the file.
    """

    def __init__(self, path: Path, by_region: bool, sample_types: dict[str, str]) -> None:
        """Open `path`; InputError as `opened`, and for samples that are no key of `sample_types` (wanted by stored)."""
        self.path = path
        self._by_region, self._sample_types = by_region, sample_types
        self._resources = contextlib.ExitStack()
        self._reader, self.spec = self._open()
        self.kind = str(self._reader.format_name())
        sample_type = sample_types.get(str(self.spec.format))
        if sample_type is None:
            self.close()
            raise InputError(
                f"{path}: has {self.spec.format} samples; export it with 8 or 16 bits or in floating point"
            )
        self.sample_type = sample_type
        self.tiled = self.spec.tile_height > 0
        self.block_size = (
            (self.spec.tile_width, self.spec.tile_height) if self.tiled else (self.spec.width, _band_rows(self.spec))
        )
        self.at_random = self.tiled or self.kind == "openexr"
        self._at_once = self.kind in _DECODED_AT_ONCE
        self._next_row = 0
        self._damage: tuple[int, str] | None = None  # from which row on nothing can be read, and why

    def read(self, left: int, top: int, right: int, bottom: int) -> NDArray[Any]:
        """Samples (bottom - top, right - left, c) of whole blocks: the borders of the rectangle are borders of blocks.

        Raises
        ------
        InputError
            If a part of them is damaged, or the file is no longer the one that was opened.
        """
        if not self.at_random:
            self._go_to(top, bottom)
        try:
            samples = read_part(
                self.path, self._reader, self.spec, (left, top, right, bottom), self.sample_type, self.tiled
            )
        except InputError as error:
            if not self.at_random:
                self._damage = (0 if self._at_once else top, str(error))
                self._next_row = self.spec.height
            raise
        self._next_row = bottom
        return samples

    def opened_again(self) -> PictureBlocks:
        """Another reader of the same picture; InputError if the file is no longer the one that was opened."""
        other = PictureBlocks(self.path, self._by_region, self._sample_types)
        try:
            self._require_same(other.spec, other.kind)
        except BaseException:
            other.close()
            raise
        return other

    def close(self) -> None:
        """Let go of the file."""
        self._resources.close()

    def _open(self) -> tuple[ImageInput, ImageSpec]:
        return self._resources.enter_context(opened(self.path, by_region=self._by_region))

    def _go_to(self, top: int, bottom: int) -> None:
        if self._damage is not None and bottom > self._damage[0]:
            raise InputError(self._damage[1])
        if top >= self._next_row or self._at_once:
            return
        self._resources.close()
        self._reader, spec = self._open()
        self._require_same(spec, self._reader.format_name())
        self._next_row = 0

    def _require_same(self, spec: ImageSpec, kind: str) -> None:
        if _shape(spec) != _shape(self.spec) or kind != self.kind:
            raise InputError(f"{self.path}: was replaced while it was read; start again")


def _band_rows(spec: ImageSpec) -> int:
    """The rows of a band: whole units of the file's coding where they are of sensible size."""
    row_bytes = spec.width * spec.nchannels * np.dtype(np.float32).itemsize
    most = max(1, _BAND_BYTES // row_bytes)
    rows = _ROWS_CODED_TOGETHER.get(str(attribute_of(spec, "compression")), _BAND_ROWS)
    strip = spec.get_int_attribute("tiff:RowsPerStrip")
    if 0 < strip <= rows:
        rows -= rows % strip
    elif rows < strip <= most:
        rows = strip
    return min(rows, most, spec.height)


def _shape(spec: ImageSpec) -> tuple[Any, ...]:
    return spec.width, spec.height, spec.nchannels, str(spec.format), spec.tile_width, spec.tile_height
