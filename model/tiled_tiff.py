"""The header of a tiled TIFF file; BigTIFF where it grows past 4 GB."""

from __future__ import annotations

from typing import Any

import numpy as np

from fullsphere.model.image_library import ImageSpec, byte_array, set_attribute
from fullsphere.model.picture_metadata import Attributes

COMPRESSIONS = ("zip", "lzw", "none")
"""The names of its compressions; all keep every bit."""


def usual_compression(dtype: np.dtype[Any]) -> str:
    """lzw for 8 bits: zip takes three times as long for a tenth less.  It makes deeper samples larger: zip."""
    return "lzw" if dtype == np.uint8 else "zip"


def tiff_spec(
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    attributes: Attributes,
    icc_profile: bytes | None,
    compression: str,
) -> ImageSpec:
    """The header for (h, w, c) pixels, uint8, uint16 or float32; with c = 2 or 4 the last channel is straight alpha."""
    height, width, channels = shape
    spec = ImageSpec(width, height, channels, str(dtype).replace("float32", "float"))
    spec.attribute("compression", compression)
    if channels in (2, 4):
        spec.alpha_channel = channels - 1
        spec.attribute("oiio:UnassociatedAlpha", 1)
    # Without any Exif attribute the library reports a fault of a sound file; without DateTime it writes the time of
    # day, and the same panorama would never be the same bytes.
    spec.attribute("Exif:ColorSpace", 1 if dtype.kind == "u" else 65535)
    spec.attribute("DateTime", "")
    # The library leaves the reference of the altitude out of a TIFF, and fails where it is the only one of GPS.
    below_sea = attributes.get("GPS:AltitudeRef") not in (None, 0)
    left_out = ("GPS:AltitudeRef", "GPS:Altitude") if below_sea else ("GPS:AltitudeRef",)
    for name, value in attributes.items():
        if name not in left_out:
            set_attribute(spec, name, value)
    if icc_profile:
        spec.attribute("ICCProfile", *byte_array(icc_profile))
    return spec
