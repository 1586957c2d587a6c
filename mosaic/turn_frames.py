"""The frames of a turning arm and the turn angles that a person tells: from files, before any picture is decoded."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

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
    """Turn angles (n,) in radians of frames in even steps round a full turn."""
    n = len(frames)
    return np.asarray(np.arange(n) * (2 * math.pi / n) * (1 if to_the_right else -1)) % (2 * math.pi)


def read_angles(path: Path, frames: Sequence[Frame]) -> FloatArray:
    """Turn angles (n,) in radians of frames, as a text file tells them in degrees.

    One line for each frame: its file name and the angle, or the angles alone in the order of the frames; separated by
    blanks, commas or tabs.  Empty lines and what follows a # do not count.  Angles grow to the right.

    Raises
    ------
    InputError
        If the file cannot be read, a line is neither, or a frame has no angle or two.
    """
    lines = _lines(path)
    named = all(len(words) == 2 for _, words in lines)
    if not named and not all(len(words) == 1 for _, words in lines):
        number = next(number for number, words in lines if len(words) != len(lines[0][1]))
        raise InputError(f"{path}: line {number} is not like the others; give a file name and an angle, or an angle")
    degrees = [_number(path, number, words[-1]) for number, words in lines]
    if not named:
        if len(degrees) != len(frames):
            raise InputError(
                f"{path}: holds {len(degrees)} angles, and there are {len(frames)} frames; give one for each"
            )
        return np.radians(degrees)
    told: dict[str, float] = {}
    for (number, words), angle in zip(lines, degrees, strict=True):
        if words[0] in told:
            raise InputError(f"{path}: line {number}: {words[0]} has an angle already; remove one")
        told[words[0]] = angle
    missing = [frame.id for frame in frames if Path(frame.id).name not in told and frame.id not in told]
    if missing:
        raise InputError(f"{path}: tells no angle for {', '.join(missing[:3])}{' ...' if len(missing) > 3 else ''}")
    return np.radians([told.get(frame.id, told.get(Path(frame.id).name, 0.0)) for frame in frames])


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """The words of each line that holds any, with its number."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: is larger than {_MOST_BYTES >> 20} MB, no list of angles")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text, so no list of angles (byte {error.start})") from error
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if words:
            found.append((number, words))
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
