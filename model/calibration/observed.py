"""The points that a calibration used, one row a point: rays, angles, and residuals along and across the radius."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.bow import bow_shapes
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.points import Sightings
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_RIM = 1e-9  # radians kept between the outermost point and the edge of the field of view


class Observed(NamedTuple):
    """N points of all views, one view after the other.

    `view` (N,); `rays` (N, 3) predicted, in camera frames; `theta`, `phi` (N,) of these; `residuals` (N, 2); `outward`
    and `across` (N, 2), which give a residual's radial and tangential part as scalar products (on a picture stretched
    to square pixels); `bow` (N, 3, B) how the rays move with the values of the board's bow, if any.
    """

    view: NDArray[np.intp]
    rays: FloatArray
    theta: FloatArray
    phi: FloatArray
    residuals: FloatArray
    outward: FloatArray
    across: FloatArray
    bow: FloatArray

    @property
    def radial(self) -> FloatArray:
        """Radial residual (N,), positive where the prediction is too far out."""
        return np.asarray(np.sum(self.outward * self.residuals, -1))

    @property
    def tangential(self) -> FloatArray:
        """Tangential residual (N,), positive towards growing phi."""
        return np.asarray(np.sum(self.across * self.residuals, -1))


def observed(calibration: Calibration) -> Observed:
    """The points of all views that were used."""
    sightings, used = Sightings.of(calibration.views), np.concatenate(calibration.used)
    rays, view = sightings.rays(calibration.poses)[used], sightings.view[used]
    bow = np.zeros((len(rays), 3, 0))
    if calibration.bow_mm is not None:
        along_z = calibration.poses.camera_from_target[view, :, 2]
        bow = along_z[:, :, None] * bow_shapes(sightings.points)[used][:, None, :]
        rays = rays + bow @ np.array(calibration.bow_mm)
    phi, aspect = np.arctan2(rays[:, 1], rays[:, 0]), calibration.camera.aspect
    return Observed(
        view,
        rays,
        np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]),
        phi,
        np.concatenate(calibration.residuals_px)[used],
        np.stack([np.cos(phi), np.sin(phi) / aspect], -1),
        np.stack([-np.sin(phi), np.cos(phi) / aspect], -1),
        bow,
    )


def reaching(camera: Camera, theta: FloatArray) -> Camera:
    """The camera with a field of view that just holds the angles; CameraError if its lens does not reach them."""
    return dataclasses.replace(camera, half_fov=max(camera.half_fov, float(np.max(theta)) + _RIM))
