"""A picture file in tiles, written out of core: a band of rows at a time, whatever the size of the picture."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fullsphere.model.errors import OutputError
from fullsphere.model.image_library import ImageOutput, ImageSpec, fault_of, library_fault, name_for_library, one_line

TILE_SIDE = 256
"""Pixels along the side of a tile: a viewer that wants a window reads little more than the window."""


class TiledFile:
    """A TIFF or OpenEXR file in square tiles, written from the top in bands of rows, each as high as a tile.

    Every method raises OutputError if the library reports a fault; it reports some only after the file is closed.
    """

    def __init__(self, path: Path, name: Path, kind: str, spec: ImageSpec) -> None:
        """Open the file `name`, which exists, as a `kind` ("tiff", "openexr"); faults are reported of `path`."""
        self._path, self._width = path, spec.width
        spec.tile_width = spec.tile_height = TILE_SIDE
        self._handle = os.open(name, os.O_RDWR)  # by which a folder whose name is not UTF-8 can be reached
        output = ImageOutput.create(kind)
        if output is None:
            os.close(self._handle)
            raise OutputError(f"{path}: cannot be written (no {kind} in this library: {one_line(library_fault())})")
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
        fault_of(self._output)
        library_fault()
        os.close(self._handle)

    def _require(self, done: bool) -> None:
        fault = fault_of(self._output)
        if fault or not done:
            raise OutputError(f"{self._path}: cannot be written ({one_line(fault)})")
