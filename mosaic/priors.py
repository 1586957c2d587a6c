"""What is told beforehand of where a frame looks: by a table of angles, or by the picture's own metadata."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from fullsphere.model.errors import InputError
from fullsphere.model.files import input_errors
from fullsphere.model.lens import FloatArray
from fullsphere.model.pose_metadata import ToldPose
from fullsphere.model.yaw_pitch_roll import rotation_of_angles
from fullsphere.mosaic.orientation_tag import turned_from_stored
from fullsphere.mosaic.project import Frame

_HEADER = "name,yaw_deg,pitch_deg,roll_deg"
_NEEDED = ("name", "yaw_deg", "pitch_deg")
_DOWN = np.array([0.0, 1.0, 0.0])


def camera_from_world(told: ToldPose) -> FloatArray:
    """Rotation (3, 3) from the level world that the angles count in; a yaw that is not known counts as 0."""
    return rotation_of_angles(told.yaw_deg or 0.0, told.pitch_deg, told.roll_deg).T


def with_prior(frame: Frame, told: ToldPose | None, upright_turns: int = 0) -> Frame:
    """The frame with what is told of it: `gravity`, and `prior` if yaw is known.

    Parameters
    ----------
    frame
        The frame.
    told
        Its angles; None leaves the frame as it is.
    upright_turns
        Clockwise quarter turns between the camera and the picture that the angles are those of.
    """
    if told is None:
        return frame
    rotation = turned_from_stored(upright_turns).T @ camera_from_world(told)
    return dataclasses.replace(
        frame, prior=None if told.yaw_deg is None else rotation, gravity=np.asarray(rotation @ _DOWN)
    )


def with_priors(frames: Sequence[Frame], priors: Mapping[str, ToldPose], source: Path) -> list[Frame]:
    """The frames with the angles of a table in place of those that their files tell.

    A name is that of a frame, with or without the ending.  A table may tell of more than the frames: whoever has one
    of a whole folder may register a part of it.

    Raises
    ------
    InputError
        If the table names none of the frames, or two of its names are one frame's; `source` is named.
    """
    stems = Counter(Path(frame.image).stem for frame in frames)
    found = [[name for name in _names(frame, stems) if name in priors] for frame in frames]
    for frame, names in zip(frames, found, strict=True):
        if len(names) > 1:
            raise InputError(f"{source}: tells of {frame.id} as {names[0]} and as {names[1]}; keep one")
    if frames and not any(found):
        raise InputError(
            f"{source}: tells of {', '.join(list(priors)[:3])} ..., none of which is a frame; "
            f"name them as the files are named, {Path(frames[0].image).name} for example"
        )
    return [with_prior(frame, priors[names[0]] if names else None) for frame, names in zip(frames, found, strict=True)]


def read_priors(path: Path) -> dict[str, ToldPose]:
    """Read the angles of frames by name from a CSV file.

    The first line names the columns `name`, `yaw_deg`, `pitch_deg` and, unless all are 0, `roll_deg`; others are
    ignored.  Angles are those of mosaic.json: of the picture as it is stored, yaw to the right, pitch up, roll
    clockwise.  An empty yaw is not known.

    Raises
    ------
    InputError
        If the file is missing, empty, no such table, names a frame twice or holds a value that is no angle; the
        message names the file, the line and the column.
    """
    priors: dict[str, ToldPose] = {}
    try:
        with input_errors(path), Path(path).open(encoding="utf-8-sig", newline="") as file:
            for line, name, told in _rows(file, str(path)):
                if name in priors:
                    raise InputError(f"{path}: line {line} tells of {name} once more; keep one line for a frame")
                priors[name] = told
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a text table ({error}); save it as CSV in UTF-8") from error
    if not priors:
        raise InputError(f"{path}: tells of no frame; write lines below {_HEADER}")
    return priors


def _names(frame: Frame, stems: Mapping[str, int]) -> list[str]:
    """What a table may call a frame: its own name, and that without the ending where it is no other frame's."""
    stem = Path(frame.image).stem
    return list(dict.fromkeys([frame.id, stem] if stems[stem] == 1 else [frame.id]))


def _rows(file: TextIO, source: str) -> Iterator[tuple[int, str, ToldPose]]:
    """Line number, name and angles of each row that is not empty."""
    reader = csv.reader(file, strict=True)
    columns = [field.strip() for field in next(reader, [])]
    missing = [column for column in _NEEDED if column not in columns]
    doubled = [column for column in (*_NEEDED, "roll_deg") if columns.count(column) > 1]
    if missing or doubled:
        wrong = f"no column {', '.join(missing)}" if missing else f"column {doubled[0]} twice"
        raise InputError(f"{source}: line 1 has {wrong}; name the columns {_HEADER}, separated by commas")
    for row in reader:
        if not any(field.strip() for field in row):
            continue
        where = f"{source}: line {reader.line_num}"
        if len(row) != len(columns):
            raise InputError(f"{where} has {len(row)} fields, line 1 has {len(columns)}; separate them by commas")
        cells = dict(zip(columns, (field.strip() for field in row), strict=True))
        if not cells["name"]:
            raise InputError(f"{where}, column name: empty; name the frame")
        yaw = _angle(cells["yaw_deg"], f"{where}, column yaw_deg", 360) if cells["yaw_deg"] else None
        pitch = _angle(cells["pitch_deg"], f"{where}, column pitch_deg", 90)
        roll = _angle(cells.get("roll_deg", "0"), f"{where}, column roll_deg", 360)
        yield reader.line_num, cells["name"], ToldPose(yaw, pitch, roll)


def _angle(text: str, where: str, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: {text!r} is not a number; give degrees with a decimal point") from None
    if not (math.isfinite(value) and abs(value) <= most):
        raise InputError(f"{where}: {text} is not between -{most:g} and {most:g} degrees")
    return value
