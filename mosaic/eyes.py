"""The two halves of the 360 x 360 mosaic: what the left and the right eye see, as equirectangular pictures.

The mosaic's rows |psi| < 90 degrees are the left eye's: it looks towards longitude alpha + 90 at elevation psi.  The
rows beyond are the right eye's, which looks towards alpha - 90 at elevation 180 - psi.  A mosaic as high as wide has
the same pixels as its two eyes, which are as wide and half as high: nothing is resampled.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import UsageError

Eye = Literal["left", "right"]
"""Which eye."""


def checked_width(width: int) -> int:
    """The width of a mosaic whose halves are eyes; UsageError if it is none."""
    if width < 16 or width % 4:
        raise UsageError(f"a mosaic of {width} pixels: its width is a multiple of 4, and 16 or more")
    return width


def eyes_of(mosaic: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The left and the right eye (W/2, W, ...) of a mosaic (W, W, ...), W a multiple of 4."""
    everything = slice(0, len(mosaic) // 2)
    return eye_rows(mosaic, "left", everything), eye_rows(mosaic, "right", everything)


def eye_rows(mosaic: NDArray[Any], eye: Eye, rows: slice) -> NDArray[Any]:
    """Rows (h, W, ...) of an eye, from its own top."""
    quarter, number = len(mosaic) // 4, np.arange(rows.start, rows.stop)
    if eye == "left":
        return np.roll(mosaic[quarter + number], -quarter, axis=1)
    return np.roll(mosaic[(quarter - 1 - number) % len(mosaic)], quarter, axis=1)


def mosaic_of(left: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """The mosaic (W, W, ...) of two eyes (W/2, W, ...): the inverse of `eyes_of`."""
    quarter = len(left) // 2
    around = np.roll(right, -quarter, axis=1)[::-1]
    return np.concatenate([around[quarter:], np.roll(left, quarter, axis=1), around[:quarter]])
