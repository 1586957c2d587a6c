"""How well a calibration knows the direction that a pixel looks in."""

from __future__ import annotations

import dataclasses

from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class RaySigma:
    """Standard deviation of ray directions over the picture.

    Attributes
    ----------
    u_px, v_px
        (W,) and (H,) pixels of a grid over the picture.
    relative_rad
        (H, W) after the best common rotation: the errors of directions against each other.  Turning the camera frame
        changes no picture, only what its axis is called, and the poses take it up; this is what matters to whoever
        finds the camera's orientation from its own pictures, and what a report shows.  NaN outside the field of view.
    absolute_rad
        (H, W) against the camera frame of the stated centre: what matters where the camera's axis itself is used.
    """

    u_px: FloatArray
    v_px: FloatArray
    relative_rad: FloatArray
    absolute_rad: FloatArray
