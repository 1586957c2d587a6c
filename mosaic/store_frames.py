"""The frames of a mosaic.json."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fullsphere.model.camera import MAX_SIDE_PX, Camera
from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import picture_profile, picture_size
from fullsphere.model.json_values import demand_keys, list_of, number_of, numbers_of, object_of, text_of, whole_of
from fullsphere.model.lens import FloatArray
from fullsphere.model.yaw_pitch_roll import angles_of_rotation, rotation_of_angles
from fullsphere.mosaic.camera_response import KNOTS, rises
from fullsphere.mosaic.loading import Crop, load_merged, load_pixels
from fullsphere.mosaic.masks import Mask, load_mask
from fullsphere.mosaic.project import Bracket, Frame, Picture

_COMMON = (
    "id", "image", "sha256", "size_px", "shot", "crop_px", "camera", "turned", "quarter_turns", "mask",
    "exposure_ev", "white_balance", "status",
)  # fmt: skip
_OPTIONAL = ("brackets", "response_ev")
_OF_BRACKET = ("image", "sha256", "exposure_ev")
_ANGLES = ("yaw_deg", "pitch_deg", "roll_deg")
_MAX_EV = 64.0
_MAX_WHITE_BALANCE = 100.0
_ORTHONORMAL = 1e-6  # a rotation computed in single precision is off by a tenth of it
_SAME_ROTATION = 1e-6  # radians, 0.00006 degrees: how far angles and a matrix may be apart that mean one rotation


def frames_to_list(frames: Sequence[Frame], folder: Path) -> list[dict[str, Any]]:
    """The frames as the file in `folder` holds them."""
    return [_frame(frame, folder) for frame in frames]


def frames_from_list(values: Sequence[Any], cameras: Sequence[Camera], where: str, folder: Path) -> tuple[Frame, ...]:
    """The frames that the file `where` holds, with paths relative to `folder`; raises InputError."""
    frames: list[Frame] = []
    place_of: dict[str, str] = {}
    for k, value in enumerate(values):
        place = f"{where}: frames[{k}]"
        frame = _read(object_of(value, place), cameras, place, folder)
        if frame.id in place_of:
            raise InputError(f"{place}: id {frame.id!r} is that of {place_of[frame.id]} too; each frame has its own")
        place_of[frame.id] = f"frames[{k}]"
        frames.append(frame)
    return tuple(frames)


def yaw_pitch_roll_deg(camera_from_world: FloatArray) -> tuple[float, float, float]:
    """Yaw (right), pitch (up) and roll (clockwise) in degrees: world_from_camera = Ry(yaw) Rx(pitch) Rz(roll)."""
    return angles_of_rotation(camera_from_world.T)


def rotation_of(data: dict[str, Any], key: str, where: str) -> FloatArray:
    """The rotation (3, 3) of a key, as it is written; InputError if it is none."""
    rows = list_of(data, key, where)
    if len(rows) != 3:
        raise InputError(f"{where}: {key} is not a matrix of 3 rows of 3 numbers")
    matrix = np.array([numbers_of({key: row}, key, where, 3) for row in rows])
    if np.abs(matrix).max() > 2 or not np.abs(matrix @ matrix.T - np.eye(3)).max() <= _ORTHONORMAL:
        raise InputError(f"{where}: {key} is not a rotation: its rows are not at right angles and of length 1")
    if np.linalg.det(matrix) < 0:
        raise InputError(f"{where}: {key} is not a rotation but mirrors; change the sign of a row")
    return matrix


def checked_pixels(
    path: Path, sha256: str, size: tuple[int, int], crop_px: Crop | None = None, turned: int = 0
) -> Picture:
    """The pixels (h, w, c) of a frame whose file has to be the one that was registered.

    Raises
    ------
    InputError
        If the file cannot be read, has another SHA-256 (unless that is empty: not known) or the frame another size.
    """
    if sha256 and sha256_of(path) != sha256:
        raise InputError(f"{path}: is not the picture that was registered, its content has changed; register anew")
    return _of_size(load_pixels(path, crop_px, turned), path, size)


def checked_light(
    brackets: Sequence[Bracket],
    path: Path,
    response_ev: Sequence[float],
    size: tuple[int, int],
    crop_px: Crop | None = None,
    turned: int = 0,
) -> Picture:
    """The light (h, w, c) of a frame whose brackets have to be the ones that were registered; `path` is one of them.

    Raises
    ------
    InputError
        As `load_merged`, or if the frame has another size.
    """
    return _of_size(load_merged(brackets, str(path), response_ev, crop_px, turned), path, size)


def _of_size(pixels: Picture, path: Path, size: tuple[int, int]) -> Picture:
    if pixels.shape[1::-1] != size:
        raise InputError(
            f"{path}: is a frame of {pixels.shape[1]} x {pixels.shape[0]} pixels, not {size[0]} x {size[1]}; "
            "register anew"
        )
    return pixels


def checked_mask(mask: Path, image: Path, frame: str, crop_px: Crop | None = None, turned: int = 0) -> Mask:
    """The mask (h, w) of a frame; raises InputError as `load_mask`."""
    return load_mask(mask, picture_size(image), frame, crop_px, turned)


def relative_path(image: str, folder: Path) -> str:
    """The picture's path seen from the folder, with forward slashes; as it is where there is no such path."""
    try:
        return Path(os.path.relpath(image, folder)).as_posix()
    except ValueError:  # another drive on Windows
        return Path(image).as_posix()


