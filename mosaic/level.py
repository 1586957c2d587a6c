"""Which way is up, and where the panorama's middle looks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fullsphere.model.lens import FloatArray

_PARALLEL = 0.02  # mean squared sine between the cameras' x axes below which they fix no horizon


def level_turn(rotations: Sequence[FloatArray]) -> tuple[FloatArray, str]:
    """The rotation (3, 3) that takes the present world frame into a levelled one, and how it was found.

    A camera held level keeps its x axis in the horizon, whatever its yaw and pitch: up is the direction closest to a
    right angle with all x axes (the eigenvector of the smallest eigenvalue of sum x x^T; Brown & Lowe, IJCV 2007,
    section 5), pointing away from the mean of the cameras' y axes, which point down.  Where the x axes are all
    parallel they fix no horizon: then the first camera's own frame is kept, and "none" is answered.

    The levelled world looks along the first camera's optical axis at longitude zero.

    Parameters
    ----------
    rotations
        camera_from_world (3, 3) of the registered frames.
    """
    axes = np.array(rotations)  # rows of a camera_from_world are the camera's axes in the world
    x_axes, down, forward = axes[:, 0], axes[:, 1].mean(0), axes[0, 2]
    values, vectors = np.linalg.eigh(np.mean(x_axes[:, :, None] * x_axes[:, None, :], axis=0))
    if values[1] < _PARALLEL or np.linalg.norm(down) < 1e-3:
        return axes[0].copy(), "none"
    y = vectors[:, 0] * (1.0 if vectors[:, 0] @ down > 0 else -1.0)
    z = forward - (forward @ y) * y
    if np.linalg.norm(z) < 1e-3:  # the first camera looks straight up or down: its own top edge leads instead
        z = -axes[0, 1] + (axes[0, 1] @ y) * y
    z /= np.linalg.norm(z)
    return np.stack([np.cross(y, z), y, z]), "camera-x-axes"
