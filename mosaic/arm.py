"""A camera that turns on an arm: where it stands and how it looks at each turn angle.

The arm turns about the world's y axis, to the right; its length is the unit.  At the turn angle a the camera stands at

    position(a) = (sin a, 0, cos a),    world_from_camera(a) = Ry(a) arm_from_camera

and looks outward along the arm when it is mounted straight.  Its circle theta = 90 degrees then holds exactly the rays
that are tangent to the circle it stands on (Bakstein & Pajdla 2002).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.camera import Camera
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.yaw_pitch_roll import angles_of_rotation, rotation_of_angles
from fullsphere.mosaic.project import Frame


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTurn:
    """Frames of one camera on a turning arm, in the order of their angles.

    Attributes
    ----------
    camera
        That took all of them.
    frames
        n pictures.
    angles
        Turn angles (n,) in radians, growing, within one full turn.
    mount
        camera_from_arm (3, 3): how the camera is held; `mount_of` makes it of angles.
    sigmas
        One standard deviation (n,) of the angles, radians; zeros where they were told.
    mount_sigmas
        One standard deviation (3,) of the mount's yaw, pitch and roll, radians; zeros where it was not estimated.
    quality
        Figures for people and programs, by name.
    diagnosis
        What was found out about the turn, in plain words, the most important first.

    Raises
    ------
    UsageError
        If there are not as many angles as frames, or they do not grow within one turn.
    """

    camera: Camera
    frames: tuple[Frame, ...]
    angles: FloatArray
    mount: FloatArray = dataclasses.field(default_factory=lambda: np.eye(3))
    sigmas: FloatArray | None = None
    mount_sigmas: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(3))
    quality: dict[str, float] = dataclasses.field(default_factory=dict)
    diagnosis: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, float)
        if angles.shape != (len(self.frames),):
            raise UsageError(f"{len(self.frames)} frames and {angles.size} turn angles; give one angle for each frame")
        if not np.isfinite(angles).all() or (np.diff(angles) <= 0).any() or np.ptp(angles) >= 2 * np.pi:
            raise UsageError("turn angles grow from frame to frame and stay within one full turn")
        object.__setattr__(self, "angles", angles)
        if self.sigmas is None:
            object.__setattr__(self, "sigmas", np.zeros(len(angles)))

    @property
    def gaps(self) -> FloatArray:
        """From each frame's angle to the next one's (n,), the last one's to the first one's, radians."""
        return np.diff(self.angles, append=self.angles[0] + 2 * np.pi)

    def camera_from_world(self, angles: ArrayLike) -> FloatArray:
        """Rotations (..., 3, 3) of rays into the camera frame at turn angles (...)."""
        return self.mount @ np.swapaxes(turned(angles), -1, -2)


def turned(angles: ArrayLike) -> FloatArray:
    """world_from_arm (..., 3, 3) at turn angles (...): Ry(a)."""
    angles = np.asarray(angles, float)
    turn = np.zeros((*angles.shape, 3, 3))
    turn[..., 0, 0] = turn[..., 2, 2] = np.cos(angles)
    turn[..., 0, 2] = np.sin(angles)
    turn[..., 2, 0] = -turn[..., 0, 2]
    turn[..., 1, 1] = 1
    return turn


def positions(angles: ArrayLike) -> FloatArray:
    """Where the camera stands (..., 3) at turn angles (...), in arm lengths."""
    angles = np.asarray(angles, float)
    return np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], -1)


def mount_of(yaw: float, pitch: float, roll: float) -> FloatArray:
    """camera_from_arm (3, 3) of a camera turned by yaw (right), pitch (up) and roll (clockwise) on its arm, radians."""
    return rotation_of_angles(*np.degrees([yaw, pitch, roll]).tolist()).T


def mount_angles(mount: ArrayLike) -> FloatArray:
    """Yaw, pitch and roll (3,) of a mount, radians: the inverse of `mount_of`."""
    return np.radians(angles_of_rotation(np.asarray(mount, float).T))
