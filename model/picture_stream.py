"""JPEG and PNG files made strip by strip, in memory that the width decides alone.

A JPEG is joined of strips that are encoded apart: with a restart marker after every row of blocks nothing of what is
encoded depends on what came before (ITU-T T.81, section E.1.4).  A PNG is one stream of filtered rows.  The encoders
never meet the disk.
"""

from __future__ import annotations

import abc
import struct
import zlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.encoded_picture import Metadata, Pieces, encoded, jpeg_segments, png_chunk, png_metadata
from fullsphere.model.errors import OutputError

STRIP_ROWS = 256
"""A multiple of 64: eight rows of blocks, after which the numbers of a JPEG's restart markers begin again."""

_BLOCK = 8
_SOF, _SOS, _LAST_RESTART = 0xC0, 0xDA, b"\xff\xd7"
_NO_FILTER, _SUB, _UP = 0, 1, 2
_IDAT_BYTES = 1 << 20


class PictureStream(abc.ABC):
    """Takes strips (n, w, c) of a picture from the top, STRIP_ROWS high but for the last one, and gives a file."""

    @abc.abstractmethod
    def strip(self, rows: NDArray[Any]) -> Pieces:
        """The next bytes of the file."""

    @abc.abstractmethod
    def end(self) -> Pieces:
        """The last bytes of the file."""


class JpegStream(PictureStream):
    """A JPEG of uint8 pixels, grey or in the order blue, green, red.

    Parameters
    ----------
    height
        Of the whole picture.
    metadata
        What is set into it.
    quality
        1 to 100.
    """

    def __init__(self, height: int, metadata: Metadata, quality: int) -> None:
        self._height, self._metadata, self._quality = height, metadata, quality
        self._tables = b""

    def strip(self, rows: NDArray[Any]) -> Pieces:
        full_colour = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        restarts = [cv2.IMWRITE_JPEG_RST_INTERVAL, -(-rows.shape[1] // _BLOCK)]
        data = encoded(".jpg", rows, [cv2.IMWRITE_JPEG_QUALITY, self._quality, *full_colour, *restarts])
        scan, height_at = _parts_of_jpeg(data)
        head = bytearray(data[:scan])
        head[height_at : height_at + 2] = struct.pack(">H", self._height)
        body = data[scan:-2]  # without the mark of the end
        if self._tables:
            if bytes(head) != self._tables:
                raise OutputError("the strips of a JPEG were encoded in different ways; write a .tif")
            return [_LAST_RESTART, body]
        self._tables = bytes(head)
        (length_of_jfif,) = struct.unpack(">H", head[4:6])  # the JFIF segment, which has to stay the first
        start = 4 + length_of_jfif
        return [bytes(head[:start]), *jpeg_segments(self._metadata), bytes(head[start:]), body]

    def end(self) -> Pieces:
        return [b"\xff\xd9"]


class PngStream(PictureStream):
    """A PNG of uint8 or uint16 pixels, grey or in the order blue, green, red, alpha.

    Parameters
    ----------
    size
        Width and height of the whole picture.
    metadata
        What is set into it.
    level
        Of zlib.
    """

    def __init__(self, size: tuple[int, int], metadata: Metadata, level: int) -> None:
        self._size, self._metadata = size, metadata
        self._deflate = zlib.compressobj(level)
        self._level = level
        self._above: NDArray[np.uint8] | None = None

    def strip(self, rows: NDArray[Any]) -> Pieces:
        pieces = self._head(rows) if self._above is None else []
        pixel_bytes = rows.shape[2] * rows.dtype.itemsize
        ordered = rows[..., [2, 1, 0, 3][: rows.shape[2]]] if rows.shape[2] > 1 else rows
        raw = np.ascontiguousarray(ordered, rows.dtype.newbyteorder(">")).view(np.uint8).reshape(len(rows), -1)
        above = np.zeros(raw.shape[1], np.uint8) if self._above is None else self._above
        self._above = raw[-1].copy()
        filtered = _unfiltered(raw) if self._level == 0 else _filtered(raw, above, pixel_bytes)
        return [*pieces, *_idat(self._deflate.compress(filtered.data))]

    def end(self) -> Pieces:
        return [*_idat(self._deflate.flush()), png_chunk(b"IEND", b"")]

    def _head(self, rows: NDArray[Any]) -> Pieces:
        kind = {1: 0, 3: 2, 4: 6}[rows.shape[2]]
        header = struct.pack(">IIBBBBB", *self._size, 8 * rows.dtype.itemsize, kind, 0, 0, 0)
        return [b"\x89PNG\r\n\x1a\n", png_chunk(b"IHDR", header), *png_metadata(self._metadata)]


def _parts_of_jpeg(data: memoryview) -> tuple[int, int]:
    """Where the scan's data begin, and where the height stands."""
    at, height_at = 2, 0
    while at + 4 <= len(data):
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == _SOF:
            height_at = at + 5
        at += 2 + length
        if marker == _SOS and height_at:
            return at, height_at
    raise OutputError("the picture cannot be encoded as a JPEG of strips; write a .tif")


def _unfiltered(raw: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.concatenate([np.full((len(raw), 1), _NO_FILTER, np.uint8), raw], axis=1)


def _filtered(raw: NDArray[np.uint8], above: NDArray[np.uint8], pixel_bytes: int) -> NDArray[np.uint8]:
    """Each row as its difference from what is left of it, or from the row above: whichever is smaller in all."""
    sub, up = raw.copy(), raw.copy()
    sub[:, pixel_bytes:] -= raw[:, :-pixel_bytes]
    up[1:] -= raw[:-1]
    up[0] -= above
    with_type = np.empty((len(raw), 1 + raw.shape[1]), np.uint8)
    is_up = _magnitude(up) < _magnitude(sub)
    with_type[:, 0] = np.where(is_up, _UP, _SUB)
    with_type[:, 1:] = np.where(is_up[:, None], up, sub)
    return with_type


def _magnitude(differences: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The sum of each row's differences, which wrap, without their signs."""
    total: NDArray[np.int64] = np.minimum(differences, -differences).sum(axis=1, dtype=np.int64)
    return total


def _idat(data: bytes) -> Pieces:
    return [png_chunk(b"IDAT", data[k : k + _IDAT_BYTES]) for k in range(0, len(data), _IDAT_BYTES)]
