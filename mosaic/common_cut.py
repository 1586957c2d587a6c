"""Frames of one camera whose borders were trimmed a little differently, cut to what all of them have."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from fullsphere.mosaic.loading import Crop, loader_of
from fullsphere.mosaic.project import Frame

_ALIKE = 0.01  # of a side: by so much sizes may differ and be those of one camera, trimmed


def cut_alike(frames: Sequence[Frame], usual: tuple[int, int]) -> list[Frame]:
    """The frames, those of almost the usual size cut about their middles to the least width and height among them.

    Programs that save, scan or straighten pictures trim some pixels here and more there.  Where a picture was trimmed
    it does not say; the error of its centre, at most half of the difference, is nearly a small turn of the camera,
    which registration finds.

    Parameters
    ----------
    frames
        Frames of whole files.
    usual
        The size that most of them have.
    """
    alike = [not frame.reason and _is_alike(frame.size, usual) for frame in frames]
    sizes = {frame.size for frame, is_alike in zip(frames, alike, strict=True) if is_alike}
    if len(sizes) < 2:
        return list(frames)
    least = min(width for width, _ in sizes), min(height for _, height in sizes)
    return [
        _cut(frame, least) if is_alike and frame.size != least else frame
        for frame, is_alike in zip(frames, alike, strict=True)
    ]


def _is_alike(size: tuple[int, int], usual: tuple[int, int]) -> bool:
    return all(abs(side - other) <= _ALIKE * other for side, other in zip(size, usual, strict=True))


def _cut(frame: Frame, size: tuple[int, int]) -> Frame:
    crop = _middle(frame.size, size) if frame.turned % 2 == 0 else _middle(frame.size[::-1], size[::-1])
    return dataclasses.replace(frame, size=size, crop_px=crop, load=loader_of(frame, crop, frame.turned))


def _middle(size: tuple[int, int], part: tuple[int, int]) -> Crop:
    return (size[0] - part[0]) // 2, (size[1] - part[1]) // 2, *part
