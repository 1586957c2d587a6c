"""Picture files as arrays, and the page from which everything about pixel files is imported.

Pixels are in sensor coordinates, as stored: the EXIF orientation is kept beside them and never applied.
"""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.icc import SRGB, Profile, profile_of
from fullsphere.model.image_library import opened
from fullsphere.model.panorama_file import check_panorama, open_panorama
from fullsphere.model.panorama_writers import PanoramaWriter
from fullsphere.model.picture_file import PictureFile, open_picture
from fullsphere.model.picture_metadata import Attributes, carried, gpano, noted_ev, over_under
from fullsphere.model.resources import require_memory

__all__ = [
    "PanoramaWriter",
    "Picture",
    "PictureFile",
    "carried",
    "check_panorama",
    "encoded_from_linear",
    "gpano",
    "linear_from_encoded",
    "noted_ev",
    "open_panorama",
    "open_picture",
    "over_under",
    "picture_profile",
    "picture_size",
    "read_picture",
]


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
        Whether the samples are linear light (floating-point files) instead of codes.
    orientation
        EXIF orientation, 1 to 8: how to turn the picture for show.
    icc_profile
        The colour profile in the file, or None.
    metadata
        What the camera noted about the exposure, by OpenImageIO's names ("Make", "GPS:Latitude", ...).
    """

    path: Path
    pixels: NDArray[Any]
    linear: bool
    orientation: int
    icc_profile: bytes | None
    metadata: Attributes

    @property
    def profile(self) -> Profile:
        """The colour space of its codes; sRGB for linear light, which has none."""
        return SRGB if self.linear else profile_of(self.icc_profile)


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
    with contextlib.closing(PictureFile(path, by_region=False)) as file:
        (width, height), sample_type = file.size, np.float32 if file.linear else file.dtype
        channels = 4 if file.channels == 2 else file.channels
        require_memory(width * height * channels * 4, f"{path}:", "scale the picture down")
        pixels = np.empty((height, width, channels), sample_type)
        for top, strip in file.strips():
            pixels[top : top + len(strip)] = strip[..., [0, 0, 0, 1]] if file.channels == 2 else strip
        return Picture(
            path=path,
            pixels=pixels,
            linear=file.linear,
            orientation=file.orientation,
            icc_profile=file.icc_profile,
            metadata=file.metadata,
        )


def picture_profile(path: Path) -> Profile:
    """The colour space of a picture's codes, from the header alone; raises InputError as `open_picture` does."""
    with open_picture(path) as file:
        return SRGB if file.linear else profile_of(file.icc_profile)


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels, from the header alone; raises InputError as `open_picture` does."""
    with opened(Path(path), by_region=True) as (_, spec):
        return spec.width, spec.height
