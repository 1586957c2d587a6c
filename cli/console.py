"""What all commands share: results on stdout (for people or as JSON), progress, sizes of panoramas."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import messages

if TYPE_CHECKING:
    from fullsphere.mosaic.project import Frame

_STRICT_EXIT = 3
_MOST_BRACKETS = 15  # that cameras take in a row
_UNITS = {"MB": 10**6, "GB": 10**9}


def say(args: argparse.Namespace, text: str) -> None:
    """Tell a person something along the way; nothing with --json."""
    if not args.json:
        messages.note(text)


def counted(number: int, what: str) -> str:
    """A number with its noun, in the plural where there are several."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def report(args: argparse.Namespace, summary: dict[str, Any], lines: Sequence[str]) -> None:
    """Print the result: one JSON object with --json, else lines for people."""
    print(json.dumps(summary, indent=2, sort_keys=True) if args.json else "\n".join(lines))  # noqa: T201


def done(args: argparse.Namespace, with_warnings: bool) -> int:
    """The exit code of work that was finished: 0, or 3 with --strict if anything was left out."""
    return _STRICT_EXIT if args.strict and with_warnings else 0


def progress(args: argparse.Namespace) -> Callable[..., Iterable[Any]]:
    """A wrapper of iterables that shows how far the work is."""
    from fullsphere.cli.progress import show_progress

    return show_progress(quiet=args.json)


def panorama_size(width: int) -> tuple[int, int]:
    """Width and height of an equirectangular panorama; UsageError where the width is odd or out of range."""
    from fullsphere.model.camera import MAX_SIDE_PX
    from fullsphere.model.errors import UsageError

    if width % 2 or not 2 <= width <= MAX_SIDE_PX:
        raise UsageError(
            f"--size {width}: the width is an even number of pixels from 2 to {MAX_SIDE_PX}, the height is half of it"
        )
    return width, width // 2


def brackets_of(text: str) -> int | str:
    """How many brackets make a frame, or "auto", as a type of argparse."""
    if text == "auto":
        return text
    if not (text.isdecimal() and 2 <= int(text[:3]) <= _MOST_BRACKETS):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of pictures from 2 to {_MOST_BRACKETS}, and not auto")
    return int(text)


def brackets_in(args: argparse.Namespace, pictures: Sequence[Path], positions: int) -> int:
    """How many of the pictures are from each position, of which there are as many as `positions` at least.

    Raises
    ------
    UsageError
        If they are not so many times a whole number.
    InputError
        If it is to be told from what the camera noted, and cannot be.
    """
    if args.brackets is None:
        return 1
    from fullsphere.mosaic.brackets import check_count, counted_by_notes

    if args.brackets == "auto":
        return counted_by_notes(pictures, positions)
    check_count(len(pictures), args.brackets)
    return int(args.brackets)


def say_brackets(args: argparse.Namespace, frames: Sequence[Frame]) -> None:
    """Tell which exposures were found, if frames are merged of brackets."""
    from fullsphere.mosaic.brackets import described

    found = described(frames)
    if found:
        say(args, found)


def add_compression(group: argparse._ArgumentGroup) -> None:
    """Declare how pictures are compressed; `check_panorama` knows which kind goes with which format."""
    group.add_argument(
        "--compression",
        metavar="KIND",
        help=".tif: lzw (default for 8 bits), zip, none; .exr: zip, piz, none, dwaa; .png: zip, none; "
        ".jpg: quality 1 to 100",
    )


def bytes_of(text: str) -> int:
    """The amount that 500MB or 2GB spells, as a type of argparse."""
    match = re.fullmatch(r"(\d{1,6})(MB|GB)", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 500MB or 2GB")
    return int(match[1]) * _UNITS[match[2]]
