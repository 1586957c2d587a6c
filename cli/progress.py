"""Progress of long work: a bar on a terminal, a line now and then elsewhere; always on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import Protocol, TypeVar

from fullsphere.cli.messages import note

_T = TypeVar("_T")

SECONDS_BETWEEN_LINES = 10.0

_bar_is_shown = False  # rich shows one at a time; work inside of work goes on without its own


class Progress(Protocol):
    """What the library takes as `progress`: hands the items of an iterable on, and shows how far they are."""

    def __call__(self, items: Iterable[_T], title: str = "", total: int | None = None) -> Iterable[_T]:
        """The same items; `total` says how many, where the iterable does not."""
        ...


def show_progress(quiet: bool = False) -> Progress:
    """What shows progress in the way that suits standard error, or nothing if `quiet`."""

    def progress(items: Iterable[_T], title: str = "", total: int | None = None) -> Iterable[_T]:
        if quiet or _bar_is_shown or sys.stderr is None:
            return items
        if total is None and isinstance(items, Sized):
            total = len(items)
        show = _with_bar if sys.stderr.isatty() else _with_lines
        return show(items, title or "working", total)

    return progress


def _with_bar(items: Iterable[_T], title: str, total: int | None) -> Iterator[_T]:
    global _bar_is_shown
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress as Bars

    with Bars(console=Console(stderr=True)) as bars:
        task = bars.add_task(escape(title), total=total)
        _bar_is_shown = True
        try:
            for item in items:
                yield item
                bars.advance(task)
        finally:
            _bar_is_shown = False


def _with_lines(items: Iterable[_T], title: str, total: int | None) -> Iterator[_T]:
    start = last = time.monotonic()
    of_total = "" if total is None else f" of {total}"
    note(f"{title} ...")
    for done, item in enumerate(items, 1):
        yield item
        if time.monotonic() - last >= SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            note(f"{title}: {done}{of_total}")
    note(f"{title}: done, {time.monotonic() - start:.1f} s")
