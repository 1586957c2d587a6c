"""Pyramids of pictures of the whole sphere: no edge, and no seam at the poles.

A picture (H, W) or (H, W, C) float32 is equirectangular with W = 2H.  The kernel [1 3 3 1]/8 keeps the corners of
pixels aligned: coarse pixel (x, y) is made of fine pixels 2x, 2x + 1 and 2y, 2y + 1 and one more on each side.
Repeated expansion gives quadratic B-splines.  A row's pixels are narrower by the cosine of its latitude, so across a
row both directions are widened by its inverse: what is blurred is blurred alike everywhere on the sphere, as far as
rows are straight.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import UsageError
from fullsphere.mosaic.sphere_kernels import expand_rows, fill_in, reduce_rows

_VARIANCE = 0.75  # of the kernel [1 3 3 1]/8, in fine pixels squared


def sizes(height: int, width: int, smallest: int = 8) -> list[tuple[int, int]]:
    """(height, width) of each level, finest first: halves down to `smallest` rows, or where the height gets odd.

    Raises
    ------
    UsageError
        The sphere is not twice as wide as high.
    """
    if height < 1 or width != 2 * height:
        raise UsageError(f"a sphere of {width} x {height} pixels: the width must be twice the height")
    levels = [(height, width)]
    while height % 2 == 0 and height // 2 >= smallest:
        height //= 2
        levels.append((height, 2 * height))
    return levels


def reduce(fine: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W) or (H, W, C) -> half of H and W, both even."""
    height, width = fine.shape[0] // 2, fine.shape[1] // 2
    coarse = np.empty((height, width, *fine.shape[2:]), np.float32)
    reduce_rows(_rows(fine), _channels(fine), *_boxes_of_reduction(height), _rows(coarse))
    return coarse


def expand(coarse: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W) or (H, W, C) -> twice H and W."""
    height, width = 2 * coarse.shape[0], 2 * coarse.shape[1]
    fine = np.empty((height, width, *coarse.shape[2:]), np.float32)
    expand_rows(_rows(coarse), _channels(coarse), *_boxes_of_expansion(height), _rows(fine))
    return fine


def gaussian(picture: NDArray[np.float32], levels: int) -> list[NDArray[np.float32]]:
    """The picture and its reductions, finest first."""
    pyramid = [picture]
    while len(pyramid) < levels:
        pyramid.append(reduce(pyramid[-1]))
    return pyramid


def continued(weighted: NDArray[np.float32], coverage: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture carried on smoothly to where nothing is known of it: pushed up a pyramid and pulled down again.

    After Gortler, Grzeszczuk, Szeliski and Cohen, "The Lumigraph" (1996).

    Parameters
    ----------
    weighted
        (H, W, C) the picture times its coverage.
    coverage
        (H, W) 0 to 1; where it is 1 the picture comes back as it was.  Far from all that is known, by more than a pixel
        or two of the coarsest level, stands its mean; nothing known anywhere gives zeros.
    """
    levels = len(sizes(*coverage.shape))
    pictures, coverages = gaussian(weighted, levels), gaussian(coverage, levels)
    solid_angle = np.cos(latitudes(pictures[-1].shape[0]))[:, None]
    known = float((coverages[-1] * solid_angle).sum())
    total = (pictures[-1] * solid_angle[..., None]).sum(axis=(0, 1))
    mean = total / known if known > 0 else np.zeros_like(total)
    filled = np.empty_like(pictures[-1])
    filled[:] = mean
    for level in range(levels - 1, -1, -1):
        if level < levels - 1:
            filled = expand(filled)
        fill_in(pictures[level], coverages[level], filled)
    return filled


def latitudes(height: int) -> NDArray[np.float64]:
    """(height,) latitude of each row, in radians up."""
    return (0.5 - (np.arange(height) + 0.5) / height) * np.pi


@functools.cache
def _boxes_of_reduction(height: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The boxes of `reduce_rows`: those of the coarse rows, in fine pixels."""
    return boxes(_VARIANCE * np.tan(latitudes(height)) ** 2, 2 * 2 * height)


@functools.cache
def _boxes_of_expansion(height: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The boxes of `expand_rows`: those of the fine rows, in coarse pixels."""
    return boxes(_VARIANCE / 4 * np.tan(latitudes(height)) ** 2, height)


def boxes(variance: NDArray[np.float64], width: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Two equal boxes that together blur by a variance, in pixels squared, on a row of `width` pixels.

    A box is `whole` pixels on each side of the middle and a `fraction` of the next; of them all
    whole (whole + 1)(2 whole + 1)/3 + 2 fraction (whole + 1)^2 = variance (2 whole + 1 + 2 fraction).
    It never holds a pixel twice: at its widest it is the mean of the row.
    """
    each = variance / 2
    whole = np.floor(np.sqrt(3 * each + 0.25) - 0.5)
    whole -= whole * (whole + 1) / 3 > each
    lacking = each * (2 * whole + 1) - whole * (whole + 1) * (2 * whole + 1) / 3
    fraction = np.clip(lacking / (2 * ((whole + 1) ** 2 - each)), 0, 1)
    most = (width - 1) / 2
    wide = whole + fraction > most
    whole = np.where(wide, np.floor(most), whole)
    fraction = np.where(wide, most - np.floor(most), fraction)
    return whole.astype(np.int64), fraction


def _channels(picture: NDArray[np.float32]) -> int:
    return picture.shape[2] if picture.ndim == 3 else 1


def _rows(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.ascontiguousarray(picture, np.float32).reshape(picture.shape[0], -1)
