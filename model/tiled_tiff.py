"""TIFF files in tiles, written out of core: a band of rows at a time, whatever the size of the picture."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import OutputError
from fullsphere.model.image_library import ImageOutput, ImageSpec, byte_array, library_fault, name_for_library, one_line

TILE_SIDE = 256
"""Pixels along the side of a tile: a viewer that wants a window reads little more than the window."""


class TiledTiff:
    """A TIFF file in square tiles, written from the top in bands of rows, each as high as a tile.

    Every method raises OutputError if the library reports a fault; it reports some only after the file is closed.
    """

    def __init__(
        self,
        path: Path,
        name: Path,
        shape: tuple[int, int, int],
        dtype: np.dtype[Any],
        attributes: Mapping[str, str | int | float | bool],
        icc_profile: bytes | None,
    ) -> None:
        """Open the file `name`, which exists, for (h, w, c) pixels; faults are reported of `path`."""
        self._path = path
        self._handle = os.open(name, os.O_RDWR)  # by which a folder whose name is not UTF-8 can be reached
        self._height, self._width, channels = shape
        spec = ImageSpec(self._width, self._height, channels, str(dtype).replace("float32", "float"))
        spec.tile_width = spec.tile_height = TILE_SIDE
        spec.attribute("compression", "zip")
        if channels == 4:
            spec.alpha_channel = 3
            spec.attribute("oiio:UnassociatedAlpha", 1)
        # Without any Exif attribute the library reports a fault of a sound file; without DateTime it writes the time of
        # day, and the same panorama would never be the same bytes.
        spec.attribute("Exif:ColorSpace", 1 if dtype.kind == "u" else 65535)
        spec.attribute("DateTime", "")
        for key, value in attributes.items():
            spec.attribute(key, str(value) if isinstance(value, bool) else value)
        if icc_profile:
            spec.attribute("ICCProfile", *byte_array(icc_profile))
        output = ImageOutput.create("tiff")
        if output is None:
            os.close(self._handle)
            raise OutputError(f"{path}: cannot be written (this OpenImageIO has no TIFF: {one_line(library_fault())})")
        self._output = output
        try:
            self._require(self._output.open(name_for_library(name, self._handle), spec))
        except BaseException:
            self.release()
            raise

    def write_band(self, y0: int, rows: NDArray[Any]) -> None:
        """Write rows (n, w, c) from `y0`, a multiple of TILE_SIDE; n is TILE_SIDE but at the end."""
        self._require(self._output.write_tiles(0, self._width, y0, y0 + len(rows), 0, 1, rows))

    def close(self) -> None:
        """Finish the file."""
        self._require(self._output.close())

    def release(self) -> None:
        """Let go of the file, finished or not; never raises."""
        self._output.close()
        self._output.geterror()
        library_fault()
        os.close(self._handle)

    def _require(self, done: bool) -> None:
        fault = self._output.geterror() or library_fault()
        if fault or not done:
            raise OutputError(f"{self._path}: cannot be written ({one_line(fault)})")