def _frame(frame: Frame, folder: Path) -> dict[str, Any]:
    common: dict[str, Any] = {
        "id": frame.id,
        "image": relative_path(frame.image, folder),
        "sha256": frame.sha256,
        "size_px": list(frame.size),
        "shot": frame.shot or frame.id,
        "crop_px": None if frame.crop_px is None else list(frame.crop_px),
        "camera": frame.camera,
        "turned": frame.turned,
        "quarter_turns": frame.quarter_turns,
        "mask": relative_path(frame.mask_image, folder) if frame.mask_image else None,
        "exposure_ev": frame.exposure_ev,
        "white_balance": list(frame.white_balance),
    }
    if frame.brackets:
        common["brackets"] = [
            {
                "image": relative_path(bracket.image, folder),
                "sha256": bracket.sha256,
                "exposure_ev": bracket.exposure_ev,
            }
            for bracket in frame.brackets
        ]
    if frame.response_ev:
        common["response_ev"] = list(frame.response_ev)
    if frame.camera_from_world is None or frame.reason:
        return {**common, "status": "left-out", "reason": frame.reason}
    return {
        **common,
        "status": "registered",
        "camera_from_world": frame.camera_from_world,
        **dict(zip(_ANGLES, yaw_pitch_roll_deg(frame.camera_from_world), strict=True)),
        "sigma_deg": frame.sigma_deg,
    }


def _read(data: dict[str, Any], cameras: Sequence[Camera], where: str, folder: Path) -> Frame:
    registered = data.get("status") == "registered"
    if not registered and data.get("status") != "left-out":
        raise InputError(f'{where}: status is {data.get("status")!r}, not "registered" or "left-out"')
    rotation_keys = ("camera_from_world", *_ANGLES)
    optional = (*_OPTIONAL, *rotation_keys) if registered else _OPTIONAL
    demand_keys(data, where, (*_COMMON, "sigma_deg" if registered else "reason"), optional)
    name, sha256 = text_of(data, "id", where), text_of(data, "sha256", where)
    if not name:
        raise InputError(f"{where}: id is empty")
    camera = whole_of(data, "camera", where, 0, len(cameras) - 1)
    size = _size(data, where, registered)
    if registered and size != cameras[camera].size:
        across, down = cameras[camera].size
        raise InputError(f"{where}: size_px is {size[0]} x {size[1]}, that of its camera {across} x {down}")
    image, crop = _path(data, "image", where, folder), _crop(data, where)
    mask = None if data["mask"] is None else _path(data, "mask", where, folder)
    turned = whole_of(data, "turned", where, 0, 3)
    _check_crop(crop, size, turned, where)
    shot, brackets = text_of(data, "shot", where), _brackets(data, image, sha256, where, folder)
    response = _response(data, where)
    load: Callable[[], Picture] = functools.partial(checked_pixels, image, sha256, size, crop, turned)
    if brackets:
        load = functools.partial(checked_light, brackets, image, response, size, crop, turned)
    return Frame(
        id=name,
        image=str(image),
        size=size,
        load=load,
        sha256=sha256,
        reason="" if registered else text_of(data, "reason", where),
        camera_from_world=_rotation(data, where) if registered else None,
        sigma_deg=number_of(data, "sigma_deg", where, 0) if registered and data["sigma_deg"] is not None else None,
        exposure_ev=number_of(data, "exposure_ev", where, -_MAX_EV, _MAX_EV),
        white_balance=_white_balance(data, where),
        camera=camera,
        shot="" if shot == name else shot,
        crop_px=crop,
        quarter_turns=whole_of(data, "quarter_turns", where, 0, 3),
        turned=turned,
        profile=None if brackets else functools.partial(picture_profile, image),
        mask=None if mask is None else functools.partial(checked_mask, mask, image, name, crop, turned),
        mask_image="" if mask is None else str(mask),
        brackets=brackets,
        response_ev=response,
    )


