"""The one thread pool, and how work is handed to it.

Kernels, OpenCV and OpenImageIO release the GIL, so threads are enough; any `concurrent.futures.Executor` can take
the pool's place.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


def thread_pool(threads: int | None = None) -> ThreadPoolExecutor:
    """A pool of `threads` workers, by default one for each core this process may use."""
    return ThreadPoolExecutor(threads or usable_cores(), thread_name_prefix="fullsphere")


def usable_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def ordered_map(
    executor: Executor | None, function: Callable[[_T], _R], items: Iterable[_T], ahead: int = 8
) -> Iterator[_R]:
    """`map(function, items)` in the order of the items, with at most `ahead` items under way or waiting to be taken.

    Unlike `Executor.map` it neither submits everything at once, which would hold every result in memory, nor goes on
    with what is queued after an error or an interrupt.  Without an executor it is the plain `map`.
    """
    if executor is None:
        yield from map(function, items)
        return
    waiting: deque[Future[_R]] = deque()
    try:
        for item in items:
            waiting.append(executor.submit(function, item))
            if len(waiting) >= ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
