"""The pictures of a Hugin project: lens, part used, orientation and exposure of each."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import CameraError, InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import picture_profile
from fullsphere.model.store import camera_from_dict
from fullsphere.model.yaw_pitch_roll import rotation_of_angles
from fullsphere.mosaic.loading import Crop, loader
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.pto_fit import FittedCamera, camera_of, clipped, difference_px
from fullsphere.mosaic.pto_lens import PanoToolsLens
from fullsphere.mosaic.pto_masks import masked
from fullsphere.mosaic.pto_text import PtoLine, checked_number
from fullsphere.mosaic.pto_vignetting import vignetting_of

RECORD = "#-fullsphere "
"""Begins the comment before a picture that tells which camera and part of the file its values stand for."""

_OF_CAMERA = ("camera", "crop_px", "error_px")
_LENS_VALUES = {"a": 100.0, "b": 100.0, "c": 100.0, "d": 1e7, "e": 1e7, "g": 1e7, "t": 1e7}
_ANGLE, _EV, _LIGHT = 1e4, 64.0, 1e6
_SAME_PX = 1e-3
_SAME_VIGNETTING_EV = 0.05
_NEAR_EV = 1.0
_MOST_TINT = 100.0


class PtoImages(NamedTuple):
    """Frames, the lens of each and whether its camera was recorded, cameras, their vignetting, and what was left."""

    frames: list[Frame]
    lenses: list[PanoToolsLens]
    recorded: list[bool]
    cameras: list[FittedCamera]
    vignetting_ev: tuple[tuple[float, float], ...]
    notes: list[str]


class _Part(NamedTuple):
    """The part of a file that a picture is, None for all, its camera, and whether a comment told it."""

    crop: Crop | None
    fitted: FittedCamera
    recorded: bool = False


def read_images(every: Sequence[PtoLine], path: Path) -> PtoImages:
    """The pictures of the lines of a project; their files are named relative to `path`, the project's.

    Raises
    ------
    InputError
        If there is none, or a value is missing, no number or out of range.
    """
    written = [line for line in every if line.kind == "i"]
    if not written:
        raise InputError(f"{path}: holds no picture, so it is no Hugin project")
    lines = [_resolved(written, k) for k in range(len(written))]
    reference = _reference_ev(lines, next((line for line in every if line.kind == "p"), None))
    lenses = [_lens(line) for line in lines]
    records = [_record(line) for line in lines]
    keys = [
        (lens, _crop(line, lens), json.dumps([record.get(key) for key in _OF_CAMERA]) if record else "")
        for line, lens, record in zip(lines, lenses, records, strict=True)
    ]
    parts: dict[tuple[PanoToolsLens, Crop | None, str], _Part] = {}
    for line, key, record in zip(lines, keys, records, strict=True):
        if key not in parts:
            parts[key] = _part(line.where, *key[:2], record)
    files = [_file(line, path.parent) for line in lines]
    frames = [
        dataclasses.replace(
            _frame(line, file, parts[key], reference), id=name, camera=list(parts).index(key), shot=shot
        )
        for line, file, key, (name, shot) in zip(lines, files, keys, _names(files, records), strict=True)
    ]
    frames, mask_notes = masked(frames, [line for line in every if line.kind == "k"], [lenses.index(x) for x in lenses])
    vignetting, notes = _vignetting(lines, lenses, [list(parts).index(key) for key in keys], list(parts.values()))
    notes = [note for line in lines for note in _left_behind(line)] + mask_notes + notes
    return PtoImages(
        frames,
        lenses,
        [parts[key].recorded for key in keys],
        [part.fitted for part in parts.values()],
        vignetting,
        notes,
    )


def _resolved(lines: Sequence[PtoLine], k: int) -> PtoLine:
    """A line with the values that it shares with other pictures (`v=0`) in their place."""
    values = dict(lines[k].values)
    for key in values:
        seen, at = {k}, k
        while (following := lines[at].reference(key)) is not None:
            if following >= len(lines) or following in seen:
                raise InputError(f"{lines[k].where}: {key}={following} leads to no picture that has a value")
            seen.add(following)
            at = following
        values[key] = lines[at].values.get(key, "")
        if at != k and not values[key]:
            raise InputError(f"{lines[k].where}: {key}={at} leads to no picture that has a value")
    return dataclasses.replace(lines[k], values=values)


def _lens(line: PtoLine) -> PanoToolsLens:
    size = line.whole("w", lower=1, upper=MAX_SIDE_PX), line.whole("h", lower=1, upper=MAX_SIDE_PX)
    values = {key: line.number(key, 0.0, most) for key, most in _LENS_VALUES.items()}
    try:
        return PanoToolsLens(size, line.whole("f"), line.number("v"), **values)
    except CameraError as error:
        raise InputError(f"{line.where}: {error}") from error


def _crop(line: PtoLine, lens: PanoToolsLens) -> Crop | None:
    """Left, top, width and height; it may reach past the picture."""
    text = line.values.get("S") or line.values.get("C")
    if not text:
        return None
    numbers = [checked_number(part, f"{line.where}: S", MAX_SIDE_PX) for part in text.split(",")]
    if len(numbers) != 4:
        raise InputError(f"{line.where}: S{text} is not left, right, top and bottom of a part")
    left, right, top, bottom = (round(number) for number in numbers)
    if right <= left or bottom <= top:
        return None
    crop = (left, top, right - left, bottom - top)
    if min(clipped(crop, lens.size)[2:]) <= 0:
        raise InputError(f"{line.where}: S{text} is no part of the {lens.size[0]} x {lens.size[1]} pixels")
    return crop


def _record(line: PtoLine) -> dict[str, Any]:
    """What the comment before a picture tells; empty where there is none, or it is damaged."""
    try:
        data = json.loads(line.comment(RECORD) or "{}")
    except ValueError:
        return {}
    return data if isinstance(data, dict) else {}


def _part(where: str, lens: PanoToolsLens, crop: Crop | None, record: Mapping[str, Any]) -> _Part:
    recorded = _recorded(lens, record) if record else None
    if recorded is not None:
        return recorded
    try:
        fitted = camera_of(lens, crop)
    except CameraError as error:
        raise InputError(f"{where}: {error}") from error
    inside = None if crop is None else clipped(crop, lens.size)
    return _Part(None if inside == (0, 0, *lens.size) else inside, fitted)


def _recorded(lens: PanoToolsLens, data: Mapping[str, Any]) -> _Part | None:
    """What the comment tells, unless it is damaged or the lens is no longer the one that stood for its camera."""
    try:
        camera, crop, error_px = camera_from_dict(data["camera"], "comment"), data["crop_px"], float(data["error_px"])
        part = None if crop is None else (int(crop[0]), int(crop[1]), int(crop[2]), int(crop[3]))
    except (ValueError, LookupError, TypeError, InputError):
        return None
    left, top, width, height = part or (0, 0, *lens.size)
    if (width, height) != camera.size or clipped((left, top, width, height), lens.size) != (left, top, width, height):
        return None
    reached = difference_px(camera, lens, (left, top))
    return _Part(part, FittedCamera(camera, 0.0), True) if reached <= error_px + _SAME_PX else None


def _frame(line: PtoLine, file: Path, part: _Part, reference: float) -> Frame:
    angles = [line.number(key, 0.0, _ANGLE) for key in ("y", "p", "r")]
    return Frame(
        id="",
        image=str(file),
        size=part.fitted.camera.size,
        load=loader(file, part.crop),
        profile=functools.partial(picture_profile, file),
        sha256=sha256_of(file) if file.is_file() else "",
        white_balance=(_factor(line, "Er"), 1.0, _factor(line, "Eb")),
        exposure_ev=reference - line.number("Eev", 0.0, _EV) + 0.0,
        crop_px=part.crop,
        prior=rotation_of_angles(*angles).T,
    )


def _factor(line: PtoLine, key: str) -> float:
    value = line.number(key, 1.0, _MOST_TINT)
    if value < 1 / _MOST_TINT:
        raise InputError(f"{line.where}: {key}{value:g} is no white balance; 1 is neutral")
    return value


def _reference_ev(lines: Sequence[PtoLine], panorama: PtoLine | None) -> float:
    """The exposure of the panorama; the mean of the pictures' where it is not among them, so was never set."""
    values = [line.number("Eev", 0.0, _EV) for line in lines]
    told = None if panorama is None or "E" not in panorama.values else panorama.number("E", most=_EV)
    if told is not None and min(values) - _NEAR_EV <= told <= max(values) + _NEAR_EV:
        return told
    return sum(values) / len(values)


