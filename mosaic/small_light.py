"""A picture's light averaged over squares of pixels, with how much of each square counts and how much is clipped."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.overview_kernels import reduced_light
from fullsphere.mosaic.project import Picture

_EVERYWHERE = np.array([0.0, 0.0, 1.0, math.inf])


class SmallLight(NamedTuple):
    """The average over the pixels of a square that count (h, w, 3); the share that counts, and the share of those that
    is clipped (h, w).
    """

    light: NDArray[np.float32]
    seen: NDArray[np.float32]
    clipped: NDArray[np.float32]


def small_light(
    codes: Picture, light_of_code: NDArray[np.float32], white: float, factor: int, disc: FloatArray = _EVERYWHERE
) -> SmallLight:
    """Make a picture `factor` times smaller; see `reduced_light` for the parameters."""
    height, width = codes.shape[0] // factor, codes.shape[1] // factor
    light, seen = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
    clipped = np.empty_like(seen)
    reduced_light(codes, light_of_code, white, disc, factor, light, seen, clipped)
    return SmallLight(light, seen, clipped)
