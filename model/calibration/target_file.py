"""Targets as people name them: a short text such as chessboard:6x8:117mm, or a target.json (`docs/file-formats.md`).

Like a camera.json, a target.json is read strictly: what is unknown, missing or out of range is refused by its key.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fullsphere.model.calibration.board import Board, Placement
from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.target_text import FORMS, is_target_text, target_from_text
from fullsphere.model.calibration.targets import Target
from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.files import read_json, write_json

FORMAT = "fullsphere-target/1"

KINDS: Mapping[str, type[Board]] = {
    "aprilgrid": AprilGrid,
    "charuco": CharucoBoard,
    "chessboard": Chessboard,
    "circles": CirclesGrid,
}
"""Kinds of board in a target.json.  The keys of each are the fields of its class; those with a default may be left
out."""

_JSON_TYPES = {"int": "a whole number", "float": "a number", "str": "a text", "bool": "true or false"}


def parse_target(text: str) -> Target:
    """The target that a text of the command line names: one of `FORMS`, or the path of a target.json.

    Raises
    ------
    UsageError
        If the text names neither, or numbers that make no target; says how targets are written.
    InputError
        If it is a file that cannot be read or describes no target.
    """
    if is_target_text(text):
        return target_from_text(text)
    path = Path(text)
    with contextlib.suppress(OSError):  # a name that is too long for a file is none
        if path.suffix.lower() == ".json" or path.is_file():
            return load_target(path)
    raise UsageError(f"target {text!r}: is neither a target.json nor one of {', '.join(FORMS)}")


def load_target(path: Path) -> Target:
    """Read a target.json; the target's name is the path.

    Raises
    ------
    InputError
        If the file cannot be read or describes no target; names the file and the key.
    """
    where = str(path)
    data = _object(read_json(path), where)
    if data.get("format") != FORMAT:
        raise InputError(f'{where}: format is {data.get("format")!r}, not "{FORMAT}"; is it a target file?')
    _demand_keys(data, where, required={"format", "boards"}, known={"format", "boards"})
    boards = data["boards"]
    if not isinstance(boards, list):
        raise InputError(f"{where}: boards is not a list of boards")
    try:
        return Target(where, tuple(_board(board, f"{where}: boards[{i}]") for i, board in enumerate(boards)))
    except UsageError as error:
        raise InputError(str(error)) from error


def save_target(path: Path, target: Target, overwrite: bool = False) -> None:
    """Write a target.json.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and `overwrite` is false.
    """
    write_json(path, {"format": FORMAT, "boards": [_board_to_dict(board) for board in target.boards]}, overwrite)


def _board_to_dict(board: Board) -> dict[str, Any]:
    kind = next(name for name, of in KINDS.items() if isinstance(board, of))
    radius = board.placement.radius_mm
    placement = {
        "target_from_board": board.placement.target_from_board,
        "radius_mm": None if math.isinf(radius) else radius,
    }
    return {"kind": kind, **{field.name: getattr(board, field.name) for field in _fields(KINDS[kind])}} | {
        "placement": placement
    }


def _board(value: Any, where: str) -> Board:
    data = _object(value, where)
    kind = KINDS.get(data["kind"]) if isinstance(data.get("kind"), str) else None
    if kind is None:
        raise InputError(f"{where}: kind is {data.get('kind')!r}; known are {', '.join(KINDS)}")
    fields = _fields(kind)
    required = {"kind", *(field.name for field in fields if field.default is dataclasses.MISSING)}
    _demand_keys(data, where, required, known=required | {field.name for field in fields} | {"placement"})
    values = {field.name: _plain(data, field, where) for field in fields if field.name in data}
    if "placement" in data:
        values["placement"] = _placement(data["placement"], f"{where}: placement")
    try:
        return kind(**values)
    except UsageError as error:
        raise InputError(f"{where}: {error}") from error


def _fields(kind: type[Board]) -> list[dataclasses.Field[Any]]:
    """What a board of that kind is made from, but for its placement."""
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]  # every kind is a dataclass, their base is not
    return [field for field in fields if field.init and field.name != "placement"]


def _plain(data: dict[str, Any], field: dataclasses.Field[Any], where: str) -> Any:
    """The value of a key, of the type that its field has."""
    value, wanted = data[field.name], str(field.type)
    of_type = {
        "bool": isinstance(value, bool),
        "int": isinstance(value, int) and not isinstance(value, bool),
        "float": isinstance(value, int | float) and not isinstance(value, bool),
        "str": isinstance(value, str),
    }[wanted]
    if not of_type:
        raise InputError(f"{where}: {field.name} is {value!r}, not {_JSON_TYPES[wanted]}")
    return float(value) if wanted == "float" else value


def _placement(value: Any, where: str) -> Placement:
    data = _object(value, where)
    _demand_keys(data, where, required={"target_from_board"}, known={"target_from_board", "radius_mm"})
    rows = data["target_from_board"]
    square = isinstance(rows, list) and len(rows) == 4 and all(isinstance(r, list) and len(r) == 4 for r in rows)
    if not (square and all(isinstance(x, int | float) and not isinstance(x, bool) for row in rows for x in row)):
        raise InputError(f"{where}: target_from_board is not 4 rows of 4 numbers")
    radius = data.get("radius_mm")
    if radius is not None and (isinstance(radius, bool) or not isinstance(radius, int | float)):
        raise InputError(f"{where}: radius_mm is {radius!r}, not a number, and not null for flat paper")
    try:
        return Placement(rows, math.inf if radius is None else float(radius))
    except UsageError as error:
        raise InputError(f"{where}: {error}") from error


def _object(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: is not an object of keys and values")
    return value


def _demand_keys(data: dict[str, Any], where: str, required: set[str], known: set[str]) -> None:
    missing = sorted(required - data.keys())
    if missing:
        raise InputError(f"{where}: the key {missing[0]!r} is missing")
    unknown = [key for key in data if key not in known]
    if unknown:
        raise InputError(f"{where}: the key {unknown[0]!r} is unknown; is it misspelt?")
