"""Pictures as the bytes of a JPEG or PNG file, made in memory.

The encoders never meet the disk: on a full one libjpeg ends the whole process and libpng says nothing.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import cv2
from numpy.typing import NDArray

from fullsphere.model.errors import OutputError

_JPEG_QUALITY = 95
_PNG_COMPRESSION = 4  # a third of the time of level 6, for four per cent more bytes
_XMP_MARK = b"http://ns.adobe.com/xap/1.0/\x00"
_ICC_MARK = b"ICC_PROFILE\x00"
_LARGEST_SEGMENT = 65533  # a JPEG segment's length is 16 bits and counts itself


def encoded_jpeg(bgr: NDArray[Any], xmp: bytes, icc_profile: bytes | None = None) -> list[bytes | memoryview]:
    """A JPEG file, in pieces, of uint8 pixels (h, w, 1) or (h, w, 3) in the order blue, green, red."""
    full_colour = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    data = _encoded(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *full_colour])
    (length_of_jfif,) = struct.unpack(">H", data[4:6])  # the JFIF segment, which has to stay the first
    start = 4 + length_of_jfif
    pieces = [bytes(data[:start]), _segment(0xE1, _XMP_MARK + xmp)]
    pieces += [_segment(0xE2, part) for part in _icc_parts(icc_profile or b"")]
    return [*pieces, data[start:]]


def encoded_png(bgr: NDArray[Any], xmp: bytes, icc_profile: bytes | None = None) -> list[bytes | memoryview]:
    """A PNG file, in pieces, of uint8 or uint16 pixels (h, w, 1, 3 or 4) in the order blue, green, red, alpha."""
    data = _encoded(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION])
    start = 8 + 25  # the signature and IHDR
    pieces = [bytes(data[:start])]
    if icc_profile:
        pieces.append(_chunk(b"iCCP", b"ICC profile\x00\x00" + zlib.compress(icc_profile)))
    pieces.append(_chunk(b"iTXt", b"XML:com.adobe.xmp\x00\x00\x00\x00\x00" + xmp))
    return [*pieces, data[start:]]


def _encoded(ending: str, bgr: NDArray[Any], options: list[int]) -> memoryview:
    try:
        done, data = cv2.imencode(ending, bgr, options)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError from error
        raise OutputError(f"the picture cannot be encoded as {ending}: {error.err}") from error
    if not done:
        raise OutputError(f"the picture cannot be encoded as {ending}")
    encoded: memoryview = data.data.cast("B")
    return encoded


def _segment(marker: int, content: bytes) -> bytes:
    if len(content) > _LARGEST_SEGMENT:
        raise OutputError(f"metadata of {len(content)} bytes do not fit into a JPEG file; write a TIFF or PNG")
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def _icc_parts(profile: bytes) -> Iterator[bytes]:
    room = _LARGEST_SEGMENT - len(_ICC_MARK) - 2
    count = -(-len(profile) // room)
    if count > 255:
        raise OutputError(f"a colour profile of {len(profile)} bytes does not fit into a JPEG file; write a TIFF")
    for index in range(count):
        yield _ICC_MARK + bytes((index + 1, count)) + profile[index * room : (index + 1) * room]


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
