"""The text of a Hugin project: lines of a letter and of values that each begin with their name.

The format is that of PanoTools scripts, as Hugin's documentation of its .pto files has it.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path

from fullsphere.model.errors import InputError
from fullsphere.model.files import input_errors

MAX_BYTES = 1 << 26
"""The largest project that is read; one of a thousand pictures with all their control points is a tenth of it."""

_TOKEN = re.compile(r'(?P<key>[A-Za-z]+)(?P<value>"[^"]*"|[^\s"]*)')
_REFERENCE = re.compile(r"=(\d{1,9})")


@dataclasses.dataclass(frozen=True)
class PtoLine:
    """One line: where it stands (file and number), its letter, and its values by name as they are written.

    `comments` are the lines before it that begin with a # and stand at no other.
    """

    where: str
    kind: str
    values: Mapping[str, str]
    comments: tuple[str, ...] = ()

    def text(self, key: str) -> str:
        """A value in quotes; InputError if there is none."""
        value = self.values.get(key, "")
        if len(value) < 3 or value[0] != '"':
            raise InputError(f'{self.where} has no {key}"..." in quotes')
        return value[1:-1]

    def number(self, key: str, default: float | None = None, most: float = math.inf) -> float:
        """A finite number of at most the size `most`; InputError if there is none and no default."""
        if key not in self.values and default is not None:
            return float(default)
        return checked_number(self.values.get(key, ""), f"{self.where}: {key}", most)

    def whole(self, key: str, default: int | None = None, lower: int = 0, upper: int = 1 << 30) -> int:
        """A whole number from `lower` to `upper`."""
        value = self.number(key, default)
        if not (value.is_integer() and lower <= value <= upper):
            raise InputError(f"{self.where}: {key}{value:g} is not a whole number from {lower} to {upper}")
        return int(value)

    def reference(self, key: str) -> int | None:
        """The number of the picture that shares this value (`=0`); None where the value stands here."""
        found = _REFERENCE.fullmatch(self.values.get(key, ""))
        return None if found is None else int(found[1])

    def comment(self, start: str) -> str:
        """What follows `start` in the nearest comment before the line that begins so; empty where there is none."""
        return next((text.removeprefix(start) for text in reversed(self.comments) if text.startswith(start)), "")


def checked_number(text: str, where: str, most: float = math.inf) -> float:
    """A finite number of at most the size `most`, or InputError, which begins with `where`."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where} is {text!r}, not a number") from None
    if not (math.isfinite(value) and abs(value) <= most):
        raise InputError(f"{where} is {text}, out of all range")
    return value


def read_lines(path: Path) -> list[PtoLine]:
    """The lines of a project that are no comments, in order.

    Raises
    ------
    InputError
        If the file cannot be read or is too large, or a line of a picture or a control point is no list of values.
    """
    path = Path(path)
    with input_errors(path), path.open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise InputError(f"{path}: is larger than {MAX_BYTES >> 20} MB, no project of pictures")
    if b"\0" in content:
        raise InputError(f"{path}: is no text, so no Hugin project")
    lines: list[PtoLine] = []
    comments: list[str] = []
    for number, text in enumerate(content.decode("utf-8", "surrogateescape").splitlines(), 1):
        stripped = text.strip()
        if stripped.startswith("#"):
            comments.append(stripped)
        elif stripped:
            lines.append(_line(stripped, f"{path}: line {number}", tuple(comments)))
            comments = []
    return lines


def _line(text: str, where: str, comments: tuple[str, ...]) -> PtoLine:
    kind, rest = text[0], text[1:]
    values: dict[str, str] = {}
    end = 0
    for token in _TOKEN.finditer(rest):
        if rest[end : token.start()].strip() and kind in "ick":
            raise InputError(f"{where}: {rest[end : token.start()].strip()!r} is no value with its name")
        values.setdefault(token["key"], token["value"])
        end = token.end()
    if rest[end:].strip() and kind in "ick":
        raise InputError(f"{where}: {rest[end:].strip()!r} is no value with its name")
    return PtoLine(where, kind, values, comments)
