"""The masks of a Hugin project: polygons of what does not count, in one picture or in all of a lens."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import cv2
import numpy as np

from fullsphere.model.errors import InputError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.masks import Mask
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.pto_text import PtoLine, checked_number

_OF_PICTURE, _OF_LENS = 0, 4  # kinds of masks that exclude what is inside
_FRACTION_BITS = 8
_FARTHEST_PX = 1e6


def masked(frames: Sequence[Frame], lines: Sequence[PtoLine], lens_of: Sequence[int]) -> tuple[list[Frame], list[str]]:
    """The frames with the masks of the lines `k`, and what was not taken over.

    `lens_of` (n) tells which frames share a lens: those with the same number.
    """
    polygons: list[list[FloatArray]] = [[] for _ in frames]
    notes = []
    for line in lines:
        number, kind = line.whole("i", upper=len(frames) - 1), line.whole("t", _OF_PICTURE)
        polygon = _polygon(line)
        if kind not in (_OF_PICTURE, _OF_LENS):
            notes.append(f"{line.where}: a mask of kind t{kind} is not taken over")
            continue
        for k in range(len(frames)):
            if k == number or (kind == _OF_LENS and lens_of[k] == lens_of[number]):
                polygons[k].append(polygon)
    return [_with_mask(*both) for both in zip(frames, polygons, strict=True)], notes


def outside_polygons(polygons: Sequence[FloatArray], size: tuple[int, int]) -> Mask:
    """A mask (h, w) that is 0 inside polygons (n, 2) of pixels, and 255 elsewhere."""
    mask = np.full(size[::-1], 255, np.uint8)
    for polygon in polygons:
        corners = np.round(polygon * (1 << _FRACTION_BITS)).astype(np.int32)
        cv2.fillPoly(mask, [corners], (0,), shift=_FRACTION_BITS)
    return mask


def _with_mask(frame: Frame, polygons: Sequence[FloatArray]) -> Frame:
    if not polygons:
        return frame
    corner = np.array((frame.crop_px or (0, 0))[:2], float)
    mask = functools.partial(outside_polygons, [polygon - corner for polygon in polygons], frame.size)
    return dataclasses.replace(frame, mask=mask)


def _polygon(line: PtoLine) -> FloatArray:
    numbers = [checked_number(text, f"{line.where}: p", _FARTHEST_PX) for text in line.text("p").split()]
    if len(numbers) < 6 or len(numbers) % 2:
        raise InputError(f"{line.where}: p holds {len(numbers)} numbers, no polygon")
    return np.array(numbers).reshape(-1, 2)
