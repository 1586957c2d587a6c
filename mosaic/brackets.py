"""Pictures of several exposures from each position -> one frame of each: what belongs together, and its exposures.

Frames come so many at a time (A1 A2 A3 B1 B2 B3 ...).  How much brighter one bracket is than the next the pictures tell
themselves, better than what the camera noted: shutters are off by some hundredths of an EV, and notes by the rounding
of their names.  The notes decide where the pictures have nothing in common that is neither clipped nor black.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.images import noted_ev, open_picture
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.bracket_exposures import Look, look_at, pair_of, shift_between, step_between
from fullsphere.mosaic.camera_response import Pair, fit_response
from fullsphere.mosaic.loading import loader_of
from fullsphere.mosaic.project import Bracket, Frame

_MOST = 15  # pictures that cameras take in a row
_SAME_EV = 0.1  # brackets that differ by less are none
_FEWEST = 50  # values that tell an exposure
_AGREEING = 0.5  # of all values have to be of one thing
_OFF_EV = 0.35  # by so much what the camera noted may be off without a word
_PATTERN_EV = 0.5  # further from that of most positions the brackets are others
_TELLING = 8  # positions by which the tone curve is found
_SHIFTED_PX = 1.0

_log = logging.getLogger(__name__)


def counted_by_notes(paths: Sequence[Path], positions: int = 2) -> int:
    """How many pictures each position has, by the exposures that the camera noted, whose pattern repeats.

    Parameters
    ----------
    paths
        All pictures in the order in which they were taken.
    positions
        The fewest positions that there are.

    Raises
    ------
    InputError
        If a file cannot be read, notes no exposure, or no pattern repeats to the end.
    """
    told = np.empty(len(paths))
    for k, path in enumerate(paths):
        with open_picture(path) as file:
            noted = noted_ev(file.metadata)
        if noted is None:
            raise InputError(
                f"{path}: notes no exposure by which brackets could be told; give their number: --brackets 3"
            )
        told[k] = noted
    if np.ptp(told) < _SAME_EV:
        raise InputError(f"all {len(paths)} pictures have one exposure by what the camera noted: they are no brackets")
    for count in range(2, min(_MOST, len(paths) // positions) + 1):
        if len(paths) % count == 0:
            pattern = told.reshape(-1, count) - told[::count, None]
            if np.ptp(pattern[0]) >= _SAME_EV and np.ptp(pattern, axis=0).max() < _SAME_EV:
                return count
    raise InputError(
        f"the exposures of {len(paths)} pictures do not repeat as those of brackets do (in EV: "
        f"{_spelled(told[:8] - told[0])}{' ...' if len(told) > 8 else ''}); give all of them in their order, or their "
        "number: --brackets 3"
    )


def positions_of(
    frames: Sequence[Frame],
    count: int,
    executor: Executor | None = None,
    progress: Callable[..., Any] | None = None,
) -> list[Frame]:
    """One frame for each `count` of those given, which are pictures from one position.

    A frame is like the bracket of the middle exposure, the darker one of two; its `load` merges them all to light.
    A position is left out, with the reason, if one of its pictures is, or they are not brackets of one thing.  What is
    doubtful of one that is not, such as a camera that moved, is logged as a warning.

    Parameters
    ----------
    frames
        Of whole files.
    count
        Pictures of a position; 1 for frames that stay as they are.
    executor
        Where pictures are opened side by side.
    progress
        Wraps the loop over the positions.

    Raises
    ------
    UsageError
        If the frames are not so many times a whole number.
    """
    if count == 1:
        return list(frames)
    check_count(len(frames), count)
    groups = [frames[k : k + count] for k in range(0, len(frames), count)]
    position = functools.partial(_position, response_ev=_response(groups, executor))
    made = ordered_map(executor, position, groups, ahead=2)
    found = list(progress(made, title="comparing brackets", total=len(groups)) if progress else made)
    _warn_of_other_patterns(found)
    return found


def check_count(pictures: int, count: int) -> None:
    """UsageError if so many pictures are not brackets of so many."""
    if pictures % count:
        raise UsageError(
            f"{pictures} pictures are no brackets of {count}: there is one too few or too many; give {count} of each "
            "position, in order"
        )


def described(frames: Sequence[Frame]) -> str:
    """What was found of bracketed frames, in a line: "8 positions of 3 brackets: -2 0 +2 EV"."""
    of_file = {frame.image: frame.brackets for frame in frames if frame.brackets}  # two circles may share one
    if not of_file:
        return ""
    exposures = [[bracket.exposure_ev for bracket in brackets] for brackets in of_file.values()]
    often = f"{len(exposures)} position{'' if len(exposures) == 1 else 's'}"
    curve = ", and the camera's tone curve" if any(frame.response_ev for frame in frames) else ""
    return f"{often} of {len(exposures[0])} brackets: {_spelled(np.median(exposures, axis=0))} EV{curve}"


def _spelled(exposures_ev: FloatArray) -> str:
    rounded = [round(float(ev), 1) for ev in exposures_ev]
    return " ".join("0" if ev == 0 else f"{ev:+g}" for ev in rounded)


def _response(groups: Sequence[Sequence[Frame]], executor: Executor | None) -> tuple[float, ...]:
    """The camera's tone curve, by some positions spread over the set; empty if it did not note all their exposures."""
    some = [group for group in groups if not _unlike(group)]
    some = some[:: max(1, -(-len(some) // _TELLING))]
    if any(frame.told_ev is None for group in some for frame in group):
        return ()
    return fit_response([pair for pairs in ordered_map(executor, _pairs, some, ahead=2) for pair in pairs])


def _pairs(frames: Sequence[Frame]) -> list[Pair]:
    """What neighbours in exposure tell of the tone curve; nothing if one cannot be looked at."""
    try:
        looks = [look_at(Path(frame.image)) for frame in frames]
    except InputError:  # which is said when it is merged
        return []
    found = []
    for dark, bright in itertools.pairwise(_rising(looks)):
        noted = _noted_step(frames[dark], frames[bright])
        if noted is not None and noted > _SAME_EV:
            found.append(pair_of(looks[dark], looks[bright], noted))
    return found


def _position(frames: Sequence[Frame], response_ev: tuple[float, ...]) -> Frame:
    """The frame of a position."""
    wrong = _unlike(frames)
    if wrong:
        return frames[0].left_out(wrong)
    try:
        looks = [look_at(Path(frame.image), response_ev) for frame in frames]
        exposures = _exposures(frames, looks)
    except InputError as error:
        return frames[0].left_out(f"cannot be merged: {error}")
    if np.ptp(exposures) < _SAME_EV:
        return frames[0].left_out(f"and the {len(frames) - 1} after it have one exposure: they are no brackets")
    rising = np.argsort(exposures, kind="stable")
    middle = int(rising[(len(rising) - 1) // 2])
    exposures = np.round(exposures - exposures[middle], 4) + 0.0
    _warn_of_shifts(frames, looks, exposures, middle)
    brackets = tuple(Bracket(f.image, f.sha256, float(ev)) for f, ev in zip(frames, exposures, strict=True))
    frame = dataclasses.replace(frames[middle], brackets=brackets, response_ev=response_ev, profile=None)
    return dataclasses.replace(frame, load=loader_of(frame))


def _unlike(frames: Sequence[Frame]) -> str:
    """Why pictures cannot be brackets of one thing, by their files; empty if they can."""
    for frame in frames:
        if frame.reason:
            return f"cannot be merged with {frame.id}, which {frame.reason}" if frame != frames[0] else frame.reason
    for frame in frames[1:]:
        if frame.size != frames[0].size:
            (width, height), (across, down) = frames[0].size, frame.size
            return f"is {width} x {height} pixels, its bracket {frame.id} {across} x {down}"
    hashes = [frame.sha256 for frame in frames]
    for k, frame in enumerate(frames):
        if frame.sha256 in hashes[:k]:
            return f"cannot be merged: {_pair(frames, hashes.index(frame.sha256), k)} are the same file"
    return ""


def _exposures(frames: Sequence[Frame], looks: Sequence[Look]) -> FloatArray:
    """How much brighter each picture (n,) recorded the scene than some one; InputError if that cannot be told."""
    exposures = np.zeros(len(frames))
    for dark, bright in itertools.pairwise(_rising(looks)):
        pair = _pair(frames, dark, bright)
        step, noted = step_between(looks[dark], looks[bright]), _noted_step(frames[dark], frames[bright])
        if step.values >= _FEWEST:
            if step.agreeing < _AGREEING:
                raise InputError(f"{pair} do not show the same thing")
            if noted is not None and abs(step.ev - noted) > _OFF_EV:
                _log.warning(
                    f"{pair} are {step.ev:.2f} EV apart by their pixels and {noted:.2f} by what the camera noted: they "
                    "do not have the tone curve of their colour profile, and what is merged is only roughly linear"
                )
            exposures[bright] = exposures[dark] + step.ev
        elif noted is not None:
            exposures[bright] = exposures[dark] + noted
        else:
            raise InputError(
                f"{pair} have nothing in common that tells their exposures, and the camera did not note them"
            )
    return exposures


def _rising(looks: Sequence[Look]) -> list[int]:
    """Their places, from the darkest to the brightest."""
    return [int(k) for k in np.argsort([look.light.mean(dtype=float) for look in looks], kind="stable")]


def _noted_step(dark: Frame, bright: Frame) -> float | None:
    return None if dark.told_ev is None or bright.told_ev is None else bright.told_ev - dark.told_ev


def _pair(frames: Sequence[Frame], i: int, j: int) -> str:
    return f"{frames[min(i, j)].id} and {frames[max(i, j)].id}"


def _warn_of_shifts(frames: Sequence[Frame], looks: Sequence[Look], exposures: FloatArray, reference: int) -> None:
    for k in range(len(frames)):
        shift = None if k == reference else shift_between(looks[reference], looks[k], float(exposures[k]))
        if shift is not None and shift > _SHIFTED_PX:
            _log.warning(
                f"{_pair(frames, reference, k)} are shifted by {shift:.1f} px: merged they are blurred; take brackets "
                "from a tripod, or leave --brackets out and every picture is placed for itself"
            )


def _warn_of_other_patterns(frames: Sequence[Frame]) -> None:
    """Where exposures come in another order than at most positions a picture may be missing or be one too many."""
    good = [frame for frame in frames if frame.brackets]
    patterns = np.array([[bracket.exposure_ev for bracket in frame.brackets] for frame in good])
    if len(good) < 3:
        return
    usual = np.median(patterns, axis=0)
    for frame, pattern in zip(good, patterns, strict=True):
        if np.abs(pattern - usual).max() > _PATTERN_EV:
            _log.warning(
                f"{frame.id}: its brackets are {_spelled(pattern)} EV, those of most positions {_spelled(usual)}; is a "
                "picture missing, or one too many?"
            )
