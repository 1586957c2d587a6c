"""Targets as short texts: kind, counts and lengths with colons between, chessboard:6x8:117mm for example."""

from __future__ import annotations

import re
from collections.abc import Callable

from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.cylinder import cylinder
from fullsphere.model.calibration.targets import Target
from fullsphere.model.errors import UsageError

FORMS = (
    "chessboard:COLUMNSxROWS:SQUARE",
    "charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY]",
    "aprilgrid:COLUMNSxROWS:TAG:GAP[:BORDER]",
    "circles:COLUMNSxROWS:SPACING[:DIAMETER]",
    "acircles:COLUMNSxROWS:SPACING[:DIAMETER]",
    "cylinder:RADIUS:LENGTH:SQUARE[:MARKER[:DICTIONARY]]",
    "half-cylinder:RADIUS:LENGTH:SQUARE[:MARKER[:DICTIONARY]]",
)
"""How targets are written.  A chessboard is counted in inner corners, a ChArUco board in squares; lengths have a unit
(mm, cm, m, in); GAP is in sides of a tag and BORDER in modules."""

MARKER_SHARE = 0.7
"""Side of a marker, in sides of its square, where none is given: the corners stay clear of it."""

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_NUMBER = r"\d{1,9}(?:\.\d{0,9})?|\.\d{1,9}"


def is_target_text(text: str) -> bool:
    """Whether a text begins with a kind of target and a colon, and so is no file's name."""
    return text.partition(":")[0] in _KINDS and ":" in text


def target_from_text(text: str) -> Target:
    """The target that one of `FORMS` describes; the text is its name.

    Raises
    ------
    UsageError
        If the text is of none of the forms, or its numbers make no target.
    """
    kind, *words = text.split(":")
    make, least, most = _KINDS[kind]
    form = next(form for form in FORMS if form.startswith(f"{kind}:"))
    if not least <= len(words) <= most:
        raise UsageError(f"target {text!r}: is not of the form {form}")
    try:
        return make(text, words)
    except UsageError as error:
        raise UsageError(f"target {text!r}: {error}; the form is {form}") from error


def length_mm(text: str) -> float:
    """Millimetres from a length with its unit, 117mm for example; UsageError if it is none."""
    found = re.fullmatch(rf"({_NUMBER})\s*({'|'.join(_MM)})?", text.strip())
    if not found:
        raise UsageError(f"{text!r} is no length such as 30mm, 3cm or 1.2in")
    if found[2] is None:
        raise UsageError(f"{text!r} has no unit: write {found[1]}mm, {found[1]}cm, {found[1]}m or {found[1]}in")
    return float(found[1]) * _MM[found[2]]


def _chessboard(name: str, words: list[str]) -> Target:
    return Target(name, (Chessboard(*_counts(words[0]), length_mm(words[1])),))


def _charuco(name: str, words: list[str]) -> Target:
    columns, rows = _counts(words[0])
    square, marker = (length_mm(word) for word in words[1:3])
    dictionary = words[3] if len(words) > 3 else "DICT_5X5_1000"
    return Target(name, (CharucoBoard(columns, rows, square, marker, dictionary=dictionary),))


def _aprilgrid(name: str, words: list[str]) -> Target:
    if not re.fullmatch(_NUMBER, words[2]):
        raise UsageError(f"{words[2]!r} is no gap in sides of a tag, 0.3 for example")
    border = words[3] if len(words) > 3 else "2"
    if border not in ("1", "2"):
        raise UsageError(f"{border!r} is no width of a tag's border: 1 or 2 modules")
    return Target(name, (AprilGrid(*_counts(words[0]), length_mm(words[1]), float(words[2]), 0, int(border)),))


def _circles(name: str, words: list[str]) -> Target:
    return _discs(name, words, asymmetric=False)


def _acircles(name: str, words: list[str]) -> Target:
    return _discs(name, words, asymmetric=True)


def _discs(name: str, words: list[str], asymmetric: bool) -> Target:
    spacing = length_mm(words[1])
    diameter = length_mm(words[2]) if len(words) > 2 else spacing / 2
    return Target(name, (CirclesGrid(*_counts(words[0]), spacing, diameter, asymmetric),))


def _whole_cylinder(name: str, words: list[str]) -> Target:
    return _cylinder(name, words, part=1.0)


def _half_cylinder(name: str, words: list[str]) -> Target:
    return _cylinder(name, words, part=0.5)


def _cylinder(name: str, words: list[str], part: float) -> Target:
    radius, length, square = (length_mm(word) for word in words[:3])
    marker = length_mm(words[3]) if len(words) > 3 else MARKER_SHARE * square
    return Target(name, (cylinder(radius, length, square, marker, words[4] if len(words) > 4 else None, part),))


def _counts(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text)
    if not found:
        raise UsageError(f"{text!r} are no columns and rows such as 6x8")
    return int(found[1]), int(found[2])


_KINDS: dict[str, tuple[Callable[[str, list[str]], Target], int, int]] = {  # and how many words follow the kind
    "chessboard": (_chessboard, 2, 2),
    "charuco": (_charuco, 3, 4),
    "aprilgrid": (_aprilgrid, 3, 4),
    "circles": (_circles, 2, 3),
    "acircles": (_acircles, 2, 3),
    "cylinder": (_whole_cylinder, 3, 5),
    "half-cylinder": (_half_cylinder, 3, 5),
}
