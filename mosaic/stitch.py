"""Frames -> a mosaic ready to be composed: registration, then photometry."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.links import Progress
from fullsphere.mosaic.options import DEFAULT, Options
from fullsphere.mosaic.photometry import estimate_photometry
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.register import no_progress, register


def solve(
    frames: Sequence[Frame],
    cameras: Camera | Sequence[Camera] | None = None,
    executor: Executor | None = None,
    progress: Progress = no_progress,
    options: Options = DEFAULT,
    covariances: Sequence[FloatArray | None] = (),
) -> Mosaic:
    """Register the frames and even out their exposure; see `register` for the parameters and errors."""
    mosaic = register(frames, cameras, executor, progress, options, covariances)
    photometry = estimate_photometry(mosaic.registered, mosaic.cameras, executor)
    exposure = iter(photometry.exposure_ev.tolist())
    evened = tuple(
        dataclasses.replace(frame, exposure_ev=next(exposure)) if frame.registered else frame for frame in mosaic.frames
    )
    return dataclasses.replace(mosaic, frames=evened, vignetting_ev=(photometry.vignetting_ev,) * len(mosaic.cameras))
