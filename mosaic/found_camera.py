"""The camera that a registration found or refined -> camera.json, with the uncertainty that the frames leave."""

from __future__ import annotations

import math
from importlib.metadata import version
from pathlib import Path

import numpy as np

from fullsphere.model.store import save_camera
from fullsphere.mosaic.project import Mosaic


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
    by_value = camera.lens.radius_by_parameter(theta)
    own = covariance[: by_value.shape[-1], : by_value.shape[-1]]
    sigma = np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", by_value, own, by_value), 0))
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
