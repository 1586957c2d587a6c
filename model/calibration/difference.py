"""How two calibrations of one lens differ, as angles between the rays of the same pixels."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from fullsphere.model.calibration.grid import pixel_grid, solid_angles
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError, UsageError
from fullsphere.model.lens import FloatArray

_FEWEST = 10  # pixels of the grid inside both fields of view
_PROFILE_DEG = 5.0  # width of a step of the profile


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
        (H, W, 2) where the first camera shows the second's rays, minus the pixel; NaN where it does not see them.
    first_from_second
        (3, 3) the common rotation taken out; `rotation_deg` is its angle.
    rms_rad, largest_rad
        Of `angle_rad`, by solid angle; and its maximum, `largest_theta_deg` from the first camera's axis.
    rms_px, largest_px
        Of the length of `shift_px`, by solid angle; and its maximum.
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
    """Compare two cameras of one picture.

    The rotation is the one of least squared angle over the solid angle that both see (Kabsch 1976): calibrations
    agree on the axis of a lens no better than on its centre, and a turn of the camera frame changes no picture.

    Parameters
    ----------
    first, second
        Cameras of pictures of one size.
    across
        Number of grid pixels along the picture's longer side.

    Raises
    ------
    UsageError
        If the pictures differ in size.
    GeometryError
        If the fields of view have next to nothing in common.
    """
    if first.size != second.size:
        raise UsageError(
            f"the cameras are of pictures of {first.size[0]} x {first.size[1]} and {second.size[0]} x "
            f"{second.size[1]} pixels; compare cameras of one picture size"
        )
    u, v, pixels = pixel_grid(first.size, across)
    rays, other = first.unproject(pixels), second.unproject(pixels)
    seen = np.asarray(np.isfinite(rays + other).all(axis=-1))
    if np.count_nonzero(seen) < _FEWEST:
        raise GeometryError("the cameras' fields of view have next to nothing in common; there is nothing to compare")
    weights = solid_angles(first, rays[seen])
    turn = _rotation(other[seen], rays[seen], weights)
    turned = other @ turn.T
    angle = 2 * np.arcsin(np.clip(np.linalg.norm(turned - rays, axis=-1) / 2, 0, 1))
    shift = _wide(first).project(np.where(seen[..., None], turned, np.nan)) - pixels
    theta = np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])
    length = np.linalg.norm(shift, axis=-1)
    shown = np.isfinite(length)
    place, profile = _profile(theta[seen], angle[seen], weights)
    return Difference(
        u,
        v,
        np.where(seen, angle, np.nan),
        shift,
        turn,
        math.degrees(math.atan2(np.linalg.norm(turn - turn.T) / math.sqrt(8), (np.trace(turn) - 1) / 2)),
        _rms(angle[seen], weights),
        float(np.max(angle[seen])),
        math.degrees(float(theta[seen][np.argmax(angle[seen])])),
        _rms(length[seen & shown], weights[shown[seen]]),
        float(np.max(length[shown])),
        place,
        profile,
    )


def _rotation(source: FloatArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    """The rotation (3, 3) that takes unit rays (n, 3) nearest to others."""
    u, _, vt = np.linalg.svd(np.einsum("n,ni,nj->ij", weights, target, source))
    turn: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn


def _wide(camera: Camera) -> Camera:
    """The camera with a margin round its field of view, where its lens has one: rays at its edge too have pixels."""
    try:
        return dataclasses.replace(camera, half_fov=min(1.05 * camera.half_fov, camera.lens.theta_max * (1 - 1e-9)))
    except CameraError:
        return camera


def _profile(theta: FloatArray, angle: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    place = (np.degrees(theta) // _PROFILE_DEG).astype(int)
    total, squares, middle = (
        np.bincount(place, values) for values in (weights, weights * angle**2, weights * np.degrees(theta))
    )
    filled = total > 0
    return middle[filled] / total[filled], np.sqrt(squares[filled] / total[filled])


def _rms(values: FloatArray, weights: FloatArray) -> float:
    return math.sqrt(float(np.sum(weights * values**2) / np.sum(weights)))
