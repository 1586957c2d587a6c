"""Picture files as arrays, and the page from which everything about pixel files is imported.

Pixels are in sensor coordinates, as stored: the EXIF orientation is kept beside them and never applied.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.errors import InputError
from fullsphere.model.image_library import ImageSpec, opened, read_pixels
from fullsphere.model.panorama_file import check_panorama, open_panorama
from fullsphere.model.panorama_writers import PanoramaWriter
from fullsphere.model.picture_metadata import CAPTURE_NAMES, gpano
from fullsphere.model.resources import require_memory

__all__ = [
    "PanoramaWriter",
    "Picture",
    "check_panorama",
    "encoded_from_linear",
    "gpano",
    "linear_from_encoded",
    "open_panorama",
    "picture_size",
    "read_picture",
]

# What is asked of OpenImageIO for each type of sample in a file; integers of 32 bits hold no photograph.
_SAMPLE_TYPES = {"uint8": "uint8", "uint16": "uint16", "half": "float", "float": "float", "double": "float"}


@dataclasses.dataclass(frozen=True, eq=False)
class Picture:
    """A picture as its file holds it.

    Attributes
    ----------
    path
        Where it was read from.
    pixels
        (h, w, c) uint8, uint16 or float32, C order, c = 1 (grey), 3 or 4 (the last one alpha, colours not
        multiplied by it), in sensor coordinates.
    linear
        Whether the samples are linear light (floating-point files) instead of sRGB codes.
    orientation
        EXIF orientation, 1 to 8: how to turn the picture for show.
    icc_profile
        The colour profile in the file, or None.
    metadata
        What the camera noted about the exposure, by OpenImageIO's names ("Make", "Exif:FocalLength", ...).
    """

    path: Path
    pixels: NDArray[Any]
    linear: bool
    orientation: int
    icc_profile: bytes | None
    metadata: Mapping[str, str | int | float]


def read_picture(path: Path) -> Picture:
    """Read a picture whole.

    Raises
    ------
    InputError
        If the file is missing, empty, damaged, no picture, of a kind that is not read (RAW, HEIC), larger than any
        camera's, or has a number of channels or a type of sample that no photograph has.
    ResourceError
        If its pixels do not fit into memory.
    """
    path = Path(path)
    with opened(path) as (reader, spec):
        sample_type = _SAMPLE_TYPES.get(str(spec.format))
        if sample_type is None:
            raise InputError(f"{path}: has {spec.format} samples; export it with 8 or 16 bits or in floating point")
        if not (spec.nchannels in (1, 3, 4) or (spec.nchannels == 2 and spec.alpha_channel == 1)):
            raise InputError(f"{path}: has {spec.nchannels} channels; export it as grey, RGB or RGBA")
        require_memory(spec.width * spec.height * spec.nchannels * 4, f"{path}:", "scale the picture down")
        pixels = read_pixels(path, reader, spec, sample_type)
        if spec.nchannels == 2:
            pixels = pixels[..., [0, 0, 0, 1]]
        return Picture(
            path=path,
            pixels=np.ascontiguousarray(pixels),
            linear=sample_type == "float",
            orientation=_orientation(spec),
            icc_profile=_icc_profile(spec),
            metadata=_capture_metadata(spec),
        )


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels, from the header alone; raises InputError as `read_picture` does."""
    with opened(Path(path)) as (_, spec):
        return spec.width, spec.height


def _orientation(spec: ImageSpec) -> int:
    orientation = int(spec.get_int_attribute("Orientation", 1))
    return orientation if 1 <= orientation <= 8 else 1


def _icc_profile(spec: ImageSpec) -> bytes | None:
    profile = spec.getattribute("ICCProfile")
    return None if profile is None else np.asarray(profile, np.uint8).tobytes()


def _capture_metadata(spec: ImageSpec) -> dict[str, str | int | float]:
    """The known capture attributes that hold something; control characters in texts, which are untrusted, dropped."""
    found: dict[str, str | int | float] = {}
    for name in CAPTURE_NAMES:
        value = spec.getattribute(name)
        if isinstance(value, str):
            value = "".join(c for c in value if c.isprintable()).strip()[:500]
        if isinstance(value, str | int | float) and value != "":
            found[name] = value
    return found
