"""Takes photos and panoramas of a world with known truth, through the exact camera model."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.model.table import tabulate
from fullsphere.model.workers import ordered_map
from fullsphere.model.yaw_pitch_roll import rotation_of_angles

_SAMPLES_AT_ONCE = 1 << 19  # bounds the memory of a strip to some tens of megabytes
_BLUR_REACH = 4  # standard deviations: what lies further away weighs 6e-5


class Scene(Protocol):
    """Anything that can be photographed: light as a function of direction at the camera's centre."""

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        """Linear light (..., 3) along world rays (..., 3); 0 for a NaN ray."""
        ...


@dataclasses.dataclass(frozen=True, eq=False)
class Shot:
    """How one frame was taken: rotation (3, 3), exposure over the reference in powers of two, seed of its noise."""

    camera_from_world: FloatArray
    exposure_ev: float = 0.0
    seed: int = 0


def turn(
    shots: int = 8,
    *,
    pitch_deg: float = 20.0,
    jitter_deg: float = 4.0,
    exposure_ev: float = 0.4,
    seed: int = 0,
) -> tuple[Shot, ...]:
    """A full turn taken by hand.

    Equal steps of yaw from world +z to the right; pitch alternately up and down by `pitch_deg`; yaw, pitch and roll
    each off by a normal error of `jitter_deg`; exposures uniform within +-`exposure_ev`, 0 for the first.

    Raises
    ------
    UsageError
        If there is no shot.
    """
    if shots < 1:
        raise UsageError(f"a turn has at least one shot, not {shots}")
    random = np.random.default_rng(seed)
    index = np.arange(shots)
    angles = np.stack([360.0 * index / shots, pitch_deg * (1 - 2 * (index % 2)), np.zeros(shots)], -1)
    angles += random.normal(0.0, jitter_deg, angles.shape)
    exposures = random.uniform(-exposure_ev, exposure_ev, shots)
    exposures[0] = 0.0
    camera_from_world = [rotation_of_angles(*each).T for each in angles.tolist()]
    return tuple(
        Shot(r, float(ev), seed + 1 + i) for i, (r, ev) in enumerate(zip(camera_from_world, exposures, strict=True))
    )


def photograph(
    scene: Scene,
    camera: Camera,
    camera_from_world: ArrayLike,
    *,
    exposure_ev: float = 0.0,
    vignetting: tuple[float, float] = (0.0, 0.0),
    blur_px: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    supersampling: int = 2,
    executor: Executor | None = None,
) -> NDArray[np.uint8]:
    """One frame of a scene.

    Parameters
    ----------
    scene
        What is photographed.
    camera
        The true camera; its picture is black outside `half_fov`, with a soft rim.
    camera_from_world
        Rotation (3, 3) from world to camera.
    exposure_ev
        Light is multiplied by 2**exposure_ev; what comes over 1 is clipped.
    vignetting
        (v1, v2): light is multiplied by 1 + v1 s + v2 s^2, s = (theta/half_fov)^2.
    blur_px
        Standard deviation of the optics' Gaussian blur, over that of the pixels' own area.
    noise
        Standard deviation at light 1; it grows with the square root of the light, as counted photons do.
    seed
        Of the noise.
    supersampling
        Samples along each side of a pixel.
    executor
        Renders strips of the picture at a time; in this thread when None.  The picture is the same.

    Returns
    -------
    (height, width, 3) uint8, sRGB.
    """
    table = tabulate(camera)
    world_from_camera = np.asarray(camera_from_world, float).T
    gain = 2.0**exposure_ev
    reach = math.ceil(_BLUR_REACH * blur_px)

    def sharp(rows: slice) -> NDArray[np.float32]:
        rays = table.unproject(_sample_pixels(camera.size[0], rows, supersampling)) @ world_from_camera.T
        light = _averaged(scene.radiance(rays), supersampling)
        centres = table.unproject(_sample_pixels(camera.size[0], rows, 1))[..., 2]
        light *= (gain * _falloff(centres, camera.half_fov, vignetting))[..., None]
        return light

    def strip(rows: slice) -> NDArray[np.uint8]:
        if blur_px > 0:
            above, below = min(reach, rows.start), min(reach, camera.size[1] - rows.stop)
            blurred = _blurred(sharp(slice(rows.start - above, rows.stop + below)), blur_px, reach)
            light = blurred[above : len(blurred) - below]
        else:
            light = sharp(rows)
        if noise > 0:
            random = np.random.default_rng([seed, rows.start])
            light += noise * np.sqrt(light) * random.standard_normal(light.shape, np.float32)
        return np.asarray(encoded_from_linear(light, np.uint8))

    return np.concatenate(list(ordered_map(executor, strip, _strips(camera.size, supersampling))))


