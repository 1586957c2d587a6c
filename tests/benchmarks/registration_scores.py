"""How good a registration is: against the truth, and by its matches that no fit has seen."""

from typing import NamedTuple, Self

import numpy as np
from registration_sets import FrameSet, Truth

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Link, Mosaic
from fullsphere.mosaic.truth import rotation_errors_deg

GATE = 12 / 1920  # of the longer side: a match further off is no match
FROM_RIM_DEG = 2.0  # the curve is compared up to here


class Score(NamedTuple):
    """Errors against the truth; angles in degrees.

    `sigma_factor` is the root mean square of the frames' errors over their stated sigma: 1 where it is honest.
    `tilt` is between the mosaic's up and the scene's.
    """

    median: float
    worst: float
    sigma_factor: float
    curve_rms_px: float
    tilt: float

    @classmethod
    def of(cls, mosaic: Mosaic, files: FrameSet, truth: Truth) -> Self:
        """Of all registered frames; NaN where there are none."""
        by_path = {str(path): path.name for path in files.files}
        frames = [f for f in mosaic.registered if by_path[f.image] in truth.rotations]
        found = [np.asarray(f.camera_from_world) for f in frames]
        errors, turn = rotation_errors_deg(found, [truth.rotations[by_path[f.image]] for f in frames])
        sigma = np.array([f.sigma_deg or 0.0 for f in frames])
        return cls(
            float(np.median(errors)),
            float(errors.max()),
            sigma_factor(errors, sigma),
            curve_rms_px(mosaic.camera, truth),
            float(np.degrees(np.arccos(np.clip(turn[1, 1], -1, 1)))),
        )


def sigma_factor(errors: FloatArray, sigma: FloatArray) -> float:
    """Root mean square of errors (n,) over stated sigma (n,); a frame that holds the world, sigma 0, does not count."""
    stated = sigma > 0
    return float(np.sqrt(np.mean((errors[stated] / sigma[stated]) ** 2))) if stated.any() else float("nan")


def curve_rms_px(camera: Camera, truth: Truth) -> float:
    """Of the lens, found minus true, to two degrees inside the rim; infinite where the lens found ends before it."""
    inside = truth.theta <= truth.theta[-1] - np.radians(FROM_RIM_DEG)
    if truth.theta[inside][-1] > camera.lens.theta_max:
        return float("inf")
    gap = camera.lens.radius(truth.theta[inside]) - truth.radius_px[inside]
    return float(np.sqrt(np.mean(gap**2)))


class HeldOut(NamedTuple):
    """Matches that no fit has seen: the median distance of those inside the gate, how many, and their share of all."""

    median_px: float
    inside: int
    share: float

    @classmethod
    def of(cls, mosaic: Mosaic) -> Self:
        """Over all links of the mosaic."""
        every = np.concatenate([held_distances_px(mosaic, link) for link in mosaic.links] or [np.empty(0)])
        gate = GATE * max(mosaic.camera.size)
        inside = every[every < gate]
        if not inside.size:
            return cls(float("nan"), 0, 0.0)
        return cls(float(np.median(inside)), int(inside.size), inside.size / every.size)

    def __str__(self) -> str:
        return f"{self.median_px:.3f} px, {self.inside} ({self.share:.0%})" if self.inside else "none"


def held_distances_px(mosaic: Mosaic, link: Link) -> FloatArray:
    """Distances (m,) on the sphere between the two rays of each held match, in pixels of the frames."""
    first, second = mosaic.frames[link.i], mosaic.frames[link.j]
    if first.camera_from_world is None or second.camera_from_world is None or not len(link.held_i):
        return np.empty(0)
    camera_i, camera_j = mosaic.cameras[first.camera], mosaic.cameras[second.camera]
    rays_i, rays_j = camera_i.unproject(link.held_i), camera_j.unproject(link.held_j)
    turned = rays_i @ (second.camera_from_world @ first.camera_from_world.T).T
    chord = np.linalg.norm(turned - rays_j, axis=-1)
    scale = (camera_i.pixels_per_radian(rays_i) + camera_j.pixels_per_radian(rays_j)) / 2
    distance = 2 * np.arcsin(np.minimum(chord / 2, 1)) * scale
    return np.asarray(distance[np.isfinite(distance)])
