"""The only import of OpenImageIO: opening a picture so that nothing odd, hostile or damaged gets further.

OpenImageIO answers errors in three places (a returned None, `geterror` of the object, `geterror` of the module), some
of them with pixels beside; here they all become InputError.
"""

from __future__ import annotations

import os

# OpenImageIO loads every plug-in (machine code) that it finds in the folders of this variable when it meets a name
# that it does not know.  It reads the variable while it is imported.
os.environ.pop("OIIO_LIBRARY_PATH", None)

import contextlib
import re
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
from numpy.typing import NDArray
from OpenImageIO import ImageInput, ImageOutput, ImageSpec, TypeDesc

from fullsphere.model.errors import InputError
from fullsphere.model.files import input_errors

# With three threads and more OpenImageIO compresses the tiles of a TIFF by itself and with zlib, where libtiff alone
# has libdeflate: other bytes, a fifteenth more of them, and three times slower on two cores.  Pictures are read in
# parallel by our own pool.
OpenImageIO.attribute("threads", 1)

__all__ = [
    "MAX_PIXELS",
    "MAX_PIXELS_BY_REGION",
    "ImageInput",
    "ImageOutput",
    "ImageSpec",
    "attribute_of",
    "byte_array",
    "fault_of",
    "library_fault",
    "name_for_library",
    "one_line",
    "opened",
    "read_part",
    "read_rows",
    "set_attribute",
]

MAX_PIXELS = 1 << 30
"""The largest picture that is read whole, 32768 x 32768: far above any camera's, far below what a forged header claims.
"""

MAX_PIXELS_BY_REGION = 1 << 36
"""The largest TIFF or OpenEXR picture that is read by region, 262144 x 262144."""

READABLE = "JPEG, PNG, TIFF, OpenEXR, WebP, JPEG 2000 or JPEG XL"

_SIGNATURES = (
    (b"\xff\xd8\xff", "jpeg"),
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"II*\x00", "tiff"),
    (b"MM\x00*", "tiff"),
    (b"II+\x00", "tiff"),
    (b"MM\x00+", "tiff"),
    (b"v/1\x01", "openexr"),
    (b"\x00\x00\x00\x0cjP  ", "jpeg2000"),
    (b"\xff\x4f\xff\x51", "jpeg2000"),
    (b"\xff\x0a", "jpegxl"),
    (b"\x00\x00\x00\x0cJXL ", "jpegxl"),
)
_RAW_SIGNATURES = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\x00", b"FOVb", b"\x00MRM")
_RAW_ENDING = re.compile(
    r"\.(3fr|arw|cr2|cr3|crw|dcr|dng|erf|fff|gpr|iiq|kdc|mef|mos|mrw|nef|nrw|orf|pef|raf|raw|rw2|rwl|sr2|srf|srw|x3f)"
)
_HEIF_ENDING = re.compile(r"\.(heic|heif|hif|avif)")
_HEIF_BRANDS = frozenset((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"avif", b"avis"))
_READ_BY_REGION = ("tiff", "openexr")
_BYTES_OF_LARGEST = MAX_PIXELS_BY_REGION * 4 * 4  # four channels in floating point
_size_limit = threading.Lock()
_COLOUR_FILTER_ARRAY, _LINEAR_RAW = 32803, 34892  # TIFF photometric interpretations of sensor data


