"""The frames of a turning arm and the turn angles that a person tells: from files, before any picture is decoded."""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.images import picture_profile, picture_size
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.frames import of_one_size, refuse_if_fewer, without_doubles
from fullsphere.mosaic.loading import loader
from fullsphere.mosaic.project import Frame

LEAST_FRAMES = 8
"""Fewer frames make no mosaic: they lie 45 degrees and more apart."""

_MOST_BYTES = 1 << 24  # of a file of angles
_RADIANS = 6.3  # of a full turn
_BETWEEN = " \t,"  # a name and its angle


def open_turn(paths: Sequence[Path], size: tuple[int, int]) -> list[Frame]:
    """A frame for each file, in the order given; only headers are read.

    A file that is no picture, of another size or with the same bytes as an earlier one is left out with the reason.

    Raises
    ------
    InputError
        If a file does not exist, or too few frames are left.
    """
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: there is no such file; check the name")
    often = Counter(path.name for path in paths)
    frames = [_opened(path, path.name if often[path.name] == 1 else path.as_posix()) for path in paths]
    frames = without_doubles(of_one_size(frames, size, "the camera is for"))
    refuse_if_fewer(frames, LEAST_FRAMES, f"a turn needs at least {LEAST_FRAMES} frames")
    return frames


def _opened(path: Path, name: str) -> Frame:
    try:
        size = picture_size(path)
        profile = functools.partial(picture_profile, path)
        return Frame(name, str(path), size, loader(path), sha256_of(path), profile=profile)
    except InputError as error:
        return Frame(name, str(path), (0, 0), loader(path), reason=str(error).removeprefix(f"{path}: "))


def even_angles(frames: Sequence[Frame], to_the_right: bool = True) -> FloatArray:
    """Turn angles (n,) in radians of frames in even steps round a full turn; a file given twice is one step."""
    steps: dict[str, int] = {}
    places = [steps.setdefault(frame.sha256 or frame.id, len(steps)) for frame in frames]
    return np.asarray(np.array(places) * (2 * math.pi / len(steps)) * (1 if to_the_right else -1)) % (2 * math.pi)


def read_angles(path: Path, frames: Sequence[Frame]) -> FloatArray:
    """Turn angles (n,) in radians of frames, as a text file tells them in degrees.

    One line for each frame: its file name and the angle, or the angles alone in the order of the frames; separated by
    blanks, commas or tabs, which a name may hold too.  Empty lines and what follows a # do not count.  Angles grow to
    the right.

    Raises
    ------
    InputError
        If the file cannot be read, a line is neither, or a frame has no angle or two.
    """
    lines = _lines(path)
    named = bool(lines[0].name)
    for line in lines:
        if bool(line.name) != named:
            raise InputError(
                f"{path}: line {line.number} is not like the others; give a file name and an angle, or an angle"
            )
    degrees = [_number(path, line.number, line.angle) for line in lines]
    if len(degrees) >= LEAST_FRAMES and max(degrees) - min(degrees) <= _RADIANS:
        raise InputError(f"{path}: tells less than {_RADIANS} degrees of turn; if these are radians, give degrees")
    if not named:
        if len(degrees) != len(frames):
            raise InputError(
                f"{path}: holds {len(degrees)} angles, and there are {len(frames)} frames; give one for each"
            )
        return np.radians(degrees)
    told: dict[str, float] = {}
    for line, angle in zip(lines, degrees, strict=True):
        if line.name in told:
            raise InputError(f"{path}: line {line.number}: {line.name} has an angle already; remove one")
        told[line.name] = angle
    missing = [frame.id for frame in frames if Path(frame.id).name not in told and frame.id not in told]
    if len(missing) == len(frames):
        raise InputError(
            f"{path}: line {lines[0].number}: {lines[0].name!r} is no frame of these, and no other line names one; "
            "give their file names, and degrees with a decimal point"
        )
    if missing:
        some = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if len(missing) > 3 else "")
        raise InputError(f"{path}: tells no angle for {some}; add a line for each")
    return np.radians([told.get(frame.id, told.get(Path(frame.id).name, 0.0)) for frame in frames])


class _Line(NamedTuple):
    number: int
    name: str
    angle: str


def _lines(path: Path) -> list[_Line]:
    """Each line that holds anything: its last word is the angle, and what stands before it the name, if anything."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: is larger than {_MOST_BYTES >> 20} MB, no list of angles")
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file of angles; check the name") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text, so no list of angles (byte {error.start})") from error
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        told = line.partition("#")[0].strip(_BETWEEN)
        if told:
            angle = re.split(f"[{_BETWEEN}]", told)[-1]
            found.append(_Line(number, told.removesuffix(angle).rstrip(_BETWEEN), angle))
    if not found:
        raise InputError(f"{path}: holds no angles")
    return found


def _number(path: Path, line: int, word: str) -> float:
    try:
        angle = float(word)
    except ValueError:
        angle = math.nan
    if not math.isfinite(angle):
        raise InputError(f"{path}: line {line}: {word!r} is no angle in degrees")
    return angle
