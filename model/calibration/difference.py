"""How two calibrations of one lens differ, as angles between the rays of the same pixels."""

from __future__ import annotations

import dataclasses

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Difference:
    """Two cameras compared over their picture, after the rotation of the second that brings them nearest.

    Attributes
    ----------
    u_px, v_px
        (W,) and (H,) pixels of a grid over the picture.
    angle_rad
        (H, W) angle between the rays, NaN outside either field of view.
    shift_px
        (H, W, 2) where the first camera shows the second's rays, minus the pixel.
    first_from_second
        (3, 3) the common rotation taken out; `rotation_deg` is its angle.
    rms_rad, largest_rad
        Of `angle_rad`, by solid angle; and its maximum, `largest_theta_deg` from the first camera's axis.
    rms_px, largest_px
        The same of the length of `shift_px`.
    theta_deg, profile_rad
        (B,) angles from the first camera's axis and the rms difference (B,) there.
    """

    u_px: FloatArray
    v_px: FloatArray
    angle_rad: FloatArray
    shift_px: FloatArray
    first_from_second: FloatArray
    rotation_deg: float
    rms_rad: float
    largest_rad: float
    largest_theta_deg: float
    rms_px: float
    largest_px: float
    theta_deg: FloatArray
    profile_rad: FloatArray


def difference(first: Camera, second: Camera, across: int = 120) -> Difference:
    """Compare two cameras of one picture; `across` is the number of grid pixels along its longer side."""
    raise NotImplementedError
