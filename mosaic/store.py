"""mosaic.json: the solved project as a file that a person can read and change (`docs/file-formats.md`).

It is read strictly, as a camera.json is: what is unknown, missing, out of range or contradicts itself is refused by the
key's name.  A mosaic that was read is written again with the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError
from fullsphere.model.files import read_json, write_json
from fullsphere.model.json_values import demand_keys, list_of, number_of, numbers_of, object_of, text_of
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import camera_from_dict, camera_to_dict
from fullsphere.mosaic.edge_shade import KNOTS
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.store_frames import frames_from_list, frames_to_list, rotation_of, yaw_pitch_roll_deg
from fullsphere.mosaic.store_links import links_from_list, links_to_list

__all__ = ["FORMAT", "load_mosaic", "mosaic_from_dict", "mosaic_to_dict", "save_mosaic", "yaw_pitch_roll_deg"]

FORMAT = "fullsphere-mosaic/1"

_REQUIRED = ("format", "cameras", "frames", "links", "level", "quality")
_OPTIONAL = ("diagnosis",)
_OF_CAMERA = ("vignetting", "edge_shade", "camera_from_rig")
_MAX_EV = 64.0


def load_mosaic(path: Path) -> Mosaic:
    """Read a mosaic.json.

    The pictures are opened when their frames are asked for pixels.  A frame's `load` and `mask` raise InputError if
    the file is missing then, has another size, or is no longer the one that was registered (its SHA-256 differs).

    Raises
    ------
    InputError
        If the file cannot be read or describes no mosaic; names the file and the key.
    """
    path = Path(path)
    return mosaic_from_dict(read_json(path), str(path), path.parent)


def save_mosaic(path: Path, mosaic: Mosaic, overwrite: bool = False) -> None:
    """Write a mosaic; paths of pictures are stored relative to the file.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    path = Path(path)
    write_json(path, mosaic_to_dict(mosaic, path.parent), overwrite)


def mosaic_to_dict(mosaic: Mosaic, folder: Path) -> dict[str, Any]:
    """The content of mosaic.json for a file in `folder`."""
    return {
        "format": FORMAT,
        "cameras": [_camera(mosaic, k) for k in range(len(mosaic.cameras))],
        "frames": frames_to_list(mosaic.frames, folder),
        "links": links_to_list(mosaic),
        "level": mosaic.level,
        "quality": dict(mosaic.quality, self_calibrated=mosaic.self_calibrated),
        "diagnosis": list(mosaic.diagnosis),
    }


def mosaic_from_dict(value: Any, where: str, folder: Path) -> Mosaic:
    """The mosaic that the content of a mosaic.json describes.

    Parameters
    ----------
    value
        What JSON held; its numbers are finite.
    where
        What errors name: the file.
    folder
        Where the paths of pictures start.

    Raises
    ------
    InputError
        If a key is missing or unknown, or a value is of the wrong kind, out of range, or contradicts another.
    """
    data = object_of(value, where)
    if data.get("format") != FORMAT:
        raise InputError(f'{where}: format is {data.get("format")!r}, not "{FORMAT}"; is it a mosaic file?')
    demand_keys(data, where, _REQUIRED, _OPTIONAL)
    stored = list_of(data, "cameras", where)
    if not stored:
        raise InputError(f"{where}: cameras: there is none; a mosaic has one or more")
    places = [f"{where}: cameras[{k}]" for k in range(len(stored))]
    cameras = tuple(
        camera_from_dict(value, place, besides=_OF_CAMERA) for value, place in zip(stored, places, strict=True)
    )
    frames = frames_from_list(list_of(data, "frames", where), cameras, where, folder)
    quality = object_of(data["quality"], f"{where}: quality")
    return Mosaic(
        cameras=cameras,
        frames=frames,
        links=links_from_list(list_of(data, "links", where), frames, where),
        vignetting_ev=_vignetting(stored, places),
        shade_ev=_shades(stored, places),
        level=text_of(data, "level", where),
        self_calibrated=_truth(quality, "self_calibrated", f"{where}: quality"),
        quality={key: _as_written(quality, key, f"{where}: quality") for key in quality if key != "self_calibrated"},
        camera_from_rig=_mounts(stored, places),
        camera_covariances=_covariances(stored, cameras, places),
        diagnosis=tuple(_sentences(data, where)),
    )


