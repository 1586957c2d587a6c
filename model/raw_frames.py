"""Raw video frames: pixels without any header, one frame after the other, as ffmpeg's `rawvideo` has them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.files import input_errors

PIXEL_FORMATS = {
    "gray": (1, "u1"),
    "gray16le": (1, "<u2"),
    "rgb24": (3, "u1"),
    "bgr24": (3, "u1"),
    "rgb48le": (3, "<u2"),
    "rgba": (4, "u1"),
}
"""Channels and type of the samples by ffmpeg's names; with four channels the last one is alpha."""

HELD = 3
"""A frame that `read_frames` gave is overwritten when this many more of them were asked for."""

_LARGEST_SIDE = 1 << 16


@dataclasses.dataclass(frozen=True)
class RawFormat:
    """What a stream of raw frames holds.

    Attributes
    ----------
    size
        Width and height in pixels.
    pixel_format
        One of `PIXEL_FORMATS`.

    Raises
    ------
    UsageError
        If a side is out of range or the pixel format is not known.
    """

    size: tuple[int, int]
    pixel_format: str

    def __post_init__(self) -> None:
        if self.pixel_format not in PIXEL_FORMATS:
            raise UsageError(f"raw frames: pixel format {self.pixel_format!r} is not one of {', '.join(PIXEL_FORMATS)}")
        if not all(1 <= side <= _LARGEST_SIDE for side in self.size):
            raise UsageError(f"raw frames of {self.size[0]} x {self.size[1]}: a side has 1 to {_LARGEST_SIDE} pixels")

    def __str__(self) -> str:
        return f"{self.size[0]}x{self.size[1]}:{self.pixel_format}"

    @property
    def channels(self) -> int:
        """Samples of a pixel."""
        return PIXEL_FORMATS[self.pixel_format][0]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the samples in the stream."""
        return np.dtype(PIXEL_FORMATS[self.pixel_format][1])

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a frame's array: (h, w), or (h, w, c)."""
        width, height = self.size
        return (height, width) if self.channels == 1 else (height, width, self.channels)

    @property
    def frame_bytes(self) -> int:
        """Bytes that a frame takes."""
        return self.size[0] * self.size[1] * self.channels * self.dtype.itemsize

    def resized(self, size: tuple[int, int]) -> Self:
        """The same pixels in frames of another size."""
        return dataclasses.replace(self, size=size)


def parse_raw_format(text: str) -> RawFormat:
    """The format that `WxH:PIXELS` spells, 3000x3000:rgb24 for example; UsageError if it spells none."""
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9}):(\w+)", text, re.ASCII)
    if match is None:
        raise UsageError(f"raw frames: {text!r} is not WIDTHxHEIGHT:PIXELS, such as 3000x3000:rgb24")
    return RawFormat((int(match[1]), int(match[2])), match[3])


def read_frames(stream: BinaryIO, form: RawFormat, name: str) -> Iterator[NDArray[Any]]:
    """The frames of a stream, arrays of `form.shape`, in turn from `HELD` buffers.

    Parameters
    ----------
    stream
        Where the frames come from; unbuffered is best, because whole frames are read.
    form
        What they are.
    name
        Of the stream, in messages.

    Raises
    ------
    InputError
        If the stream cannot be read, ends within a frame, or holds no frame at all.
    """
    buffers = [np.empty(form.shape, form.dtype) for _ in range(HELD)]
    number = 0
    while True:
        frame = buffers[number % HELD]
        number += 1
        count = _filled(stream, frame.reshape(-1).view(np.uint8).data, name)
        if count == form.frame_bytes:
            yield frame if frame.dtype.isnative else frame.astype(frame.dtype.newbyteorder("="))
        elif count or number == 1:
            fault = (
                f"frame {number} is incomplete, {count} of {form.frame_bytes} bytes" if count else "there is no frame"
            )
            raise InputError(f"{name}: {fault}; does the sender write {form}?")
        else:
            return


def write_frame(stream: BinaryIO, frame: NDArray[Any], form: RawFormat) -> None:
    """Write one frame of `form.shape` whole; OSError if the stream does not take it.

    Raises
    ------
    ValueError
        If the frame has another shape or another type of sample.
    """
    if frame.shape != form.shape or frame.dtype != form.dtype.newbyteorder("="):
        raise ValueError(f"a frame of {frame.shape} {frame.dtype}, not {form.shape} {form.dtype}")
    plain = np.ascontiguousarray(frame, form.dtype)
    rest = plain.reshape(-1).view(np.uint8).data
    while rest:
        rest = rest[stream.write(rest) :]


def _filled(stream: BinaryIO, buffer: memoryview, name: str) -> int:
    """How many bytes of `buffer` the stream could fill; fewer than all of them only at its end."""
    count = 0
    with input_errors(Path(name)):
        while count < len(buffer):
            got: int = stream.readinto(buffer[count:])  # type: ignore[attr-defined]  # every binary stream has it
            if not got:
                break
            count += got
    return count
