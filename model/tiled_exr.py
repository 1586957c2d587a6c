"""The header of a tiled OpenEXR file, and its colours: multiplied by alpha, as every program that reads one expects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.image_library import ImageSpec, set_attribute
from fullsphere.model.picture_metadata import Attributes

COMPRESSIONS = ("zip", "piz", "dwaa", "dwab", "none")
"""The names of its compressions, the default first."""

LOSSY = ("dwaa", "dwab")
"""Those that lose what the eye does not see; of tiles, `dwab` makes the smaller files in a seventh of the time."""

_CHANNELS = {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def exr_spec(shape: tuple[int, int, int], dtype: np.dtype[Any], attributes: Attributes, compression: str) -> ImageSpec:
    """The header for (h, w, c) pixels, float16 or float32; with c = 2 or 4 the last channel is alpha.

    Attributes keep their names.  The format has no place for a colour profile.
    """
    height, width, channels = shape
    spec = ImageSpec(width, height, channels, {"float16": "half", "float32": "float"}[dtype.name])
    spec.channelnames = _CHANNELS[channels]
    spec.alpha_channel = channels - 1 if channels in (2, 4) else -1
    spec.attribute("compression", compression)
    spec.attribute("DateTime", "")  # or the library writes the time of day
    for name, value in attributes.items():
        set_attribute(spec, name, value)
    return spec


def multiplied_by_alpha(pixels: NDArray[Any]) -> NDArray[Any]:
    """Floating-point pixels (..., c) with the colours multiplied by the last channel; with c = 1 or 3 as they are.

    Where alpha is 0 the colour is 0, whatever it was.
    """
    if pixels.shape[-1] in (1, 3):
        return pixels
    alpha = pixels[..., -1:]
    multiplied = pixels.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        multiplied[..., :-1] = np.where(alpha == 0, alpha, pixels[..., :-1] * alpha)
    return multiplied
