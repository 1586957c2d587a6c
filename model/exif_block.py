"""EXIF as JPEG and PNG files hold it: a small TIFF file of tags without a picture (CIPA DC-008, section 4.6).

OpenImageIO writes EXIF into a TIFF by itself; JPEG and PNG files are encoded in memory by OpenCV, which writes none.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from fractions import Fraction
from typing import NamedTuple

from fullsphere.model.picture_metadata import Attributes, Value


class _Tag(NamedTuple):
    number: int
    kind: int
    numbers: int = 1


_ASCII, _SHORT, _LONG, _RATIONAL, _BYTE, _UNDEFINED, _SIGNED_RATIONAL = 2, 3, 4, 5, 1, 7, 10
_EXIF_POINTER, _GPS_POINTER = 34665, 34853

_MAIN = {
    "Make": _Tag(271, _ASCII),
    "Model": _Tag(272, _ASCII),
    "Orientation": _Tag(274, _SHORT),
    "Software": _Tag(305, _ASCII),
    "DateTime": _Tag(306, _ASCII),
    "Artist": _Tag(315, _ASCII),
    "Copyright": _Tag(33432, _ASCII),
}
_EXIF = {
    "ExposureTime": _Tag(33434, _RATIONAL),
    "FNumber": _Tag(33437, _RATIONAL),
    "Exif:PhotographicSensitivity": _Tag(34855, _SHORT),
    "Exif:DateTimeOriginal": _Tag(36867, _ASCII),
    "Exif:ExposureBiasValue": _Tag(37380, _SIGNED_RATIONAL),
    "Exif:FocalLength": _Tag(37386, _RATIONAL),
    "Exif:LensModel": _Tag(42036, _ASCII),
}
_GPS = {
    "GPS:LatitudeRef": _Tag(1, _ASCII),
    "GPS:Latitude": _Tag(2, _RATIONAL, 3),
    "GPS:LongitudeRef": _Tag(3, _ASCII),
    "GPS:Longitude": _Tag(4, _RATIONAL, 3),
    "GPS:AltitudeRef": _Tag(5, _BYTE),
    "GPS:Altitude": _Tag(6, _RATIONAL),
    "GPS:TimeStamp": _Tag(7, _RATIONAL, 3),
    "GPS:ImgDirectionRef": _Tag(16, _ASCII),
    "GPS:ImgDirection": _Tag(17, _RATIONAL),
    "GPS:DateStamp": _Tag(29, _ASCII),
}
_EXIF_VERSION = (36864, _UNDEFINED, b"0232")
_GPS_VERSION = (0, _BYTE, bytes((2, 3, 0, 0)))

_Entry = tuple[int, int, bytes]  # number, kind, content


def exif_block(attributes: Attributes) -> bytes:
    """The tags of the attributes that EXIF has a place for; b"" if there are none.

    Values that the place does not hold (a negative exposure time, a number that is not finite) are left out.
    """
    main, exif, gps = (_entries(attributes, tags) for tags in (_MAIN, _EXIF, _GPS))
    if not (main or exif or gps):
        return b""
    exif.append(_EXIF_VERSION)
    if gps:
        gps.append(_GPS_VERSION)
    pointers = [(_EXIF_POINTER, _LONG, bytes(4))] + ([(_GPS_POINTER, _LONG, bytes(4))] if gps else [])
    exif_start = 8 + len(_directory(main + pointers, 0))
    gps_start = exif_start + len(_directory(exif, 0))
    main.append((_EXIF_POINTER, _LONG, struct.pack(">I", exif_start)))
    if gps:
        main.append((_GPS_POINTER, _LONG, struct.pack(">I", gps_start)))
    block = b"MM\x00*" + struct.pack(">I", 8) + _directory(main, 8) + _directory(exif, exif_start)
    return block + (_directory(gps, gps_start) if gps else b"")


def _entries(attributes: Attributes, tags: dict[str, _Tag]) -> list[_Entry]:
    found = ((tag, _content(attributes[name], tag)) for name, tag in tags.items() if name in attributes)
    return [(tag.number, tag.kind, content) for tag, content in found if content is not None]


def _content(value: Value, tag: _Tag) -> bytes | None:
    """The value as the tag holds it; None if it cannot."""
    if tag.kind == _ASCII:
        return str(value).replace("\x00", "").encode("utf-8", "replace") + b"\x00"
    numbers = value if isinstance(value, tuple) else (value,)
    if len(numbers) != tag.numbers:
        return None
    try:
        if tag.kind == _BYTE:
            return struct.pack(">B", *(int(n) for n in numbers))
        if tag.kind == _SHORT:
            return struct.pack(">H", *(int(n) for n in numbers))
        layout = ">ii" if tag.kind == _SIGNED_RATIONAL else ">II"
        return b"".join(struct.pack(layout, *_ratio(float(n))) for n in numbers)
    except (ValueError, OverflowError, struct.error):
        return None


def _ratio(value: float) -> tuple[int, int]:
    """A fraction of small numbers near the value: 1/30 for the float32 nearest to it."""
    fraction = Fraction(value).limit_denominator(10_000)
    if abs(float(fraction) - value) > 1e-4 * abs(value):
        fraction = Fraction(value).limit_denominator(100_000_000)
    return fraction.numerator, fraction.denominator


def _directory(entries: Iterable[_Entry], start: int) -> bytes:
    """An image file directory that stands at `start`, and after it the contents that are longer than four bytes."""
    in_order = sorted(entries)
    place = start + 2 + 12 * len(in_order) + 4
    table, body = struct.pack(">H", len(in_order)), b""
    sizes = {_SHORT: 2, _LONG: 4, _RATIONAL: 8, _SIGNED_RATIONAL: 8}
    for number, kind, content in in_order:
        table += struct.pack(">HHI", number, kind, len(content) // sizes.get(kind, 1))
        if len(content) <= 4:
            table += content.ljust(4, b"\x00")
        else:
            table += struct.pack(">I", place + len(body))
            body += content + bytes(len(content) % 2)
    return table + bytes(4) + body