def panorama(
    scene: Scene, width: int, *, supersampling: int = 2, executor: Executor | None = None
) -> NDArray[np.float32]:
    """The whole scene as an equirectangular picture (width/2, width, 3) of linear light: the truth of a mosaic."""
    sphere = Equirectangular((width, width // 2))

    def strip(rows: slice) -> NDArray[np.float32]:
        pixels = _sample_pixels(width, rows, supersampling)
        return _averaged(scene.radiance(sphere.unproject(pixels)), supersampling)

    return np.concatenate(list(ordered_map(executor, strip, _strips(sphere.size, supersampling))))


def window(
    scene: Scene,
    corner: ArrayLike,
    across: ArrayLike,
    down: ArrayLike,
    size: tuple[int, int],
    *,
    supersampling: int = 2,
    executor: Executor | None = None,
) -> NDArray[np.float32]:
    """What is seen through a flat window: linear light (height, width, 3).

    `corner` (3,) is the window's upper left corner from the camera's centre in the world frame, `across` and `down`
    (3,) its sides; pixel (u, v) looks along corner + (u + 0.5)/width across + (v + 0.5)/height down.
    """
    width, height = size
    a, b = np.asarray(across, float) / width, np.asarray(down, float) / height

    def strip(rows: slice) -> NDArray[np.float32]:
        pixels = _sample_pixels(width, rows, supersampling) + 0.5
        return _averaged(scene.radiance(np.asarray(corner) + pixels[..., :1] * a + pixels[..., 1:] * b), supersampling)

    return np.concatenate(list(ordered_map(executor, strip, _strips(size, supersampling))))


def _strips(size: tuple[int, int], supersampling: int) -> Iterator[slice]:
    """Whole rows of a picture, so many at a time that memory stays bounded.

    The strips depend on the picture's size only: noise is seeded by strip.
    """
    width, height = size
    rows = max(1, _SAMPLES_AT_ONCE // (width * supersampling**2))
    for top in range(0, height, rows):
        yield slice(top, min(top + rows, height))


def _sample_pixels(width: int, rows: slice, supersampling: int) -> FloatArray:
    """Pixel positions (rows * supersampling, width * supersampling, 2) spread evenly over each pixel."""
    u = (np.arange(width * supersampling) + 0.5) / supersampling - 0.5
    v = (np.arange(rows.start * supersampling, rows.stop * supersampling) + 0.5) / supersampling - 0.5
    return np.stack(np.broadcast_arrays(u[None, :], v[:, None]), -1)


def _averaged(samples: NDArray[np.float32], supersampling: int) -> NDArray[np.float32]:
    if supersampling == 1:
        return samples
    height, width = samples.shape[0] // supersampling, samples.shape[1] // supersampling
    return np.asarray(cv2.resize(samples, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def _blurred(light: NDArray[np.float32], sigma_px: float, reach: int) -> NDArray[np.float32]:
    side = 2 * reach + 1
    blurred = cv2.GaussianBlur(light, (side, side), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def _falloff(z: FloatArray, half_fov: float, vignetting: tuple[float, float]) -> NDArray[np.float32]:
    """Vignetting at cos(theta) = z; a pixel whose centre lies just outside the rim has that of the rim."""
    theta = np.where(np.isnan(z), half_fov, np.arccos(np.clip(z, -1.0, 1.0)))
    s = (theta / half_fov) ** 2
    return np.maximum(1 + vignetting[0] * s + vignetting[1] * s * s, 0.0).astype(np.float32)
