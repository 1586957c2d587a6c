"""A calibration -> camera.json, with what is known of its errors and where it came from."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fullsphere.model.calibration.calibrate import Calibration, curve_of
from fullsphere.model.files import sha256_of
from fullsphere.model.store import save_camera


def save_calibration(path: Path, calibration: Calibration, inputs: Sequence[Path], overwrite: bool = False) -> None:
    """Write the camera of a calibration, its curve with uncertainty, and its record.

    Parameters
    ----------
    path
        The camera.json to write.
    calibration
        What to write.
    inputs
        Files it was made from; their SHA-256 goes into the record.
    overwrite
        Whether a file at `path` may be replaced.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    curve = curve_of(calibration)
    sampled = {"theta_deg": curve.theta_deg, "r_px": curve.r_px, "sigma_px": curve.sigma_px}
    save_camera(path, calibration.camera, _record(calibration, inputs), sampled, overwrite)


def _record(calibration: Calibration, inputs: Sequence[Path]) -> dict[str, Any]:
    return {
        "rms_px": calibration.rms_px,
        "points": calibration.points,
        "views": len(calibration.views),
        "observed_theta_deg": list(calibration.observed_theta_deg),
        "covariance": {"of": list(calibration.camera.parameter_names), "values": calibration.covariance},
        "inputs": {file.name: sha256_of(file) for file in inputs},
        "program": f"fullsphere {version('fullsphere')}",
    }
