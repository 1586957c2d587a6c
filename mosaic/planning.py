"""What is settled before a panorama is rendered: its frames' light, who gives what, how bright it is, and how large."""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from fullsphere.model.camera import Projection
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.automatic_mask import without_turning_things
from fullsphere.mosaic.compose import Blend, plan
from fullsphere.mosaic.overview import overviews, working_sphere
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.reference import Exposure, compensated, reference_ev
from fullsphere.mosaic.shares import Shares

_AS_USUAL = Exposure()
_MULTIPLE_PX = 16
_SAMPLES = 256  # along a side of a surface that is asked whether it shows anything


class Plan(NamedTuple):
    """What `compose` takes: the mosaic after `compensated`, what each frame gives, and how bright the picture is.

    `notes` are sentences on what was done that a person may want otherwise.
    """

    mosaic: Mosaic
    shares: Shares
    exposure_ev: float
    notes: tuple[str, ...] = ()


def planned(
    mosaic: Mosaic,
    exposure: Exposure = _AS_USUAL,
    blend: Blend = "multiband",
    executor: Executor | None = None,
    hide_turning: bool = True,
) -> Plan:
    """Look at every registered frame once, and settle what a panorama of them is to be.

    With `hide_turning` what turns with a camera is hidden (not of frames that are mixed softly, which is to be quick).

    Raises
    ------
    UsageError
        If the exposure follows a frame that is not there.
    InputError
        If a frame cannot be read.
    """
    mosaic = compensated(mosaic, exposure)
    sphere = working_sphere(mosaic)
    seen = overviews(mosaic, sphere, executor)
    brighter = reference_ev(mosaic, exposure, seen)
    notes: list[str] = []
    if hide_turning and blend != "feather":
        mosaic, shares = without_turning_things(mosaic, seen, executor)
        notes = [_of_hidden(k, share, len(shares)) for k, share in enumerate(shares) if share]
        if notes:
            seen = overviews(mosaic, sphere, executor)
    return Plan(mosaic, plan(mosaic, executor, blend, seen), brighter, tuple(notes))


def _of_hidden(camera: int, share: float, cameras: int) -> str:
    where = "its pictures" if cameras == 1 else f"the pictures of camera {camera + 1}"
    return f"something turns with the camera and is hidden: {100 * share:.1f} % of {where}"


def turned_to(mosaic: Mosaic, world_from_surface: FloatArray) -> Mosaic:
    """The mosaic in a world that is a surface's own: what the surface's rays are is what its frames see there."""
    if np.array_equal(world_from_surface, np.eye(3)):
        return mosaic
    frames = tuple(
        dataclasses.replace(frame, camera_from_world=frame.camera_from_world @ world_from_surface)
        if frame.camera_from_world is not None
        else frame
        for frame in mosaic.frames
    )
    return dataclasses.replace(mosaic, frames=frames)


def own_width(mosaic: Mosaic) -> int:
    """The width of a whole sphere that has as many pixels a radian as the finest frame has on its axis; times of 16."""
    finest = max(_per_radian(mosaic, frame.camera) for frame in mosaic.registered)
    return max(_MULTIPLE_PX, _MULTIPLE_PX * round(2 * math.pi * finest / _MULTIPLE_PX))


def shows_anything(plan: Plan, surface: Projection) -> bool:
    """Whether any frame sees anything near some of the directions that a surface shows."""
    (width, height), (across, down) = plan.shares.sphere.size, surface.size
    u, v = (np.linspace(0, side - 1, min(side, _SAMPLES)) for side in (across, down))
    at = plan.shares.sphere.project(surface.unproject(np.stack(np.meshgrid(u, v), -1)))
    at = np.round(at[np.isfinite(at[..., 0])]).astype(np.intp)
    near = plan.shares.seeing[np.clip(at[:, 1], 0, height - 1), at[:, 0] % width]
    return bool(near.any())


def _per_radian(mosaic: Mosaic, camera: int) -> float:
    own = mosaic.cameras[camera]
    return float(own.lens.slope(0.0)) * math.sqrt(own.aspect)
