"""A smooth field by which a frame is read beside where its camera says, so that it meets its neighbours."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.floating[Any]]


@dataclasses.dataclass(frozen=True, eq=False)
class Shift:
    """By how much a frame is read aside: (h, w, 2) pixels, on a grid of cells `cell_px` pixels wide."""

    values: NDArray[np.float32]
    cell_px: float

    def moved(self, u: Places, v: Places, size: tuple[int, int], border: int = 0) -> tuple[Places, Places]:
        """Positions (h, w) in a picture of `size` with a border around it, read aside; NaN where that is outside."""
        places = [np.nan_to_num((x - border + 0.5) / self.cell_px - 0.5).astype(np.float32) for x in (u, v)]
        aside = cv2.remap(self.values, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        u, v = u + aside[..., 0].astype(u.dtype), v + aside[..., 1].astype(v.dtype)
        low, width, height = border - 0.5, size[0] + border - 0.5, size[1] + border - 0.5
        with np.errstate(invalid="ignore"):
            outside = (u < low) | (u > width) | (v < low) | (v > height)
        u[outside] = v[outside] = np.nan
        return u, v
