"""Which of two opposite directions is up: light comes from above."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.allowed import allowed_pixels
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.rim import eight_bit

_AT_MOST = 6  # frames looked at, spread over the set
_SIDE_PX = 160
_BAND = (0.08, 0.65)  # sines of elevation: ceilings are darker than what stands below windows, and floors shine
_LEAST_SHARE = 0.2  # of what a frame shows near the horizon on either side, for it to compare them


def lighter_side(frames: Sequence[Frame], cameras: Sequence[Camera], up: FloatArray) -> FloatArray:
    """`up` (3,) or its opposite, whichever is lighter in the mean of frames that show both.

    Near the horizon the sky is above and the ground below, and the light of windows falls from above.  Frames are
    compared with themselves alone: their exposures differ.  Where none shows both, `up` is answered.
    """
    differences = [_difference(frame, cameras[frame.camera], up) for frame in frames[:: -(-len(frames) // _AT_MOST)]]
    return up if sum(differences) >= 0 else -up


def _difference(frame: Frame, camera: Camera, up: FloatArray) -> float:
    """How much lighter a frame is above the horizon than below it, 8-bit codes; 0 if it does not show both."""
    assert frame.camera_from_world is not None
    picture = frame.load()
    allowed = allowed_pixels(frame, picture)  # beyond the field of view no ray has a height
    factor = min(1.0, _SIDE_PX / max(camera.size))
    small = camera.scaled(factor)
    code = cv2.resize(eight_bit(picture), small.size, interpolation=cv2.INTER_AREA).reshape(*small.size[::-1], -1)
    allowed = cv2.resize(allowed, small.size, interpolation=cv2.INTER_NEAREST)
    u, v = np.meshgrid(np.arange(small.size[0], dtype=float), np.arange(small.size[1], dtype=float))
    height = small.unproject(np.stack([u, v], -1)) @ (frame.camera_from_world @ up)
    counts = (allowed > 0) & np.isfinite(height)
    with np.errstate(invalid="ignore"):
        counts &= (np.abs(height) > _BAND[0]) & (np.abs(height) < _BAND[1])
        above, below = counts & (height > 0), counts & (height < 0)
    if min(above.sum(), below.sum()) < _LEAST_SHARE * counts.sum() or not counts.any():
        return 0.0
    grey = code.max(-1)  # the sky is light in blue, if not in the others
    return float(grey[above].mean(dtype=float) - grey[below].mean(dtype=float))