def _vignetting(
    lines: Sequence[PtoLine], lenses: Sequence[PanoToolsLens], cameras: Sequence[int], parts: Sequence[_Part]
) -> tuple[tuple[tuple[float, float], ...], list[str]]:
    """The mean over the pictures of each camera, and what is to be said of it."""
    found = np.array(
        [
            vignetting_of(_light(line), lens, parts[camera].fitted.camera.half_fov)
            for line, lens, camera in zip(lines, lenses, cameras, strict=True)
        ]
    )
    pairs, notes = [], []
    for k in range(len(parts)):
        own = found[np.array(cameras) == k]
        w1, w2 = own.mean(0).tolist()
        pairs.append((w1, w2))
        if np.abs(own.sum(1) - own.sum(1).mean()).max() > _SAME_VIGNETTING_EV:
            notes.append("pictures of one lens darken differently towards their rims; the mean of them is taken")
    return tuple(pairs), notes


def _light(line: PtoLine) -> tuple[float, float, float, float]:
    vb, vc, vd = (line.number(key, 0.0, _LIGHT) for key in ("Vb", "Vc", "Vd"))
    return line.number("Va", 1.0, _LIGHT), vb, vc, vd


def _left_behind(line: PtoLine) -> list[str]:
    """What of a picture has no place in a mosaic."""
    notes = []
    if any(line.number(key, 0.0) for key in ("TrX", "TrY", "TrZ")):
        notes.append(f"{line.where}: the camera moved (TrX, TrY, TrZ); taken as if it only turned")
    return notes


def _file(line: PtoLine, folder: Path) -> Path:
    return Path(os.path.normpath(folder / line.text("n")))


def _names(files: Sequence[Path], records: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Name and shot: as recorded, else the file name, numbered where parts of a file are pictures."""
    recorded = [(record.get("id"), record.get("shot")) for record in records]
    texts = all(isinstance(text, str) for both in recorded for text in both)
    if texts and len({name for name, _ in recorded}) == len(recorded):
        return [(str(name), str(shot)) for name, shot in recorded]
    often, of_name = Counter(files), Counter(file.name for file in set(files))
    count: Counter[Path] = Counter()
    names = []
    for file in files:
        count[file] += 1
        name = file.name if of_name[file.name] == 1 else file.as_posix()
        names.append((f"{name}:{count[file]}" if often[file] > 1 else name, ""))
    return names
