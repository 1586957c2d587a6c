"""Frames -> a mosaic ready to be composed: registration, then photometry."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.frame_colour import colour_notes
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
    """Register the frames and even out how they recorded the light; see `register` for the parameters and errors."""
    mosaic = evened_out(register(frames, cameras, executor, progress, options, covariances), executor)
    return dataclasses.replace(mosaic, diagnosis=mosaic.diagnosis + colour_notes(mosaic.registered))


def evened_out(mosaic: Mosaic, executor: Executor | None = None) -> Mosaic:
    """The mosaic with exposures, white balance and vignetting as its registered frames tell them."""
    photometry = estimate_photometry(mosaic.registered, mosaic.cameras, executor)
    found = iter(zip(photometry.exposure_ev.tolist(), photometry.white_balance.tolist(), strict=True))
    return dataclasses.replace(
        mosaic,
        frames=tuple(_evened(frame, *next(found)) if frame.registered else frame for frame in mosaic.frames),
        vignetting_ev=photometry.vignetting_ev,
        shade_ev=photometry.shade_ev,
    )


def _evened(frame: Frame, exposure_ev: float, white_balance: list[float]) -> Frame:
    red, green, blue = white_balance
    return dataclasses.replace(frame, exposure_ev=exposure_ev, white_balance=(red, green, blue))
