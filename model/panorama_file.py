"""Writing panoramas row by row, in the format that the name ends in; a file is checked before it gets its name.

Every file is written as it is computed: no more than some hundred rows of it are in memory.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from fullsphere.model import tiled_exr, tiled_tiff
from fullsphere.model.encoded_picture import JPEG_QUALITY, PNG_LEVEL, Metadata
from fullsphere.model.errors import UsageError
from fullsphere.model.exif_block import exif_block
from fullsphere.model.files import replacing
from fullsphere.model.panorama_writers import PanoramaWriter, StreamWriter, TiledWriter
from fullsphere.model.picture_metadata import Attributes, xmp_packet
from fullsphere.model.picture_stream import JpegStream, PngStream
from fullsphere.model.resources import require_disk

MAX_SIDE = 1 << 20
"""The longest side of a panorama in pixels."""


class _Format(NamedTuple):
    name: str
    samples: tuple[str, ...]
    compressions: tuple[str, ...]  # the default first, but of a TIFF
    least_share: float  # of the samples' bytes, that a photograph takes in a file
    instead: str  # the ending to advise where the samples do not fit


_JPEG_QUALITIES = tuple(str(quality) for quality in (JPEG_QUALITY, *range(1, 101)))
_TIFF = _Format("TIFF", ("uint8", "uint16", "float32"), tiled_tiff.COMPRESSIONS, 0.4, ".exr")
_EXR = _Format("OpenEXR file", ("float16", "float32"), tiled_exr.COMPRESSIONS, 0.15, ".tif")
_PNG = _Format("PNG", ("uint8", "uint16"), ("zip", "none"), 0.3, ".tif")
_JPEG = _Format("JPEG", ("uint8",), _JPEG_QUALITIES, 0.02, ".tif")
_FORMATS = {".tif": _TIFF, ".tiff": _TIFF, ".exr": _EXR, ".png": _PNG, ".jpg": _JPEG, ".jpeg": _JPEG}
_MAX_JPEG_SIDE = 65500
_LARGEST_JPEG_ERROR = 16  # codes on the mean; quality 95 stays below 6 even on white noise, a broken picture does not


def check_panorama(
    path: Path, size: tuple[int, int], channels: int, dtype: DTypeLike, compression: str | None = None
) -> None:
    """Say before the work whether such a panorama can be written.

    Raises
    ------
    UsageError
        If the name's ending is unknown, or the format does not hold this size, these channels or samples, or has no
        such compression.
    ResourceError
        If the disk has no room for it.
    """
    kind, (width, height), samples = _format_of(path), size, np.dtype(dtype)
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise UsageError(f"{path}: {width} x {height} pixels: a side has 1 to {MAX_SIDE} pixels")
    if kind is _JPEG and max(size) > _MAX_JPEG_SIDE:
        raise UsageError(f"{path}: a JPEG has at most {_MAX_JPEG_SIDE} pixels a side, not {max(size)}; write a .tif")
    if samples.name not in kind.samples:
        held, instead = " or ".join(kind.samples), ".exr" if samples == np.float16 else kind.instead
        raise UsageError(f"{path}: a {kind.name} holds {held} samples, not {samples}; write a {instead}")
    if channels not in (1, 2, 3, 4):
        raise UsageError(f"{path}: a panorama has 1 to 4 channels, not {channels}")
    _check_compression(path, kind, compression)
    count = width * height * channels * samples.itemsize
    share = 1 if compression == "none" else kind.least_share
    require_disk(int(share * count), path.parent, f"{path}:", "make room, or choose a smaller size")


@contextlib.contextmanager
def open_panorama(
    path: Path,
    size: tuple[int, int],
    channels: int,
    dtype: DTypeLike,
    attributes: Attributes,
    overwrite: bool,
    icc_profile: bytes | None = None,
    compression: str | None = None,
) -> Iterator[PanoramaWriter]:
    """Give a writer of the rows of a panorama; when the block ends the file is finished, checked and put in place.

    Parameters
    ----------
    path
        .tif or .tiff (BigTIFF where needed), .exr, .png, .jpg or .jpeg; a JPEG leaves alpha out.
    size, channels, dtype
        Width and height; 1 (grey), 2 (grey and alpha; a PNG holds it as RGB and alpha), 3 (RGB) or 4 (RGB and alpha),
        colours not multiplied by alpha; uint8, uint16 or float32, into an .exr float16 or float32.
    attributes
        Metadata by OpenImageIO's names, as `gpano` and `carried` give them.
    icc_profile
        The colour profile of the samples, if they are not sRGB; an .exr has no place for it.
    compression
        .tif: zip, lzw, none; .exr: zip, piz, none and the lossy dwaa and dwab; .png: zip, none; .jpg: the quality, 1
        to 100.
        By default the first, lzw for a .tif of 8 bits, and quality 95.

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
    check_panorama(path, size, channels, dtype, compression)
    shape, samples = (size[1], size[0], channels), np.dtype(dtype)
    with replacing(path, overwrite) as temporary:
        packing = compression or _usual_compression(_format_of(path), samples)
        writer = _writer(path, temporary, shape, samples, attributes, icc_profile, packing)
        with contextlib.closing(writer):
            yield writer
            writer.finish()
        writer.check()


def _writer(
    path: Path,
    temporary: Path,
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    attributes: Attributes,
    icc_profile: bytes | None,
    compression: str,
) -> PanoramaWriter:
    kind = _format_of(path)
    if kind is _TIFF:
        spec = tiled_tiff.tiff_spec(shape, dtype, attributes, icc_profile, compression)
        return TiledWriter(path, temporary, shape, dtype, "tiff", spec)
    if kind is _EXR:
        spec = tiled_exr.exr_spec(shape, dtype, attributes, compression)
        lossy = compression in tiled_exr.LOSSY
        stored = tiled_exr.multiplied_by_alpha
        return TiledWriter(path, temporary, shape, dtype, "openexr", spec, stored=stored, lossy=lossy)
    metadata = Metadata(xmp_packet(attributes), exif_block(attributes), icc_profile or b"")
    if kind is _PNG:
        level = 0 if compression == "none" else PNG_LEVEL
        png = PngStream((shape[1], shape[0]), metadata, level)
        return StreamWriter(path, temporary, shape, dtype, png, largest_mean_error=0, alpha=True)
    quality = int(compression)
    jpeg = JpegStream(shape[0], metadata, quality)
    largest = _LARGEST_JPEG_ERROR + (100 - quality)
    return StreamWriter(path, temporary, shape, dtype, jpeg, largest_mean_error=largest, alpha=False)


def _usual_compression(kind: _Format, dtype: np.dtype[Any]) -> str:
    return tiled_tiff.usual_compression(dtype) if kind is _TIFF else kind.compressions[0]


def _check_compression(path: Path, kind: _Format, compression: str | None) -> None:
    if compression is None or compression in kind.compressions:
        return
    known = "quality of 1 to 100" if kind is _JPEG else f"compression of {', '.join(kind.compressions)}"
    raise UsageError(f"{path}: {compression!r} is no {known}, which is what a {kind.name} has")


def _format_of(path: Path) -> _Format:
    kind = _FORMATS.get(path.suffix.lower())
    if kind is None:
        raise UsageError(f"{path}: the ending names no known format; use one of {', '.join(_FORMATS)}")
    return kind