def _brackets(data: dict[str, Any], image: Path, sha256: str, where: str, folder: Path) -> tuple[Bracket, ...]:
    if "brackets" not in data:
        return ()
    found: list[Bracket] = []
    for k, value in enumerate(list_of(data, "brackets", where)):
        place = f"{where}: brackets[{k}]"
        one = object_of(value, place)
        demand_keys(one, place, _OF_BRACKET, ())
        path = str(_path(one, "image", place, folder))
        if path in (bracket.image for bracket in found):
            raise InputError(f"{place}: image is that of another bracket too")
        exposure = number_of(one, "exposure_ev", place, -_MAX_EV, _MAX_EV)
        found.append(Bracket(path, text_of(one, "sha256", place), exposure))
    if len(found) < 2:
        raise InputError(f"{where}: brackets are {len(found)}; a frame is merged of two or more, or has no such key")
    if (str(image), sha256) not in [bracket[:2] for bracket in found]:
        raise InputError(f"{where}: image and sha256 are those of none of its brackets")
    return tuple(found)


def _response(data: dict[str, Any], where: str) -> tuple[float, ...]:
    if "response_ev" not in data:
        return ()
    if "brackets" not in data:
        raise InputError(f"{where}: response_ev is about brackets, and the frame has none")
    response = tuple(numbers_of(data, "response_ev", where, KNOTS))
    if max(map(abs, response)) > _MAX_EV or not rises(response):
        raise InputError(f"{where}: response_ev: the light does not rise from black to white by it")
    return response


def _rotation(data: dict[str, Any], where: str) -> FloatArray:
    """By the angles where they and the matrix differ: they are what a person changes."""
    given = [key for key in _ANGLES if key in data]
    if not given and "camera_from_world" not in data:
        raise InputError(f"{where}: the key 'camera_from_world' is missing, and so are {', '.join(_ANGLES)}")
    if not given:
        return rotation_of(data, "camera_from_world", where)
    demand_keys(data, where, _ANGLES, data)
    limits = {"yaw_deg": 360.0, "pitch_deg": 90.0, "roll_deg": 360.0}
    angles = [number_of(data, key, where, -most, most) for key, most in limits.items()]
    by_angles = rotation_of_angles(*angles).T
    if "camera_from_world" not in data:
        return by_angles
    matrix = rotation_of(data, "camera_from_world", where)
    same = np.linalg.norm(matrix - by_angles) <= np.sqrt(2) * _SAME_ROTATION
    return matrix if same else by_angles


def _white_balance(data: dict[str, Any], where: str) -> tuple[float, float, float]:
    red, green, blue = numbers_of(data, "white_balance", where, 3)
    if not all(1 / _MAX_WHITE_BALANCE <= factor <= _MAX_WHITE_BALANCE for factor in (red, green, blue)):
        least, most = 1 / _MAX_WHITE_BALANCE, _MAX_WHITE_BALANCE
        raise InputError(f"{where}: white_balance is not three factors between {least:g} and {most:g}; 1 is neutral")
    return red, green, blue


def _size(data: dict[str, Any], where: str, registered: bool) -> tuple[int, int]:
    width, height = numbers_of(data, "size_px", where, 2)
    least = 1 if registered else 0  # a file that could not be read has no size
    if not all(side.is_integer() and least <= side <= MAX_SIDE_PX for side in (width, height)):
        raise InputError(f"{where}: size_px: {width:g} x {height:g} are not whole pixels, {least} to {MAX_SIDE_PX}")
    return int(width), int(height)


def _crop(data: dict[str, Any], where: str) -> Crop | None:
    if data["crop_px"] is None:
        return None
    left, top, width, height = numbers_of(data, "crop_px", where, 4)
    whole = all(number.is_integer() and abs(number) <= MAX_SIDE_PX for number in (left, top, width, height))
    if not (whole and min(left, top) >= 0 and min(width, height) >= 1):
        raise InputError(f"{where}: crop_px is not a left, top, width and height in whole pixels of a picture")
    return int(left), int(top), int(width), int(height)


def _check_crop(crop: Crop | None, size: tuple[int, int], turned: int, where: str) -> None:
    if crop is None or size == (0, 0):
        return
    width, height = crop[2:] if turned % 2 == 0 else crop[:1:-1]
    if (width, height) != size:
        raise InputError(f"{where}: crop_px leaves {width} x {height} pixels, size_px says {size[0]} x {size[1]}")


def _path(data: dict[str, Any], key: str, where: str, folder: Path) -> Path:
    text = text_of(data, key, where)
    if not text or "\0" in text:
        raise InputError(f"{where}: {key} is {text!r}, not the path of a file")
    return Path(os.path.normpath(folder / text))
