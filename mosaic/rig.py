"""Which camera took each frame, and which frames a rig of cameras took at once.

camera_from_world of a frame is camera_from_rig of its camera times rig_from_world of its shot.  A camera that never
fires together with another is a rig of its own: its camera_from_rig is the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame


class Rig(NamedTuple):
    """Index of the camera (n,) and of the shot (n,) of each frame."""

    camera_of: NDArray[np.intp]
    shot_of: NDArray[np.intp]

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> Self:
        """As the frames say; a frame without a named shot is a shot of its own."""
        index: dict[str, int] = {}
        shots = [index.setdefault(f.shot or f"\n{k}", len(index)) for k, f in enumerate(frames)]
        return cls(np.array([f.camera for f in frames], np.intp), np.array(shots, np.intp))

    @classmethod
    def of_one_camera(cls, count: int) -> Self:
        """So many frames of one camera, each taken by itself."""
        return cls(np.zeros(count, np.intp), np.arange(count))

    def mount_tree(self, group: NDArray[np.intp]) -> list[tuple[int, int]]:
        """Cameras with the camera (child, parent) whose mount theirs hangs on, parents first; roots are left out.

        Two cameras hang together where both took a frame of one shot among the frames of `group`.
        """
        together: dict[int, set[int]] = {}
        for shot in np.unique(self.shot_of[group]):
            cameras = sorted({int(c) for c in self.camera_of[group][self.shot_of[group] == shot]})
            for camera in cameras:
                together.setdefault(camera, set()).update(cameras)
        tree: list[tuple[int, int]] = []
        reached: set[int] = set()
        for root in sorted(together):
            queue = [] if root in reached else [root]
            reached.update(queue)
            for parent in queue:
                children = sorted(together[parent] - reached)
                reached.update(children)
                queue += children  # the loop goes on over them
                tree += [(child, parent) for child in children]
        return tree


class Poses(NamedTuple):
    """rig_from_world (s, 3, 3) of the shots and camera_from_rig (c, 3, 3) of the cameras."""

    shots: FloatArray
    mounts: FloatArray

    def rotations(self, rig: Rig) -> FloatArray:
        """camera_from_world (n, 3, 3) of the frames."""
        return np.asarray(self.mounts[rig.camera_of] @ self.shots[rig.shot_of])


def poses_of(rotations: FloatArray, rig: Rig, group: NDArray[np.intp], cameras: int) -> Poses:
    """The poses of a rig of `cameras` nearest to rotations (n, 3, 3) that were found for each frame of `group`."""
    from scipy.spatial.transform import Rotation  # its import takes long, and composing needs only what is above

    mounts = np.tile(np.eye(3), (cameras, 1, 1))
    for child, parent in rig.mount_tree(group):
        of = {
            camera: {int(rig.shot_of[k]): rotations[k] for k in group if rig.camera_of[k] == camera}
            for camera in (child, parent)
        }
        between = [of[child][shot] @ of[parent][shot].T for shot in sorted(of[child].keys() & of[parent].keys())]
        mounts[child] = Rotation.from_matrix(between).mean().as_matrix() @ mounts[parent]
    shots = np.tile(np.eye(3), (int(rig.shot_of.max()) + 1, 1, 1))
    in_group = np.zeros(len(rotations), bool)
    in_group[group] = True
    seen = np.swapaxes(mounts[rig.camera_of], 1, 2) @ rotations
    for shot in range(len(shots)):
        own = rig.shot_of == shot
        trusted = own & in_group if (own & in_group).any() else own
        if trusted.sum() == 1:
            shots[shot] = seen[trusted][0]
        elif trusted.any():
            shots[shot] = Rotation.from_matrix(seen[trusted]).mean().as_matrix()
    return Poses(shots, mounts)
