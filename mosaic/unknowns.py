"""The unknowns of a bundle adjustment, and which of them a frame's residuals depend on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.rig import Rig


class Unknowns(NamedTuple):
    """Places in the vector of unknowns: small turns of shots, then of mounts, then values of cameras.

    Attributes
    ----------
    rig
        Which camera took each frame in which shot.
    shot_at, mount_at
        Where the three unknowns of a shot or of a camera's mount begin; one that is not in it stays as it is.
    columns, camera_at
        For each camera which of its values (k,) are free, and their places (k,); values tied together have one place.
    size
        How many unknowns there are.
    """

    rig: Rig
    shot_at: dict[int, int]
    mount_at: dict[int, int]
    columns: tuple[NDArray[np.intp], ...]
    camera_at: tuple[NDArray[np.intp], ...]
    size: int

    @classmethod
    def of(
        cls, rig: Rig, group: NDArray[np.intp], columns: Sequence[NDArray[np.intp]], tied: Sequence[int] = ()
    ) -> Self:
        """Those of the frames in `group`, whose first shot holds the world, with the free columns of each camera.

        Columns that are in `tied` too are the same for all cameras.
        """
        shots = list(dict.fromkeys(rig.shot_of[group].tolist()))[1:]
        mounted = [child for child, _ in rig.mount_tree(group)]
        places = range(0, 3 * (len(shots) + len(mounted)), 3)
        shot_at = dict(zip(shots, places, strict=False))
        mount_at = dict(zip(mounted, places[len(shots) :], strict=True))
        names = dict.fromkeys((-1 if n in tied else k, n) for k, own in enumerate(columns) for n in own.tolist())
        at = {name: 3 * len(places) + index for index, name in enumerate(names)}
        camera_at = [[at[-1 if n in tied else k, n] for n in own.tolist()] for k, own in enumerate(columns)]
        size = 3 * len(places) + len(at)
        return cls(rig, shot_at, mount_at, tuple(columns), tuple(np.array(own, np.intp) for own in camera_at), size)

    @property
    def turns(self) -> int:
        """How many of them, the first, turn frames."""
        return 3 * (len(self.shot_at) + len(self.mount_at))

    def blocks(
        self, frame: int, by_frame: FloatArray, by_camera: FloatArray | None, mounts: FloatArray
    ) -> list[tuple[NDArray[np.intp], FloatArray]]:
        """Derivatives (..., 3) by a frame's turn and (..., P) by its camera's values -> by the unknowns at places (k,).

        Without `by_camera` only those that turn frames.
        """
        camera, shot = int(self.rig.camera_of[frame]), int(self.rig.shot_of[frame])
        found = []
        if shot in self.shot_at:
            found.append((self.shot_at[shot] + np.arange(3), by_frame @ mounts[camera]))
        if camera in self.mount_at:
            found.append((self.mount_at[camera] + np.arange(3), by_frame))
        if by_camera is not None and len(self.columns[camera]):
            found.append((self.camera_at[camera], by_camera[..., self.columns[camera]]))
        return found


def free_columns(
    cameras: Sequence[Camera], free: Sequence[str], rig: Rig, group: NDArray[np.intp]
) -> tuple[NDArray[np.intp], ...]:
    """For each camera the values (k,) that `free` names; none for a camera that took no frame of the group."""
    used = set(rig.camera_of[group].tolist())
    return tuple(
        np.array([n for n, name in enumerate(camera.parameter_names) if name in free and k in used], np.intp)
        for k, camera in enumerate(cameras)
    )