@contextlib.contextmanager
def opened(path: Path, by_region: bool = False) -> Iterator[tuple[ImageInput, ImageSpec]]:
    """Open a picture for reading; give OpenImageIO's reader and the header, with size and kind within our limits.

    Pixels come as stored: not rotated, not multiplied by alpha.

    Raises
    ------
    InputError
        If there is no such file, it is no picture, of a kind that is not read (RAW, HEIC), damaged in its header, or
        claims to be larger than `MAX_PIXELS`; with `by_region`, a TIFF or OpenEXR file than `MAX_PIXELS_BY_REGION`.
    """
    with contextlib.ExitStack() as stack:
        with input_errors(path):
            status = path.stat()
            if stat.S_ISDIR(status.st_mode):
                raise IsADirectoryError
            if not stat.S_ISREG(status.st_mode):
                raise InputError(f"{path}: is no ordinary file")  # a pipe would be waited for without end
            file = stack.enter_context(path.open("rb"))
            head = file.read(32)
        kind = _kind_of(path, head)
        as_stored = ImageSpec()
        as_stored.attribute("oiio:UnassociatedAlpha", 1)
        large = by_region and kind in _READ_BY_REGION
        with _largest_picture() if large else contextlib.nullcontext():
            reader = ImageInput.open(name_for_library(path, file.fileno()), as_stored)
        fault = library_fault()
        if reader is None:
            raise InputError(f"{path}: cannot be opened as {kind.upper()}: {one_line(fault)}")
        stack.callback(_close, reader)
        spec = reader.spec()
        _check_header(path, kind, reader.format_name(), spec, MAX_PIXELS_BY_REGION if large else MAX_PIXELS)
        yield reader, spec


def read_part(
    path: Path, reader: ImageInput, spec: ImageSpec, box: tuple[int, int, int, int], sample_type: str, tiled: bool
) -> NDArray[Any]:
    """The samples (h, w, c) of a box (left, top, right, bottom) of an opened picture; InputError if any is damaged.

    In a tiled file the box's borders are borders of tiles or of the picture; in another it is as wide as the picture.
    """
    left, top, right, bottom = box
    x, y = spec.x, spec.y  # an OpenEXR file's own pixel coordinates need not begin with 0
    if tiled:
        columns, rows = (left + x, right + x), (top + y, bottom + y)
        return _sound(path, reader, reader.read_tiles(*columns, *rows, 0, 1, 0, spec.nchannels, sample_type))
    return _sound(path, reader, reader.read_scanlines(top + y, bottom + y, 0, 0, spec.nchannels, sample_type))


def read_rows(path: Path, reader: ImageInput, spec: ImageSpec, y0: int, y1: int) -> NDArray[Any]:
    """Rows y0 to y1 of an opened picture in its own sample type; in a tiled file y0 starts a tile and y1 ends one."""
    return read_part(path, reader, spec, (0, y0, spec.width, y1), str(spec.format), spec.tile_height > 0)


def _sound(path: Path, reader: ImageInput, pixels: NDArray[Any] | None) -> NDArray[Any]:
    """The pixels, unless there is an error beside them: a JPEG that ends early comes as a full array, part grey."""
    fault = fault_of(reader)
    if pixels is None or fault:
        raise InputError(f"{path}: is damaged or cut short ({one_line(fault)}); copy it again from the camera")
    return pixels


def byte_array(content: bytes) -> tuple[TypeDesc, NDArray[np.uint8]]:
    """Bytes (a colour profile) as the type and value of an attribute."""
    kind = TypeDesc(OpenImageIO.UINT8, OpenImageIO.SCALAR, OpenImageIO.NOSEMANTICS, len(content))
    return kind, np.frombuffer(content, np.uint8)


def set_attribute(spec: ImageSpec, name: str, value: str | int | float | bool | tuple[float, ...]) -> None:
    """Note metadata in a header; truth as a text, and a tuple (degrees, minutes, seconds) as floats."""
    if isinstance(value, tuple):
        kind = TypeDesc(OpenImageIO.FLOAT, OpenImageIO.SCALAR, OpenImageIO.NOSEMANTICS, len(value))
        spec.attribute(name, kind, value)
    else:
        spec.attribute(name, str(value) if isinstance(value, bool) else value)


def library_fault() -> str:
    """The library's pending error text, "" if none; what is never asked for is printed when the program ends."""
    return _text(OpenImageIO.geterror)


def fault_of(file: ImageInput | ImageOutput) -> str:
    """The pending error text of a file, or else of the library; "" if none."""
    return _text(file.geterror) or library_fault()


