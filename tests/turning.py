"""A camera turned on the spot: its orientations, what two of its frames match, and the frames it takes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame, Link, Picture
from laws import pixel_rays


def orientation(yaw_deg: float, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> FloatArray:
    """camera_from_world (3, 3): to the right, up, clockwise."""
    world_from_camera = Rotation.from_euler("YXZ", [yaw_deg, pitch_deg, roll_deg], degrees=True)
    return np.asarray(world_from_camera.as_matrix().T)


def ring(count: int, seed: int = 0) -> FloatArray:
    """Orientations (count, 3, 3) all round, not quite even and not quite level; the first is the world's own."""
    rng = np.random.default_rng(seed)
    rotations = [orientation(360 * k / count, *rng.uniform(-15, 15, 2)) for k in range(count)]
    return np.array([r @ rotations[0].T for r in rotations])


def turned(rotations: FloatArray, degrees: float, seed: int = 0) -> FloatArray:
    """Each of the rotations but the first turned about some axis by about so many degrees."""
    turn = np.deg2rad(degrees) * np.random.default_rng(seed).normal(size=(len(rotations), 3)) / np.sqrt(3)
    turn[0] = 0
    return np.asarray(Rotation.from_rotvec(turn).as_matrix() @ rotations)


def turn_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles in radians between rotations (..., 3, 3)."""
    flat = (np.swapaxes(a, -1, -2) @ b).reshape(-1, 3, 3)
    return np.asarray(Rotation.from_matrix(flat).magnitude()).reshape(a.shape[:-2])


def matched(
    camera: Camera,
    rotations: FloatArray,
    pairs: Sequence[tuple[int, int]] | None = None,
    count: int = 40,
    noise_px: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> list[Link]:
    """Links of all pairs (or those given) by what the camera would see: `count` matches each, a share of them wrong."""
    rng = np.random.default_rng(seed)
    world = rng.normal(size=(40 * count, 3))
    links = []
    for i, j in pairs or itertools.combinations(range(len(rotations)), 2):
        rays = rng.permutation(world)
        z = np.minimum(rays @ rotations[i][2], rays @ rotations[j][2]) / np.linalg.norm(rays, axis=1)
        seen = rays[z > np.cos(0.95 * camera.half_fov)][:count]
        if len(seen) < 8:
            continue
        pixels = [camera.project(seen @ rotations[k].T) for k in (i, j)]
        noisy = [p + rng.normal(0, noise_px, p.shape) for p in pixels]
        wrong = rng.random(len(seen)) < outliers
        noisy[1][wrong] = rng.permutation(noisy[1][wrong]) + rng.normal(0, 5, (int(wrong.sum()), 2))
        links.append(Link(i, j, noisy[0], noisy[1], rotations[j] @ rotations[i].T))
    return links


def frames_of(
    scene: Callable[[FloatArray], FloatArray],
    camera: Camera,
    rotations: FloatArray,
    finish: Callable[[int, FloatArray], Picture] = lambda k, light: light.astype(np.float32),
) -> list[Frame]:
    """Frames of a scene (rays (n, 3) -> light (n, c)), black beyond the field of view, made pixels of by `finish`."""
    rays = pixel_rays(camera)
    seen = np.isfinite(rays[..., 0])
    frames = []
    for k, camera_from_world in enumerate(rotations):
        of_world = scene(rays[seen] @ camera_from_world)
        light = np.zeros((*seen.shape, of_world.shape[-1]))
        light[seen] = of_world
        frames.append(frame_of(f"frame {k}", finish(k, light), camera_from_world))
    return frames


def frame_of(name: str, picture: Picture, camera_from_world: FloatArray | None = None) -> Frame:
    """A picture in memory as a frame."""
    size = (picture.shape[1], picture.shape[0])
    return Frame(name, name, size, lambda: picture, camera_from_world=camera_from_world)


def srgb8(light: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Linear light as 8-bit sRGB codes, by the formula of IEC 61966-2-1."""
    clipped = np.clip(light, 0, 1)
    code = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * code), np.uint8)