def _camera(mosaic: Mosaic, k: int) -> dict[str, Any]:
    camera = mosaic.cameras[k]
    record: dict[str, Any] | None = None
    if mosaic.camera_covariances:
        record = {"covariance": {"of": list(camera.parameter_names), "values": mosaic.camera_covariances[k]}}
    value = {**camera_to_dict(camera, record), "vignetting": list(mosaic.vignetting_of(k))}
    if mosaic.shade_of(k):
        value["edge_shade"] = list(mosaic.shade_of(k))
    return {**value, "camera_from_rig": mosaic.camera_from_rig[k]} if mosaic.camera_from_rig else value


def _vignetting(stored: list[Any], places: list[str]) -> tuple[tuple[float, float], ...]:
    found = []
    for value, place in zip(stored, places, strict=True):
        demand_keys(value, place, ["vignetting"], value)
        w1, w2 = numbers_of(value, "vignetting", place, 2)
        if max(abs(w1), abs(w2)) > _MAX_EV:
            raise InputError(f"{place}: vignetting is not between -{_MAX_EV:g} and {_MAX_EV:g} EV")
        found.append((w1, w2))
    return tuple(found)


def _shades(stored: list[Any], places: list[str]) -> tuple[tuple[float, ...], ...]:
    if not any("edge_shade" in value for value in stored):
        return ()
    found = []
    for value, place in zip(stored, places, strict=True):
        shade = numbers_of(value, "edge_shade", place, len(KNOTS) - 1) if "edge_shade" in value else []
        if any(not -_MAX_EV <= ev <= 0 for ev in shade):
            raise InputError(f"{place}: edge_shade is not between -{_MAX_EV:g} and 0 EV")
        found.append(tuple(shade))
    return tuple(found)


def _mounts(stored: list[Any], places: list[str]) -> tuple[FloatArray, ...]:
    if not any("camera_from_rig" in value for value in stored):
        return ()
    for value, place in zip(stored, places, strict=True):
        if "camera_from_rig" not in value:
            raise InputError(f"{place}: the key 'camera_from_rig' is missing, and other cameras have it")
    return tuple(rotation_of(v, "camera_from_rig", place) for v, place in zip(stored, places, strict=True))


def _covariances(stored: list[Any], cameras: tuple[Camera, ...], places: list[str]) -> tuple[FloatArray, ...]:
    if not all("covariance" in value.get("calibration", {}) for value in stored):
        return ()
    return tuple(
        _covariance(value["calibration"]["covariance"], camera, f"{place}: calibration.covariance")
        for value, camera, place in zip(stored, cameras, places, strict=True)
    )


def _covariance(value: Any, camera: Camera, where: str) -> FloatArray:
    data = object_of(value, where)
    demand_keys(data, where, ("of", "values"), ())
    names = camera.parameter_names
    if data["of"] != list(names):
        raise InputError(f"{where}: of is not the list of this camera's values, {', '.join(names)}")
    rows = list_of(data, "values", where)
    if len(rows) != len(names):
        raise InputError(f"{where}: values has {len(rows)} rows, not {len(names)}")
    matrix = np.array([numbers_of({"values": row}, "values", where, len(names)) for row in rows])
    if (np.diag(matrix) < 0).any():
        raise InputError(f"{where}: values has a negative variance")
    return matrix


def _truth(data: Mapping[str, Any], key: str, where: str) -> bool:
    demand_keys(dict(data), where, [key], data)
    if not isinstance(data[key], bool):
        raise InputError(f"{where}: {key} is {data[key]!r}, not true or false")
    return bool(data[key])


def _as_written(data: dict[str, Any], key: str, where: str) -> float:
    """A number, whole where it was written whole."""
    number_of(data, key, where)
    return data[key]  # type: ignore[no-any-return]


def _sentences(data: dict[str, Any], where: str) -> list[str]:
    said = list_of(data, "diagnosis", where) if "diagnosis" in data else []
    return [text_of({f"diagnosis[{k}]": text}, f"diagnosis[{k}]", where) for k, text in enumerate(said)]
