"""What no frame sees: left transparent, or continued smoothly from around it."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Projection
from fullsphere.model.colour import encoded_from_linear
from fullsphere.mosaic.compose import Band, compose
from fullsphere.mosaic.frame_colour import common_profile
from fullsphere.mosaic.planning import Plan
from fullsphere.mosaic.sphere_pyramid import continued

_ROWS = 64  # filled at once


class Filling:
    """The light of a panorama carried on to where nobody sees, by its picture on the working sphere.

    Parameters
    ----------
    plan
        As the panorama is composed by.
    executor
        Where the working sphere's picture is computed.
    """

    def __init__(self, plan: Plan, executor: Executor | None = None) -> None:
        self._sphere, self._profile = plan.shares.sphere, common_profile(plan.mosaic.registered)
        bands = compose(plan.mosaic, self._sphere, np.float32, executor, plan.shares, plan.exposure_ev)
        picture = np.concatenate([band.rows for band in bands])
        seen = np.ascontiguousarray(picture[..., 3])
        light = continued(picture[..., :3] * seen[..., None], seen)
        half = light.shape[1] // 2
        past_top, past_bottom = np.roll(light[:1], half, axis=1), np.roll(light[-1:], half, axis=1)
        rows = np.concatenate([past_top, light, past_bottom])
        self._light = np.concatenate([rows[:, -1:], rows, rows[:, :1]], axis=1)  # a pixel more on all sides

    def filled(self, band: Band, surface: Projection) -> Band:
        """A band with every pixel that no frame sees filled, where the surface looks anywhere at all."""
        if band.rows[..., 3].all():
            return band
        rows = band.rows.copy()
        for first in range(0, len(rows), _ROWS):
            self._fill(rows[first : first + _ROWS], band.top + first, surface)
        return Band(band.top, rows)

    def _fill(self, rows: NDArray[Any], top: int, surface: Projection) -> None:
        v, u = np.nonzero(rows[..., 3] == 0)
        if not v.size:
            return
        rays = surface.unproject(np.stack([u, v + top], -1).astype(float))
        at = self._sphere.project(rays).astype(np.float32) + np.float32(1)
        looks = np.isfinite(at[:, 0])
        v, u, at = v[looks], u[looks], at[looks]
        light = _sampled(self._light, at)
        rows[v, u, :3] = encoded_from_linear(light, rows.dtype, self._profile)
        rows[v, u, 3] = 1 if rows.dtype.kind == "f" else np.iinfo(rows.dtype).max


def _sampled(light: NDArray[np.float32], at: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, 3) between the pixels of (H, W, 3) at (n, 2)."""
    width = 1 << 12  # OpenCV takes maps with sides below 32767
    padded = np.zeros((-(-len(at) // width) * width, 2), np.float32)
    padded[: len(at)] = at
    maps = padded.reshape(-1, width, 2)
    values = cv2.remap(
        light, *(np.ascontiguousarray(maps[..., k]) for k in (0, 1)), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    sampled: NDArray[np.float32] = values.reshape(-1, 3)[: len(at)]
    return sampled
