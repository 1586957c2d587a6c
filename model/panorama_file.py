"""Writing panoramas row by row, in the format that the name ends in; a file is checked before it gets its name.

A TIFF is written out of core.  A JPEG or PNG is held in memory at the size of its samples, and encoded there.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from fullsphere.model.encoded_picture import encoded_jpeg, encoded_png
from fullsphere.model.errors import UsageError
from fullsphere.model.files import replacing
from fullsphere.model.panorama_writers import EncodedWriter, PanoramaWriter, TiffWriter
from fullsphere.model.picture_metadata import Attributes, xmp_packet
from fullsphere.model.resources import require_disk, require_memory

MAX_SIDE = 1 << 20
"""The longest side of a panorama in pixels."""

_MAX_JPEG_SIDE = 65500
_FORMATS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
_SAMPLES = {"TIFF": ("uint8", "uint16", "float32"), "PNG": ("uint8", "uint16"), "JPEG": ("uint8",)}
_LEAST_SHARE = {"TIFF": 0.4, "PNG": 0.3, "JPEG": 0.05}  # of the samples' bytes, that a photograph takes in a file


def check_panorama(path: Path, size: tuple[int, int], channels: int, dtype: DTypeLike) -> None:
    """Say before the work whether such a panorama can be written.

    Raises
    ------
    UsageError
        If the name's ending is unknown, or the format does not hold this size, these channels or samples.
    ResourceError
        If the disk or, for JPEG and PNG, the memory has no room for it.
    """
    kind, (width, height), samples = _format_of(path), size, np.dtype(dtype)
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise UsageError(f"{path}: {width} x {height} pixels: a side has 1 to {MAX_SIDE} pixels")
    if kind == "JPEG" and max(size) > _MAX_JPEG_SIDE:
        raise UsageError(f"{path}: a JPEG has at most {_MAX_JPEG_SIDE} pixels a side, not {max(size)}; write a .tif")
    if samples.name not in _SAMPLES[kind]:
        raise UsageError(f"{path}: a {kind} holds {' or '.join(_SAMPLES[kind])} samples, not {samples}; write a .tif")
    if channels not in (1, 3, 4):
        raise UsageError(f"{path}: a panorama has 1, 3 or 4 channels, not {channels}")
    count = width * height * channels * samples.itemsize
    if kind != "TIFF":
        needed = count + int(_LEAST_SHARE[kind] * count)
        require_memory(needed, f"{path}: a {kind} of {width} x {height} pixels", "write a .tif, or a smaller size")
    require_disk(int(_LEAST_SHARE[kind] * count), path.parent, f"{path}:", "make room, or choose a smaller size")


@contextlib.contextmanager
def open_panorama(
    path: Path,
    size: tuple[int, int],
    channels: int,
    dtype: DTypeLike,
    attributes: Attributes,
    overwrite: bool,
    icc_profile: bytes | None = None,
) -> Iterator[PanoramaWriter]:
    """Give a writer of the rows of a panorama; when the block ends the file is finished, checked and put in place.

    Parameters
    ----------
    path
        .tif or .tiff (BigTIFF where needed), .png, .jpg or .jpeg; a JPEG leaves alpha out.
    size, channels, dtype
        Width and height; 1, 3 (RGB) or 4 (RGB and alpha, colours not multiplied by it); uint8, uint16 or float32.
    attributes
        Metadata by OpenImageIO's names, as `gpano` and `Picture.metadata` give them.
    icc_profile
        The colour profile of the samples, if they are not sRGB.

    Raises
    ------
    UsageError, ResourceError
        As `check_panorama`.
    OutputError
        If the file cannot be written or does not read back as what was written; then nothing is left behind and what
        stood at `path` is as it was.
    ValueError
        If the block ends before all rows are written.
    """
    path = Path(path)
    check_panorama(path, size, channels, dtype)
    shape, samples = (size[1], size[0], channels), np.dtype(dtype)
    with replacing(path, overwrite) as temporary:
        writer: PanoramaWriter
        if _format_of(path) == "TIFF":
            writer = TiffWriter(path, temporary, shape, samples, attributes, icc_profile)
        else:
            lossless = _format_of(path) == "PNG"
            encode = encoded_png if lossless else encoded_jpeg
            xmp = xmp_packet(attributes)
            writer = EncodedWriter(path, temporary, shape, samples, encode, xmp, icc_profile, lossless=lossless)
        with contextlib.closing(writer):
            yield writer
            writer.finish()
        writer.check()


def _format_of(path: Path) -> str:
    kind = _FORMATS.get(path.suffix.lower())
    if kind is None:
        raise UsageError(f"{path}: the ending names no known format; use one of {', '.join(_FORMATS)}")
    return kind
