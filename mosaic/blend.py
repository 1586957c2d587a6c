"""Several pictures of one place on the sphere -> one: a blender is fed and then asked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Feather:
    """The weighted mean of what it is fed, in linear light.

    A constant scene stays constant, and one picture fed alone comes back as it was, whatever its weights.
    """

    def __init__(self, height: int, width: int) -> None:
        self._light = np.zeros((height, width, 3), np.float32)
        self._weight = np.zeros((height, width), np.float32)

    def feed(self, light: NDArray[np.float32], weight: NDArray[np.float32]) -> None:
        """Add a picture (h, w, 3) with its weights (h, w); where the weight is zero it says nothing."""
        self._light += light * weight[..., None]
        self._weight += weight

    def blended(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The blended light (h, w, 3) and the coverage (h, w): 1 where anything was fed, else 0 and black."""
        covered = self._weight > 0
        light = np.zeros_like(self._light)
        np.divide(self._light, self._weight[..., None], out=light, where=covered[..., None])
        return light, covered.astype(np.float32)
