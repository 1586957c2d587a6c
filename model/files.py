"""Files that are replaced whole or not at all, and JSON that is read strictly.

A result is written to a temporary file beside its place and moved there only once it is complete and on the disk, so a
path holds the old file or the whole new one: after an error, a full disk, Ctrl-C or a crash.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fullsphere.model.errors import InputError, OutputError

MAX_JSON_BYTES = 1 << 28
"""The largest JSON file that is read; a mosaic of a thousand frames with all its links is a tenth of it."""

_MAX_DEPTH = 64
_LARGEST_FLOAT = 1.7976931348623157e308


@contextlib.contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[Path]:
    """Give a temporary file beside `path`, and put it in `path`'s place when the block ends without an error.

    The temporary file exists and is empty when the block starts; the block opens it by name, writes and closes it.
    It is flushed to the disk before it takes `path`'s place.  After any exception, KeyboardInterrupt among them, it
    is removed and what stood at `path` is as it was.  A symbolic link at `path` is replaced, never written through.

    Raises
    ------
    OutputError
        If `path` cannot be written or replaced, or exists and `overwrite` is false.
    """
    path = Path(path)
    _refuse_target(path, overwrite)
    temporary = _name_beside(path)
    try:
        _create(temporary, path)
        yield temporary
        with output_errors(path):
            _flush(temporary, os.O_RDWR)
        _refuse_target(path, overwrite)  # once more: the work may have taken hours
        with output_errors(path):
            temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    with contextlib.suppress(OSError):  # a folder cannot be flushed everywhere; the file itself is safe already
        _flush(path.parent, os.O_RDONLY)


def check_output(path: Path, overwrite: bool, inputs: Iterable[Path] = ()) -> None:
    """Make sure, before the work, that a result can be put at `path`.

    Raises
    ------
    OutputError
        If the folder is missing or no file can be made in it, if `path` is a folder or a device, if it exists and
        `overwrite` is false, or if it is the same file as one of `inputs` (whatever their names).
    """
    path = Path(path)
    for other in inputs:
        with contextlib.suppress(OSError):
            if path.samefile(other):
                raise OutputError(f"{path}: is an input of this run ({other}); choose another output name")
    _refuse_target(path, overwrite)
    trial = _name_beside(path)
    _create(trial, path)  # permissions say little (root, read-only mounts, quotas): try it
    trial.unlink()


@contextlib.contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's errors of the block into OutputError, naming `path`."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({_reason(error)})") from error


@contextlib.contextmanager
def input_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's errors of the block into InputError, naming `path`."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; check the name") from error
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder; name a file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)})") from error


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal; InputError if it cannot be read."""
    with input_errors(path), Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_json(path: Path) -> Any:
    """The value that a JSON file holds, read strictly.

    Raises
    ------
    InputError
        If the file cannot be read, is too large, is no UTF-8 or no JSON, is nested too deeply, repeats a key in one
        object, or holds a number that is not finite (NaN, Infinity, 1e999).
    """
    path = Path(path)
    with input_errors(path), path.open("rb") as file:
        content = file.read(MAX_JSON_BYTES + 1)
    if len(content) > MAX_JSON_BYTES:
        raise InputError(f"{path}: is larger than {MAX_JSON_BYTES >> 20} MB, no file that fullsphere wrote")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise InputError(f"{path}: the key {key!r} stands twice in one object; remove one")
            found[key] = value
        return found

    try:
        value = json.loads(content.decode("utf-8-sig"), object_pairs_hook=unique)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text, so no JSON file (byte {error.start})") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: is not JSON: {error.msg} at line {error.lineno}, column {error.colno}") from error
    except RecursionError as error:
        raise InputError(f"{path}: is nested too deeply") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{path}: holds a number that is too long") from error
    fault = _fault(value)
    if fault is not None:
        raise InputError(f"{path}: {fault}")
    return value


def write_json(path: Path, value: Any, overwrite: bool) -> None:
    """Write a value as JSON: keys sorted, indented, lists of plain values on one line, every number finite.

    NumPy arrays and scalars are written as the lists and numbers they hold.

    Raises
    ------
    OutputError
        If the file cannot be written, exists and `overwrite` is false, or `value` holds a number that is not finite.
    """
    plain = _plain(value)
    fault = _fault(plain)
    if fault is not None:
        raise OutputError(f"{path}: not written: {fault}")
    with replacing(path, overwrite) as temporary, output_errors(path):
        temporary.write_bytes((_layout(plain, "\n") + "\n").encode())


def _plain(value: Any) -> Any:
    """`value` with mappings as dicts, tuples and NumPy arrays as lists, NumPy scalars as numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _layout(value: Any, newline: str) -> str:
    inner = newline + "  "
    if isinstance(value, dict) and value:
        items = [f"{json.dumps(key)}: {_layout(value[key], inner)}" for key in sorted(value)]
        return "{" + inner + f",{inner}".join(items) + newline + "}"
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        return "[" + inner + f",{inner}".join(_layout(item, inner) for item in value) + newline + "]"
    return json.dumps(value, allow_nan=False)


def _fault(value: Any, where: str = "", depth: int = 0) -> str | None:
    """The first number that is not finite, or the nesting that is too deep, and where it stands; None if sound."""
    if depth > _MAX_DEPTH:
        return f"{where[:40]}... is nested deeper than {_MAX_DEPTH} levels"
    if isinstance(value, int | float):
        finite = -_LARGEST_FLOAT <= value <= _LARGEST_FLOAT
        return None if finite else f"{where or 'the value'} is not a finite number"
    items: Iterable[tuple[str, Any]] = ()
    if isinstance(value, dict):
        items = ((f"{where}.{key}" if where else key, item) for key, item in value.items())
    elif isinstance(value, list) and not _all_finite(value):
        items = ((f"{where}[{index}]", item) for index, item in enumerate(value))
    return next((fault for place, item in items if (fault := _fault(item, place, depth + 1)) is not None), None)


def _all_finite(values: list[Any]) -> bool:
    """Whether a list holds finite numbers and nothing else: matches of a mosaic are lists of thousands."""
    try:
        return set(map(type, values)) <= {int, float} and all(map(math.isfinite, values))
    except OverflowError:  # a whole number that no float holds
        return False


def _refuse_target(path: Path, overwrite: bool) -> None:
    with output_errors(path):
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; give the output a file name")
        try:
            mode = path.lstat().st_mode
        except FileNotFoundError:
            return
        if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
            raise OutputError(f"{path}: is no ordinary file; give the output another name")
        if not overwrite:
            raise OutputError(f"{path}: exists already; add --overwrite to replace it, or choose another name")


def _name_beside(path: Path) -> Path:
    """A new name in `path`'s folder, short and plain ASCII whatever `path`'s is."""
    return path.parent / f".fullsphere-{secrets.token_hex(8)}.partial"


def _create(temporary: Path, path: Path) -> None:
    """Make the empty file `temporary`, which is to become `path`."""
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; make it first")
    with output_errors(path):
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
        os.close(os.open(temporary, flags, 0o666))  # tempfile's 0600 would stay on the result


def _flush(path: Path, flags: int) -> None:
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _reason(error: OSError) -> str:
    return error.strerror or str(error) or type(error).__name__
