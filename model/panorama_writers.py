"""The writers behind `panorama_file`: each takes rows from the top, finishes its file, and reads it back."""

from __future__ import annotations

import abc
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError, OutputError
from fullsphere.model.files import output_errors
from fullsphere.model.image_library import opened, read_rows
from fullsphere.model.picture_metadata import Attributes
from fullsphere.model.tiled_tiff import TILE_SIDE, TiledTiff

Rows = NDArray[Any]
Shape = tuple[int, int, int]
Encoder = Callable[[Rows, bytes, bytes | None], list[bytes | memoryview]]

_ROWS_READ_BACK = 64
_LARGEST_MEAN_ERROR = 16  # codes; JPEG at quality 95 stays below 6 even on white noise, a broken picture does not


class PanoramaWriter(abc.ABC):
    """Takes the rows of a panorama from the top.

    Attributes
    ----------
    shape, dtype
        (h, w, c) and type of the samples of the whole.
    """

    def __init__(self, path: Path, temporary: Path, shape: Shape, dtype: np.dtype[Any]) -> None:
        """Write to `temporary` what is to become `path`, the name in all messages."""
        self.shape, self.dtype = shape, dtype
        self._path, self._temporary = path, temporary
        self._end = 0

    def write_rows(self, y0: int, rows: Rows) -> None:
        """Write rows (n, w, c) at `y0`, which is where the rows before ended; their type is the panorama's.

        Raises
        ------
        ValueError
            If the rows do not continue the picture, or have another shape or type.
        OutputError
            If they cannot be written.
        """
        if y0 != self._end or y0 + len(rows) > self.shape[0]:
            raise ValueError(f"rows {y0} to {y0 + len(rows)} do not continue {self._end} of {self.shape[0]} rows")
        if rows.shape[1:] != self.shape[1:] or rows.dtype != self.dtype:
            raise ValueError(f"rows of {rows.shape[1:]} {rows.dtype}, not {self.shape[1:]} {self.dtype}")
        self._take(y0, rows)
        self._end += len(rows)

    def finish(self) -> None:
        """Complete the file; ValueError if rows are missing, OutputError if it cannot be written."""
        if self._end != self.shape[0]:
            raise ValueError(f"{self._path}: only {self._end} of {self.shape[0]} rows were written")
        self._complete()

    def check(self) -> None:
        """Read a sample of the finished file back; OutputError if it is not what was written."""
        try:
            self._check()
        except InputError as error:
            raise OutputError(f"{self._path}: does not read back after writing: {error}") from error

    def close(self) -> None:  # noqa: B027  (a writer without anything to let go of is one)
        """Let go of the file, finished or not."""

    @abc.abstractmethod
    def _take(self, y0: int, rows: Rows) -> None: ...

    @abc.abstractmethod
    def _complete(self) -> None: ...

    @abc.abstractmethod
    def _check(self) -> None: ...

    def _read_back(self, y0: int, y1: int, channels: int) -> Rows:
        with opened(self._temporary) as (reader, spec):
            shape, samples = (spec.height, spec.width, spec.nchannels), str(spec.format).replace("float", "float32")
            if shape != (*self.shape[:2], channels) or samples != self.dtype.name:
                raise OutputError(f"{self._path}: reads back as {shape} {samples}, not {self.shape} {self.dtype}")
            return read_rows(self._temporary, reader, spec, y0, y1)

    def _refuse_difference(self, same: bool) -> None:
        if not same:
            raise OutputError(f"{self._path}: does not read back as what was written; is the disk sound?")


class TiffWriter(PanoramaWriter):
    """A tiled TIFF, out of core: one band of tiles is in memory."""

    def __init__(
        self,
        path: Path,
        temporary: Path,
        shape: Shape,
        dtype: np.dtype[Any],
        attributes: Attributes,
        icc_profile: bytes | None,
    ) -> None:
        """As the base; with metadata and the colour profile."""
        super().__init__(path, temporary, shape, dtype)
        self._tiff = TiledTiff(path, temporary, shape, dtype, attributes, icc_profile)
        self._band = np.empty((min(TILE_SIDE, shape[0]), *shape[1:]), dtype)
        last = (shape[0] - 1) // TILE_SIDE
        self._sums = dict.fromkeys(TILE_SIDE * band for band in (0, last // 2, last))  # bands that are read back

    def close(self) -> None:
        self._tiff.release()

    def _take(self, y0: int, rows: Rows) -> None:
        while len(rows):
            start = y0 % TILE_SIDE
            part = rows[: TILE_SIDE - start]
            self._band[start : start + len(part)] = part
            y0, rows = y0 + len(part), rows[len(part) :]
            if y0 % TILE_SIDE == 0 or y0 == self.shape[0]:
                self._write_band(y0 - start - len(part), self._band[: start + len(part)])

    def _write_band(self, y0: int, band: Rows) -> None:
        self._tiff.write_band(y0, band)
        if y0 in self._sums:
            self._sums[y0] = zlib.crc32(band.data)

    def _complete(self) -> None:
        self._tiff.close()

    def _check(self) -> None:
        for y0, written in self._sums.items():
            band = self._read_back(y0, min(y0 + TILE_SIDE, self.shape[0]), self.shape[2])
            self._refuse_difference(zlib.crc32(np.ascontiguousarray(band).data) == written)


class EncodedWriter(PanoramaWriter):
    """A JPEG or PNG: collected in the encoder's order of channels, encoded in memory, written in one go."""

    def __init__(
        self,
        path: Path,
        temporary: Path,
        shape: Shape,
        dtype: np.dtype[Any],
        encode: Encoder,
        xmp: bytes,
        icc_profile: bytes | None,
        *,
        lossless: bool,
    ) -> None:
        """As the base; with the encoder, and the metadata that it sets in.  The lossy one (JPEG) drops alpha."""
        super().__init__(path, temporary, shape, dtype)
        self._encode, self._xmp, self._icc_profile, self._lossless = encode, xmp, icc_profile, lossless
        channels = shape[2] if lossless else min(shape[2], 3)
        self._order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
        self._canvas = np.empty((*shape[:2], channels), dtype)

    def _take(self, y0: int, rows: Rows) -> None:
        self._canvas[y0 : y0 + len(rows)] = rows[..., self._order]

    def _complete(self) -> None:
        pieces = self._encode(self._canvas, self._xmp, self._icc_profile)
        with output_errors(self._path), self._temporary.open("wb") as file:
            file.writelines(pieces)
        self._crc = _crc_of(pieces)

    def _check(self) -> None:
        with output_errors(self._path), self._temporary.open("rb") as file:
            self._refuse_difference(_crc_of(iter(lambda: file.read(1 << 20), b"")) == self._crc)
        rows = min(_ROWS_READ_BACK, self.shape[0])
        found = self._read_back(0, rows, len(self._order))
        error = np.abs(found[..., self._order].astype(np.int32) - self._canvas[:rows])
        self._refuse_difference(bool(error.mean() <= (0 if self._lossless else _LARGEST_MEAN_ERROR)))


def _crc_of(pieces: Iterable[bytes | memoryview]) -> int:
    crc = 0
    for piece in pieces:
        crc = zlib.crc32(piece, crc)
    return crc
