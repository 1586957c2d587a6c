"""The writers behind `panorama_file`: each takes rows from the top, finishes its file, and reads it back."""

from __future__ import annotations

import abc
import contextlib
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.encoded_picture import Pieces
from fullsphere.model.errors import InputError, OutputError
from fullsphere.model.files import output_errors
from fullsphere.model.image_library import ImageSpec, opened, read_rows
from fullsphere.model.picture_stream import STRIP_ROWS, PictureStream
from fullsphere.model.tiled_file import TILE_SIDE, TiledFile

Rows = NDArray[Any]
Shape = tuple[int, int, int]

_ROWS_READ_BACK = 64
_DTYPES = {"uint8": "uint8", "uint16": "uint16", "half": "float16", "float": "float32"}
_SAMPLED = 16  # of the bands of a lossy file every so many rows and columns are kept, to compare
_LARGEST_LOSS = 0.5  # of the mean; DWAB loses a tenth of white noise, a broken picture has nothing in common
_ORDER_WITH_ALPHA = {1: [0], 2: [0, 0, 0, 1], 3: [2, 1, 0], 4: [2, 1, 0, 3]}  # the encoders know no grey with alpha
_ORDER_WITHOUT = {1: [0], 2: [0], 3: [2, 1, 0], 4: [2, 1, 0]}


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

    @property
    def temporary(self) -> Path:
        """The file that is written until it gets its name."""
        return self._temporary

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
            shape, samples = (spec.height, spec.width, spec.nchannels), _DTYPES.get(str(spec.format), "")
            if shape != (*self.shape[:2], channels) or samples != self.dtype.name:
                raise OutputError(f"{self._path}: reads back as {shape} {samples}, not {self.shape} {self.dtype}")
            return read_rows(self._temporary, reader, spec, y0, y1)

    def _refuse_difference(self, same: bool) -> None:
        if not same:
            raise OutputError(f"{self._path}: does not read back as what was written; is the disk sound?")


class TiledWriter(PanoramaWriter):
    """A tiled file, out of core: at most one band of tiles is in memory, and none where rows come in whole bands."""

    def __init__(
        self,
        path: Path,
        temporary: Path,
        shape: Shape,
        dtype: np.dtype[Any],
        kind: str,
        spec: ImageSpec,
        *,
        stored: Callable[[Rows], Rows] = lambda rows: rows,
        lossy: bool = False,
    ) -> None:
        """As the base; a file of that kind and header, of rows as `stored` makes them."""
        super().__init__(path, temporary, shape, dtype)
        self._file = TiledFile(path, temporary, kind, spec)
        self._stored, self._lossy = stored, lossy
        self._band: Rows | None = None
        last = (shape[0] - 1) // TILE_SIDE
        self._read_again = {TILE_SIDE * band for band in (0, last // 2, last)}
        self._sums: dict[int, int] = {}
        self._samples: dict[int, Rows] = {}

    def close(self) -> None:
        self._file.release()

    def _take(self, y0: int, rows: Rows) -> None:
        while len(rows):
            start = y0 % TILE_SIDE
            part = rows[: TILE_SIDE - start]
            end = y0 + len(part)
            complete = end % TILE_SIDE == 0 or end == self.shape[0]
            if start == 0 and complete:
                self._write_band(y0, np.ascontiguousarray(part))
            else:
                if self._band is None:
                    self._band = np.empty((min(TILE_SIDE, self.shape[0]), *self.shape[1:]), self.dtype)
                self._band[start : start + len(part)] = part
                if complete:
                    self._write_band(y0 - start, self._band[: start + len(part)])
            y0, rows = end, rows[len(part) :]

    def _write_band(self, y0: int, band: Rows) -> None:
        band = self._stored(band)
        self._file.write_band(y0, band)
        if y0 in self._read_again and self._lossy:
            self._samples[y0] = band[::_SAMPLED, ::_SAMPLED].copy()
        elif y0 in self._read_again:
            self._sums[y0] = zlib.crc32(band.data)

    def _complete(self) -> None:
        self._file.close()

    def _check(self) -> None:
        for y0, written in self._sums.items():
            self._refuse_difference(zlib.crc32(np.ascontiguousarray(self._band_read_back(y0)).data) == written)
        for y0, samples in self._samples.items():
            self._refuse_difference(_are_near(self._band_read_back(y0)[::_SAMPLED, ::_SAMPLED], samples))

    def _band_read_back(self, y0: int) -> Rows:
        return self._read_back(y0, min(y0 + TILE_SIDE, self.shape[0]), self.shape[2])


class StreamWriter(PanoramaWriter):
    """A JPEG or PNG: strip after strip encoded in memory and written; no more than a strip is held."""

    def __init__(
        self,
        path: Path,
        temporary: Path,
        shape: Shape,
        dtype: np.dtype[Any],
        stream: PictureStream,
        *,
        largest_mean_error: float,
        alpha: bool,
    ) -> None:
        """As the base; with the encoder, the error that it may make, and whether it keeps alpha."""
        super().__init__(path, temporary, shape, dtype)
        self._stream, self._largest_mean_error = stream, largest_mean_error
        self._order = (_ORDER_WITH_ALPHA if alpha else _ORDER_WITHOUT)[shape[2]]
        self._strip = np.empty((min(STRIP_ROWS, shape[0]), shape[1], len(self._order)), dtype)
        self._first = np.empty((min(_ROWS_READ_BACK, shape[0]), *self._strip.shape[1:]), dtype)
        self._crc = 0
        with output_errors(path):
            self._file = temporary.open("wb")

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()

    def _take(self, y0: int, rows: Rows) -> None:
        while len(rows):
            start = y0 % STRIP_ROWS
            part = rows[: STRIP_ROWS - start]
            end = y0 + len(part)
            self._strip[start : start + len(part)] = part[..., self._order]
            if end % STRIP_ROWS == 0 or end == self.shape[0]:
                if end <= STRIP_ROWS:
                    self._first[:] = self._strip[: len(self._first)]
                self._write(self._stream.strip(self._strip[: start + len(part)]))
            y0, rows = end, rows[len(part) :]

    def _complete(self) -> None:
        self._write(self._stream.end())
        with output_errors(self._path):
            self._file.close()

    def _write(self, pieces: Pieces) -> None:
        with output_errors(self._path):
            self._file.writelines(pieces)
        self._crc = _crc_of(pieces, self._crc)

    def _check(self) -> None:
        with output_errors(self._path), self._temporary.open("rb") as file:
            self._refuse_difference(_crc_of(iter(lambda: file.read(1 << 20), b"")) == self._crc)
        channels = self._first.shape[2]
        found = self._read_back(0, len(self._first), channels)[..., _ORDER_WITH_ALPHA[channels]]
        error = np.abs(found.astype(np.int32) - self._first)
        self._refuse_difference(bool(error.mean() <= self._largest_mean_error))


def _are_near(found: Rows, written: Rows) -> bool:
    """Whether samples differ by what lossy compression changes, on the mean; those that are not finite aside."""
    finite = np.isfinite(found) & np.isfinite(written)
    if not finite.any():
        return True
    found, written = found[finite].astype(np.float64), written[finite].astype(np.float64)
    return bool(np.abs(found - written).mean() <= _LARGEST_LOSS * np.abs(written).mean())


def _crc_of(pieces: Iterable[bytes | memoryview], crc: int = 0) -> int:
    for piece in pieces:
        crc = zlib.crc32(piece, crc)
    return crc
