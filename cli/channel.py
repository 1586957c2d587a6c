"""Handing items from one thread to another, in order, a few at most on their way."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

_T = TypeVar("_T")

LOOK_UP_S = 0.25
"""Seconds after which a thread that waits lets Python see to its signals."""


class ClosedError(Exception):
    """The channel was closed: nobody takes what is given any more."""


class Channel(Generic[_T]):
    """A queue with room for few items that can be ended by the giver and closed by either side.

    `queue.Queue` cannot wake a thread that waits for an item, or for room, when the other side has failed.
    """

    def __init__(self, room: int = 1) -> None:
        """At most `room` items wait to be taken."""
        self._room = room
        self._items: deque[_T] = deque()
        self._changed = threading.Condition()
        self._ended = self._closed = False
        self._error: BaseException | None = None

    def give(self, item: _T) -> None:
        """Hand an item over, once there is room; ClosedError if the channel was closed."""
        with self._changed:
            self._wait_until(lambda: len(self._items) < self._room or self._closed)
            if self._closed:
                raise self._error or ClosedError
            self._items.append(item)
            self._changed.notify_all()

    def end(self, error: BaseException | None = None) -> None:
        """No more items: the taker gets those that wait, and then the error, if there is one."""
        with self._changed:
            self._ended = True
            self._error = self._error or error
            self._changed.notify_all()

    def close(self, error: BaseException | None = None) -> None:
        """Drop what waits; whoever gives or takes gets the error (the giver ClosedError, if there is none) at once."""
        with self._changed:
            self._items.clear()
            self._ended = self._closed = True
            self._error = self._error or error
            self._changed.notify_all()

    def check(self) -> None:
        """Raise the error that the channel was ended or closed with, if there was one."""
        with self._changed:
            if self._error is not None:
                raise self._error

    def __iter__(self) -> Iterator[_T]:
        """The items, until the channel is ended."""
        while True:
            with self._changed:
                self._wait_until(lambda: bool(self._items) or self._ended)
                if not self._items:
                    if self._error is not None:
                        raise self._error
                    return
                item = self._items.popleft()
                self._changed.notify_all()
            yield item

    def _wait_until(self, ready: Callable[[], bool]) -> None:
        """Wait, and look up now and then: a Ctrl-C that comes just before a wait begins does not end it by itself."""
        while not ready():
            self._changed.wait(LOOK_UP_S)
