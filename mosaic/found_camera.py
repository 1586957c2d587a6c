"""The camera that a registration found or refined -> camera.json, with the uncertainty that the frames leave."""

from __future__ import annotations

import math
from importlib.metadata import version
from pathlib import Path

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import save_camera
from fullsphere.mosaic.project import Mosaic


def curve_sigma_px(camera: Camera, covariance: FloatArray, theta: FloatArray) -> FloatArray:
    """Standard deviation (n,) of r(theta) at angles (n,), from the covariance (P, P) of a camera's values."""
    own = len(camera.lens.values)
    by_value = np.asarray(camera.lens.radius_by_parameter(theta)).reshape(len(theta), own)
    variance = np.einsum("ti,ij,tj->t", by_value, covariance[:own, :own], by_value)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def save_found_camera(path: Path, mosaic: Mosaic, overwrite: bool = False) -> None:
    """Write the first camera of a mosaic, its curve with uncertainty where it was estimated, and where it comes from.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    camera = mosaic.camera
    if not mosaic.camera_covariances:
        save_camera(path, camera, overwrite=overwrite)
        return
    covariance = mosaic.camera_covariances[0]
    theta_deg = np.arange(math.floor(math.degrees(camera.half_fov) + 1e-9) + 1.0)
    theta = np.minimum(np.radians(theta_deg), camera.half_fov)
    sigma = curve_sigma_px(camera, covariance, theta)
    record = {
        "rms_px": mosaic.quality["residual_rms_px"],
        "points": int(mosaic.quality["matches"]),
        "views": len(mosaic.registered),
        "covariance": {"of": list(camera.parameter_names), "values": covariance},
        "inputs": {frame.id: frame.sha256 for frame in mosaic.registered},
        "program": f"fullsphere {version('fullsphere')}",
    }
    curve = {"theta_deg": theta_deg, "r_px": camera.lens.radius(theta), "sigma_px": sigma}
    save_camera(path, camera, record, curve, overwrite)
