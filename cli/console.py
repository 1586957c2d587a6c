"""What all commands share: results on stdout (for people or as JSON), progress, sizes of panoramas."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from fullsphere.cli import messages

_STRICT_EXIT = 3
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


def bytes_of(text: str) -> int:
    """The amount that 500MB or 2GB spells, as a type of argparse."""
    match = re.fullmatch(r"(\d{1,6})(MB|GB)", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 500MB or 2GB")
    return int(match[1]) * _UNITS[match[2]]
