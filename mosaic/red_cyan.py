"""The anaglyph of two eyes: a preview of their depth through red-cyan glasses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def red_cyan(left: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Red of the left eye, green and blue of the right one: (h, w, 3) of pictures (h, w, 3)."""
    return np.concatenate([left[..., :1], right[..., 1:]], axis=-1)
