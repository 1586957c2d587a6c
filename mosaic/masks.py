"""Masks: which pixels of a frame count, from pictures that are white where it does.

One file is the mask of all frames, for what turns with the camera: the tripod's head, a scratch on the lens.  A folder
holds masks of single frames, for what moves: that of IMG_1.jpg is IMG_1_mask.png.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import InputError
from fullsphere.model.images import picture_size, read_picture
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.loading import Crop, cut
from fullsphere.mosaic.project import Frame, Picture

Mask = NDArray[np.uint8]
"""(h, w): 255 where a pixel counts, 0 where it does not."""


@dataclasses.dataclass(frozen=True)
class Masks:
    """Where the masks of a set of frames are: one file for all, or a folder."""

    path: Path
    for_all: bool

    def of(self, picture: Path) -> Path | None:
        """The file with the mask of a picture; None if it has none."""
        if self.for_all:
            return self.path
        own = self.path / f"{picture.stem}_mask.png"
        return own if own.is_file() else None


def open_masks(path: Path) -> Masks:
    """Masks from a file, which is for all frames, or a folder of files named after the frames.

    Raises
    ------
    InputError
        If there is no such file or folder.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: there is no such mask; give a picture, or a folder of them")
    return Masks(path, not path.is_dir())


def load_mask(path: Path, size: tuple[int, int], frame: str, crop_px: Crop | None = None, turned: int = 0) -> Mask:
    """Read the mask (h, w) of a frame: 255 where the file is at least half as bright as white and not transparent.

    Parameters
    ----------
    path
        A picture, grey or in colour.
    size
        Width and height of the frame's file.  A mask may have them, and is cut and turned as the frame is; or it has
        those of the frame, and lies as its camera holds pictures.
    frame
        The frame's name, for errors.
    crop_px, turned
        The frame's part of the file and how that is turned, as `loader` has it.

    Raises
    ------
    InputError
        If the file cannot be read, has another size, or leaves nothing of the frame.
    """
    pixels = read_picture(path).pixels
    height, width = pixels.shape[:2]
    own = size if crop_px is None else crop_px[2:]
    own = own if turned % 2 == 0 else own[::-1]
    if (width, height) not in (size, own):
        raise InputError(
            f"{path}: is a mask of {width} x {height} pixels, {frame} has {size[0]} x {size[1]}; give them one size"
        )
    white = 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)
    counts = pixels[..., :3].max(-1) >= 0.5 * white
    if pixels.shape[2] == 4:
        counts &= pixels[..., 3] >= 0.5 * white
    mask = np.where(counts, 255, 0).astype(np.uint8)
    if (width, height) == size:
        mask = cut(path, mask, crop_px, turned)
    if not mask.any():
        raise InputError(f"{path}: is black all over {frame}; what counts is white in a mask, what does not is black")
    return mask


def masked(frames: Sequence[Frame], masks: Masks, executor: Executor | None = None) -> list[Frame]:
    """The frames with their masks, each of which is read once to see that it can be used.

    Raises
    ------
    InputError
        If a mask cannot be read, has another size than its picture, or leaves nothing of it; or there is none.
    """
    given = list(ordered_map(executor, lambda frame: _with_mask(frame, masks), frames))
    if not any(frame.mask for frame in given) and any(not frame.reason for frame in frames):
        raise InputError(f"{masks.path}: holds a mask of none of the frames; that of IMG_1.jpg is IMG_1_mask.png")
    return given


def used(frame: Frame) -> Picture:
    """A frame's pixels, those of them transparent that do not count: (h, w, 4) where it has a mask.

    Raises
    ------
    InputError
        If its file or its mask cannot be read any more.
    """
    picture = frame.load()
    if frame.mask is None:
        return picture
    opaque = 1 if picture.dtype.kind == "f" else np.iinfo(picture.dtype).max
    alpha = picture[..., 3] if picture.shape[2] == 4 else np.full(picture.shape[:2], opaque, picture.dtype)
    colour = np.broadcast_to(picture[..., :3], (*picture.shape[:2], 3))
    return np.dstack([colour, np.where(frame.mask() > 0, alpha, 0).astype(picture.dtype)])


def _with_mask(frame: Frame, masks: Masks) -> Frame:
    own = [] if frame.reason else [masks.of(Path(image)) for image in frame.images]
    path = next(filter(None, own), None)
    if path is None:
        return frame
    load = functools.partial(load_mask, path, picture_size(Path(frame.image)), frame.id, frame.crop_px, frame.turned)
    load()
    return dataclasses.replace(frame, mask=load, mask_image=str(path))
