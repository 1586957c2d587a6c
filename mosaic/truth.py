"""A solved mosaic against a known truth: how far off rotations, lens curve and panorama are."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.photographer import Scene


@dataclasses.dataclass(frozen=True, eq=False)
class Turned:
    """A scene seen in another world frame: `scene_from_world` (3, 3) takes rays of that frame into the scene's own."""

    scene: Scene
    scene_from_world: FloatArray

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        """Linear light (..., 3) along world rays (..., 3)."""
        return self.scene.radiance(np.asarray(rays, float) @ self.scene_from_world.T)


def rotation_errors_deg(found: Sequence[FloatArray], true: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Angles (n,) in degrees between found and true camera_from_world (3, 3), and the world turn between them.

    The world of a mosaic is free up to a rotation: `true_from_found` (3, 3), the second answer, is taken out first.
    It is the mean that a lost frame does not smear over the others (reweighted, as for a sum of angles).
    """
    pairs = list(zip(found, true, strict=True))
    world = Rotation.from_matrix([t.T @ f for f, t in pairs])
    turn = world.mean()
    for _ in range(20):
        angles = (turn.inv() * world).magnitude()
        turn = world.mean(weights=1 / np.maximum(angles, 1e-7))
    return np.rad2deg((turn.inv() * world).magnitude()), turn.as_matrix()


def curve_errors_px(found: Camera, true: Camera, to_deg: float) -> FloatArray:
    """Found minus true r(theta) in pixels at every tenth of a degree from 0 to `to_deg`."""
    theta = np.radians(np.arange(0, to_deg + 1e-9, 0.1))
    return np.asarray(found.lens.radius(theta) - true.lens.radius(theta))


def psnr_db(picture: NDArray[np.uint8], truth: NDArray[np.uint8], weight: NDArray[np.float32]) -> float:
    """Peak signal-to-noise ratio of a panorama (h, w, 3) against the truth, after a gain for each channel.

    The exposure of a mosaic is free, so the channels are scaled to the truth first.  Rows count by the solid angle of
    their pixels and pixels by `weight` (h, w); what is clipped in the truth, which no gain brings back, does not count.
    """
    height = picture.shape[0]
    rows = np.cos((np.arange(height) + 0.5) / height * np.pi - np.pi / 2)[:, None]
    counted = rows * weight * (truth.max(-1) < 250) * (truth.max(-1) > 2)
    squared = 0.0
    for channel in range(3):
        a, b = picture[..., channel].astype(float), truth[..., channel].astype(float)
        gain = (counted * a * b).sum() / (counted * a * a).sum()
        squared += (counted * (gain * a - b) ** 2).sum() / counted.sum() / 3
    return float(10 * np.log10(255**2 / squared))
