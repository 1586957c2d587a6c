"""A quick look at a panorama: the frames' pictures on the working sphere, mixed softly."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.mosaic.overview import overviews, working_sphere
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.reference import Exposure, compensated, reference_ev


class Glimpse(NamedTuple):
    """The whole sphere (H, W, 4), light in the frames' colour space and coverage, and how much brighter it was made."""

    picture: NDArray[np.float32]
    exposure_ev: float


def glimpse(mosaic: Mosaic, exposure: Exposure, executor: Executor | None = None) -> Glimpse:
    """All frames together, each weighted by how well it sees; raises as `planned` does."""
    mosaic = compensated(mosaic, exposure)
    seen = overviews(mosaic, working_sphere(mosaic), executor)
    brighter = reference_ev(mosaic, exposure, seen)
    height, width = seen[0].quality.shape
    picture = np.zeros((height, width, 4), np.float32)
    for one in seen:
        picture[..., :3] += one.light * one.quality[..., None]
        picture[..., 3] += one.quality
    covered = picture[..., 3] > 0
    picture[covered, :3] *= np.float32(2.0**brighter) / picture[covered, 3:]
    picture[..., 3] = covered
    return Glimpse(picture, brighter)
