"""The image circle that frames of one lens show together."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.circle import ImageCircle, brightest, find_circle
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.project import Frame, Picture

_AT_MOST = 16  # frames looked at: what is dark at the rim of one is bright in another of so many


def common_circle(frames: Sequence[Frame], executor: Executor | None = None) -> ImageCircle | None:
    """The image circle of frames taken with one lens; None where none is to be seen.

    It is sought in the brightest that any of some frames, spread over the set, shows at each pixel; they are opened
    side by side on `executor`.
    """
    some = frames[:: max(1, -(-len(frames) // _AT_MOST))]
    highest: NDArray[np.uint8] | None = None
    for now in ordered_map(executor, _brightest, some, ahead=2):
        highest = now if highest is None else np.maximum(highest, now)
    return None if highest is None else find_circle(highest)


def _brightest(frame: Frame) -> NDArray[np.uint8]:
    return brightest([eight_bit(frame.load())])


def eight_bit(picture: Picture) -> NDArray[np.uint8]:
    """The colours (h, w, c) of a picture in 8 bits; floating-point light by its 99th percentile and a square root."""
    colour = picture[..., :3]
    if picture.dtype == np.uint8:
        return colour
    if picture.dtype == np.uint16:
        return (colour >> 8).astype(np.uint8)
    light = np.nan_to_num(colour, nan=0.0, posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(light, 99)), 1e-9)
    return np.asarray(255 * np.sqrt(np.clip(light / white, 0, 1)), np.uint8)