def attribute_of(spec: ImageSpec, name: str) -> object:
    """Metadata from a header, texts that are no UTF-8 taken for Latin-1; None if there is none of this name."""
    value = spec.getattribute(name)
    if not isinstance(value, str):
        return value
    content = value.encode("utf-8", "surrogateescape")
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _text(ask: Callable[[], str]) -> str:
    """A text that may quote the bytes of a damaged file."""
    try:
        return str(ask())
    except UnicodeDecodeError as error:
        return error.object.decode("utf-8", "replace")


def name_for_library(path: Path, handle: int) -> str:
    """A name by which OpenImageIO, which takes UTF-8 only, can open `path`, of which `handle` is an open descriptor."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        by_handle = Path(f"/proc/self/fd/{handle}")
        if by_handle.exists():
            return str(by_handle)
        raise InputError(f"{path}: the name is not UTF-8; rename the file") from None
    return str(path)


def _kind_of(path: Path, head: bytes) -> str:
    """The format by the file's first bytes; InputError, with what to do, if it is none that is read."""
    ending = path.suffix.lower()
    if not head:
        raise InputError(f"{path}: is empty; copy it again from the camera")
    is_raw = head.startswith(_RAW_SIGNATURES) or head[4:11] == b"ftypcrx" or head[8:10] == b"CR"
    kind = next((name for signature, name in _SIGNATURES if head.startswith(signature)), None)
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        kind = "webp"
    if is_raw or (_RAW_ENDING.fullmatch(ending) and kind in (None, "tiff")):  # most RAW files are TIFF inside, with a
        # thumbnail in the place of the picture
        raise InputError(f"{path}: is a RAW file; convert it to 16-bit TIFF or to JPEG with a raw developer first")
    if (head[4:8] == b"ftyp" and head[8:12] in _HEIF_BRANDS) or (_HEIF_ENDING.fullmatch(ending) and kind is None):
        raise InputError(f"{path}: is a HEIC, HEIF or AVIF file; convert it to 16-bit TIFF or to JPEG first")
    if kind is None:
        raise InputError(f"{path}: is not a picture that can be read; give {READABLE}")
    return kind


@contextlib.contextmanager
def _largest_picture() -> Iterator[None]:
    """Let the library open the largest picture that is read by region, while the block runs.

    Its own limit is the memory of the machine, and the same for all pictures: other formats decode while they open.
    """
    with _size_limit:
        before = OpenImageIO.get_int_attribute("limits:imagesize_MB")
        OpenImageIO.attribute("limits:imagesize_MB", _BYTES_OF_LARGEST >> 20)
        try:
            yield
        finally:
            OpenImageIO.attribute("limits:imagesize_MB", before)


def _check_header(path: Path, kind: str, opened_as: str, spec: ImageSpec, most_pixels: int) -> None:
    if opened_as != kind:
        raise InputError(f"{path}: begins as {kind.upper()} but only opens as {opened_as}; export it again")
    if spec.width < 1 or spec.height < 1 or spec.depth > 1 or spec.deep:
        raise InputError(f"{path}: is not a flat picture ({spec.width} x {spec.height} x {spec.depth})")
    if spec.width * spec.height > most_pixels:
        raise InputError(
            f"{path}: claims {spec.width} x {spec.height} pixels, more than the {most_pixels} that are read; "
            "the file is damaged, or scale it down first"
        )
    if spec.get_int_attribute("tiff:PhotometricInterpretation") in (_COLOUR_FILTER_ARRAY, _LINEAR_RAW):
        raise InputError(f"{path}: holds RAW sensor data; convert it to 16-bit TIFF or to JPEG with a raw developer")


def _close(reader: ImageInput) -> None:
    reader.close()
    fault_of(reader)
    library_fault()


def one_line(text: str) -> str:
    """The text of a fault, for a message of one line."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(printable.split())[:200] or "no reason given"
