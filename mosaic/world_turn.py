"""A camera on a turning arm in a world of near and far things, and what its mosaic ought to show.

room = furnished_room()
for angle in np.radians(np.arange(0, 360, 5)):
    frame = photograph_on_arm(room, camera, angle, arm=0.15)
truth = true_mosaic(room, 0.15, 1024)
"""

from __future__ import annotations

from concurrent.futures import Executor
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Mosaic360
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import positions, turned
from fullsphere.mosaic.photographer import Scene, photograph

_STRAIGHT = np.eye(3)
_COLUMNS = 32  # of the truth, made at once


class Place(Scene, Protocol):
    """A scene as it looks from one place."""

    def distance(self, rays: ArrayLike) -> FloatArray:
        """How far along rays (..., 3) something is met (...), in lengths of the ray."""
        ...


class World(Protocol):
    """A scene with near and far things, that can be looked at from several places."""

    def seen_from(self, position: ArrayLike) -> Place:
        """The same from another place (3,)."""
        ...


class TrueMosaic(NamedTuple):
    """Linear light (W, W, 3) of a mosaic, and the range (W, W) of what it shows from the turning axis, in arms."""

    light: NDArray[np.float32]
    rho: FloatArray


def photograph_on_arm(
    world: World,
    camera: Camera,
    angle: float,
    arm: float,
    *,
    mount: FloatArray = _STRAIGHT,
    exposure_ev: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    supersampling: int = 2,
    executor: Executor | None = None,
) -> NDArray[np.uint8]:
    """A frame of a camera that turns about the y axis of a world, on an arm of its unit of length; see `photograph`.

    `mount` is camera_from_arm (3, 3), `angle` the turn in radians, to the right.
    """
    return photograph(
        world.seen_from(arm * positions(angle)),
        camera,
        mount @ turned(angle).T,
        exposure_ev=exposure_ev,
        noise=noise,
        seed=seed,
        supersampling=supersampling,
        executor=executor,
    )


def true_mosaic(
    world: World, arm: float, width: int, *, supersampling: int = 2, executor: Executor | None = None
) -> TrueMosaic:
    """What the 360 x 360 mosaic of a world shows (`Mosaic360`): every ray from its own point of the circle.

    The range of a ray that leaves its point of the circle as a tangent is rho^2 = 1 + (its horizontal part)^2.
    """
    fine = Mosaic360((width * supersampling, width * supersampling))
    height = fine.size[1]
    horizontal = np.abs(fine.row_profile(slice(0, height))[:, 0])

    def made(columns: slice) -> tuple[NDArray[Any], FloatArray]:
        rays = fine.window_rays(columns, slice(0, height))
        angles = (np.arange(columns.start, columns.stop) + 0.5) * (2 * np.pi / width / supersampling)
        light, reach = np.empty(rays.shape, np.float32), np.empty(rays.shape[:2])
        for k, angle in enumerate(angles):
            place = world.seen_from(arm * positions(angle))
            light[:, k], reach[:, k] = place.radiance(rays[:, k]), place.distance(rays[:, k])
        rho = np.hypot(reach / arm * horizontal[:, None], 1)
        size = (len(angles) // supersampling, height // supersampling)
        middle = supersampling // 2
        return cv2.resize(light, size, interpolation=cv2.INTER_AREA), rho[middle::supersampling, middle::supersampling]

    step = _COLUMNS * supersampling
    parts = list(ordered_map(executor, made, (slice(x, min(x + step, height)) for x in range(0, height, step))))
    return TrueMosaic(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True)))
