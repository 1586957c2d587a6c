"""The blocks of a picture that were read last, for several threads: each is decoded once, and different ones at a time.

A file of tiles is opened once for each thread that reads, up to four; one whose decoder goes from row to row, once.
"""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.picture_blocks import PictureBlocks

_READERS = 4

Pixels = NDArray[Any]
Place = tuple[int, int]


class BlockCache:
    """Blocks by their left and top pixel, read where they are not at hand.  Several threads may call any method."""

    def __init__(self, first: PictureBlocks, most_bytes: int, made: Callable[[Pixels], Pixels]) -> None:
        """Keep up to `most_bytes` of blocks of an opened picture, as `made` makes them; it is closed here."""
        self._first, self._most_bytes, self._made = first, most_bytes, made
        self._size = first.spec.width, first.spec.height
        self._idle: list[PictureBlocks] = [first]
        self._unopened = _READERS - 1 if first.at_random else 0
        self._kept: OrderedDict[Place, Pixels] = OrderedDict()  # the latest at the end
        self._kept_bytes = 0
        self._under_way: set[Place] = set()
        self._changed = threading.Condition()
        self._closed = False

    def block(self, left: int, top: int) -> Pixels:
        """The block that begins there; InputError if it is damaged."""
        with self._changed:
            while (left, top) in self._under_way:
                self._changed.wait()
            kept = self._kept.get((left, top))
            if kept is not None:
                self._kept.move_to_end((left, top))
                return kept
            self._under_way.add((left, top))
        try:
            width, height = self._first.block_size
            block = self.read(left, top, min(left + width, self._size[0]), min(top + height, self._size[1]))
            with self._changed:
                self._keep((left, top), block)
        finally:
            with self._changed:
                self._under_way.discard((left, top))
                self._changed.notify_all()
        return block

    def read(self, left: int, top: int, right: int, bottom: int) -> Pixels:
        """The pixels of whole blocks, which are not kept; InputError if one is damaged."""
        with self._reader() as reader:
            samples = reader.read(left, top, right, bottom)
        return np.ascontiguousarray(self._made(samples))

    def close(self) -> None:
        """Let go of the file; who reads from now on gets a ValueError."""
        with self._changed:
            self._closed = True
            self._kept.clear()
            for reader in self._idle:
                reader.close()
            self._idle.clear()
            self._changed.notify_all()

    @contextlib.contextmanager
    def _reader(self) -> Iterator[PictureBlocks]:
        reader = self._taken()
        try:
            yield reader
        finally:
            with self._changed:
                if self._closed:
                    reader.close()
                else:
                    self._idle.append(reader)
                self._changed.notify_all()

    def _taken(self) -> PictureBlocks:
        with self._changed:
            while not self._closed:
                if self._idle:
                    return self._idle.pop()
                if self._unopened:
                    self._unopened -= 1
                    return self._first.opened_again()
                self._changed.wait()
        raise ValueError(f"{self._first.path}: is closed")

    def _keep(self, place: Place, block: Pixels) -> None:
        self._kept[place] = block
        self._kept_bytes += block.nbytes
        while self._kept_bytes > self._most_bytes and self._kept:
            _, oldest = self._kept.popitem(last=False)
            self._kept_bytes -= oldest.nbytes
