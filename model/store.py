"""camera.json: a camera as a file that a person can write and any program can use (`docs/file-formats.md`).

It is read strictly: what is unknown, missing, out of range or contradicts itself is refused by the key's name.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, InputError
from fullsphere.model.files import read_json, write_json
from fullsphere.model.json_values import demand_keys, list_of, number_of, numbers_of, object_of
from fullsphere.model.lens import LENSES, FloatArray, Lens

FORMAT = "fullsphere-camera/1"

MAX_CURVE_ERROR_PX = 0.05
"""How far the sampled curve of a file may be off the lens beside it."""

_REQUIRED = ("format", "image_size_px", "lens", "centre_px", "aspect", "half_field_of_view_deg")
_OPTIONAL = ("calibration", "curve")
_ROUNDING = 1e-12  # of an angle that went through degrees and back


def load_camera(path: Path) -> Camera:
    """Read a camera.json.

    Raises
    ------
    InputError
        If the file cannot be read or describes no camera; names the file and the key.
    """
    return camera_from_dict(read_json(path), str(path))


def load_covariance(path: Path) -> FloatArray | None:
    """The covariance (P, P) of a camera.json's values, in the order of the camera's `parameter_names`.

    None where the file tells of none, or of another set of values.

    Raises
    ------
    InputError
        If the file cannot be read, or what it holds is no covariance; names the file and the key.
    """
    value = read_json(path)
    camera = camera_from_dict(value, str(path))
    record = value.get("calibration", {}).get("covariance")
    if record is None:
        return None
    where = f"{path}: calibration: covariance"
    record = object_of(record, where)
    demand_keys(record, where, ("of", "values"), ())
    names = list_of(record, "of", where)
    rows = [numbers_of({"values": row}, "values", where, len(names)) for row in list_of(record, "values", where)]
    matrix = np.array(rows).reshape(len(rows), len(names))
    if len(rows) != len(names) or not np.allclose(matrix, matrix.T, rtol=1e-6) or (np.diag(matrix) < 0).any():
        raise InputError(f"{where}: is not a symmetric matrix with a row for each of its names")
    if set(names) != set(camera.parameter_names):
        return None
    order = [names.index(name) for name in camera.parameter_names]
    return matrix[np.ix_(order, order)]


def save_camera(
    path: Path,
    camera: Camera,
    calibration: Mapping[str, Any] | None = None,
    curve: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a camera.json; the arguments are those of `camera_to_dict`.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    write_json(path, camera_to_dict(camera, calibration, curve), overwrite)


def camera_to_dict(
    camera: Camera, calibration: Mapping[str, Any] | None = None, curve: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """A camera as the content of a camera.json.

    Parameters
    ----------
    camera
        The camera.
    calibration
        How it was found: RMS, covariance, inputs.
    curve
        `theta_deg`, `r_px` and, where it is known, `sigma_px`; by default the lens in whole degrees, without
        `sigma_px`.
    """
    value = {
        "format": FORMAT,
        "image_size_px": list(camera.size),
        "lens": {
            "projection": camera.lens.projection,
            **{p.key: v for p, v in zip(camera.lens.parameters, camera.lens.values, strict=True)},
        },
        "centre_px": list(camera.centre),
        "aspect": camera.aspect,
        "half_field_of_view_deg": math.degrees(camera.half_fov),
        "curve": _sampled(camera) if curve is None else {key: np.asarray(v).tolist() for key, v in curve.items()},
    }
    return value if calibration is None else {**value, "calibration": dict(calibration)}


def camera_from_dict(value: Any, where: str, besides: Collection[str] = ()) -> Camera:
    """The camera that the content of a camera.json describes.

    Parameters
    ----------
    value
        What JSON held; its numbers are finite.
    where
        What errors name: the file, and the place in it.
    besides
        Keys that may stand there too, because the file that holds the camera gives them a meaning.

    Raises
    ------
    InputError
        If a key is missing or unknown, a value is of the wrong kind or out of range, the lens does not grow over its
        field of view, or the curve is not that of the lens.
    """
    data = object_of(value, where)
    if data.get("format") != FORMAT:
        raise InputError(f'{where}: format is {data.get("format")!r}, not "{FORMAT}"; is it a camera file?')
    demand_keys(data, where, _REQUIRED, (*_OPTIONAL, *besides))
    width, height = numbers_of(data, "image_size_px", where, 2)
    if not (width.is_integer() and height.is_integer()):
        raise InputError(f"{where}: image_size_px: {width} x {height} are not whole pixels")
    half_fov = math.radians(number_of(data, "half_field_of_view_deg", where))
    lens = _lens(data["lens"], f"{where}: lens")
    if lens.theta_max < half_fov <= lens.theta_max * (1 + _ROUNDING):
        half_fov = lens.theta_max
    camera = Camera(lens, (1, 1), (0.0, 0.0), half_fov=1e-3 * lens.theta_max)
    changes: dict[str, dict[str, Any]] = {  # one at a time, so that an error can be laid to its key
        "image_size_px": {"size": (int(width), int(height))},
        "centre_px": {"centre": tuple(numbers_of(data, "centre_px", where, 2))},
        "aspect": {"aspect": number_of(data, "aspect", where)},
        "half_field_of_view_deg": {"half_fov": half_fov},
    }
    for key, change in changes.items():
        try:
            camera = dataclasses.replace(camera, **change)
        except CameraError as error:
            raise InputError(f"{where}: {key}: {error}") from error
    if "calibration" in data:
        object_of(data["calibration"], f"{where}: calibration")
    if "curve" in data:
        _check_curve(data["curve"], camera, f"{where}: curve")
    return camera


def _sampled(camera: Camera) -> dict[str, list[float]]:
    theta_deg = np.arange(math.floor(math.degrees(camera.half_fov) * (1 + _ROUNDING)) + 1.0)
    r_px = camera.lens.radius(np.minimum(np.radians(theta_deg), camera.half_fov))
    return {"theta_deg": theta_deg.tolist(), "r_px": r_px.tolist()}


def _lens(value: Any, where: str) -> Lens:
    data = object_of(value, where)
    kind = LENSES.get(data["projection"]) if isinstance(data.get("projection"), str) else None
    if kind is None:
        raise InputError(f"{where}.projection is {data.get('projection')!r}; known are {', '.join(LENSES)}")
    keys = [parameter.key for parameter in kind.parameters]
    demand_keys(data, where, ("projection", *keys), ())
    try:
        return kind(*(number_of(data, key, where) for key in keys))
    except CameraError as error:
        raise InputError(f"{where}: {error}") from error


def _check_curve(value: Any, camera: Camera, where: str) -> None:
    data = object_of(value, where)
    demand_keys(data, where, ("theta_deg", "r_px"), ("sigma_px",))
    theta_deg, r_px = np.array(numbers_of(data, "theta_deg", where)), np.array(numbers_of(data, "r_px", where))
    if not theta_deg.size == r_px.size > 0:
        raise InputError(f"{where}: theta_deg and r_px hold {theta_deg.size} and {r_px.size} numbers")
    for key, samples in (("theta_deg", theta_deg), ("r_px", r_px)):
        if not (np.diff(samples) > 0).all():
            raise InputError(f"{where}.{key} does not grow from each sample to the next")
    edge = math.degrees(camera.half_fov)
    if theta_deg[0] < 0 or theta_deg[-1] > edge * (1 + 1e-9):
        raise InputError(f"{where}.theta_deg is not within 0 and half_field_of_view_deg = {edge:g}")
    if "sigma_px" in data:
        sigma = numbers_of(data, "sigma_px", where, theta_deg.size)
        if min(sigma) < 0:
            raise InputError(f"{where}.sigma_px holds a negative number")
    gaps = np.abs(camera.lens.radius(np.minimum(np.radians(theta_deg), camera.half_fov)) - r_px)
    worst = int(gaps.argmax())
    if not gaps[worst] <= MAX_CURVE_ERROR_PX:
        raise InputError(
            f"{where}.r_px is {gaps[worst]:.3g} px off the lens at {theta_deg[worst]:g} degrees; "
            "correct the lens, or leave the curve out"
        )
