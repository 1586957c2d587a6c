"""Compiled loops of a pyramid on the sphere: one equirectangular picture to half its size and back.

Pictures are rows of interleaved channels, (h, w*c) float32.  Columns wrap, and past a pole a row goes on at the row
mirrored there and rolled by half a turn.  Unsigned indices spare the question whether they are negative, and with
`compiled_apart` loops run several pixels at a time.
"""

from __future__ import annotations

import numpy as np

from fullsphere.model.kernels import compiled_apart


@compiled_apart
def _add_row(picture: np.ndarray, y: int, channels: int, weight: float, line: np.ndarray) -> None:
    """Add a weighted row (w*c,) of a picture to a line; y may lie past a pole."""
    height, length = picture.shape
    share = np.float32(weight)
    if 0 <= y < height:
        row = picture[y]
        for i in range(np.uint64(length)):
            line[i] += share * row[i]
        return
    row = picture[-1 - y if y < 0 else 2 * height - 1 - y]
    half = np.uint64(length // channels // 2 * channels)
    rest = np.uint64(length) - half
    for i in range(rest):
        line[i] += share * row[i + half]
    for i in range(half):
        line[rest + i] += share * row[i]


@compiled_apart
def _carry_on(line: np.ndarray, reach: int, around: np.ndarray) -> None:
    """The line (n,) with `reach` values more on each side, around (n + 2 reach,) at least."""
    length, beyond = np.uint64(line.size), np.uint64(reach)
    start = length - beyond
    for i in range(beyond):
        around[i] = line[start + i]
        around[beyond + length + i] = line[i]
    for i in range(length):
        around[beyond + i] = line[i]


@compiled_apart
def _blur_once(
    line: np.ndarray, channels: int, whole: int, fraction: float, around: np.ndarray, sums: np.ndarray
) -> None:
    """The mean of each pixel of a line (w*c,) and its neighbours: `whole` on each side, and `fraction` of the next.

    around, sums (2 w*c + 4 c,): room for the line carried on around in float32, and for its running sums in float64,
    of which a difference is as good as the sum of its few terms.
    """
    length, step = np.uint64(line.size), np.uint64(channels)
    reach = np.uint64(whole + 1) * step
    _carry_on(line, (whole + 1) * channels, around)
    if whole == 0:
        side = np.float32(fraction / (1 + 2 * fraction))
        middle = np.float32(1) - np.float32(2) * side
        for i in range(length):
            line[i] = middle * around[i + reach] + side * (around[i] + around[i + np.uint64(2) * reach])
        return
    for c in range(step):
        total = 0.0
        sums[c] = total
        for i in range(c, length + np.uint64(2) * reach - step, step):
            total += around[i]
            sums[i + step] = total
    per_weight = 1.0 / (2 * whole + 1 + 2 * fraction)
    for i in range(length):
        far = i + np.uint64(2) * reach
        line[i] = (sums[far] - sums[i + step] + fraction * (around[i] + around[far])) * per_weight


@compiled_apart
def _halve(around: np.ndarray, channels: int, row: np.ndarray) -> None:
    """row (w*c,) = [1 3 3 1]/8 of a line with a pixel more on each side, ((2 w + 2) c,)."""
    outer, inner, step = np.float32(0.125), np.float32(0.375), np.uint64(channels)
    for x in range(np.uint64(row.size) // step):
        at, to = np.uint64(2) * x * step, x * step
        for c in range(step):
            i = at + c
            sides = around[i] + around[i + np.uint64(3) * step]
            row[to + c] = outer * sides + inner * (around[i + step] + around[i + np.uint64(2) * step])


@compiled_apart
def _double(around: np.ndarray, channels: int, row: np.ndarray) -> None:
    """row (2 w*c,) = between two pixels, 3 to 1, of a line with a pixel more on each side, ((w + 2) c,)."""
    far, near, step = np.float32(0.25), np.float32(0.75), np.uint64(channels)
    for x in range(np.uint64(row.size) // (np.uint64(2) * step)):
        at, to = x * step, np.uint64(2) * x * step
        for c in range(step):
            i = at + c
            middle = near * around[i + step]
            row[to + c] = middle + far * around[i]
            row[to + step + c] = middle + far * around[i + np.uint64(2) * step]


@compiled_apart
def reduce_rows(fine: np.ndarray, channels: int, whole: np.ndarray, fraction: np.ndarray, coarse: np.ndarray) -> None:
    """Half the size: the kernel [1 3 3 1]/8 down and across, and across the boxes that the latitude asks for.

    fine (2 h, 2 w*c), coarse (h, w*c) is written; whole, fraction (h,): the boxes, in columns of `fine`.  Two boxes one
    after the other are nearly a bell, and its width is a real number.
    """
    length = fine.shape[1]
    line = np.empty(length, np.float32)
    around, sums = np.empty(2 * length + 4 * channels, np.float32), np.empty(2 * length + 4 * channels)
    for y in range(coarse.shape[0]):
        line[:] = 0
        for k in range(4):
            _add_row(fine, 2 * y - 1 + k, channels, 0.125 if k == 0 or k == 3 else 0.375, line)
        _blur_once(line, channels, whole[y], fraction[y], around, sums)
        _blur_once(line, channels, whole[y], fraction[y], around, sums)
        _carry_on(line, channels, around)
        if channels == 1:
            _halve(around, 1, coarse[y])
        elif channels == 3:
            _halve(around, 3, coarse[y])
        else:
            _halve(around, channels, coarse[y])


@compiled_apart
def expand_rows(coarse: np.ndarray, channels: int, whole: np.ndarray, fraction: np.ndarray, fine: np.ndarray) -> None:
    """Twice the size: between the two nearest coarse pixels 3 to 1, and across the boxes that the latitude asks for.

    coarse (h, w*c), fine (2 h, 2 w*c) is written; whole, fraction (2 h,): the boxes, in columns of `coarse`.
    """
    length = coarse.shape[1]
    line = np.empty(length, np.float32)
    around, sums = np.empty(2 * length + 4 * channels, np.float32), np.empty(2 * length + 4 * channels)
    for y in range(fine.shape[0]):
        line[:] = 0
        _add_row(coarse, y // 2, channels, 0.75, line)
        _add_row(coarse, y // 2 + (1 if y % 2 == 1 else -1), channels, 0.25, line)
        _blur_once(line, channels, whole[y], fraction[y], around, sums)
        _blur_once(line, channels, whole[y], fraction[y], around, sums)
        _carry_on(line, channels, around)
        if channels == 1:
            _double(around, 1, fine[y])
        elif channels == 3:
            _double(around, 3, fine[y])
        else:
            _double(around, channels, fine[y])


@compiled_apart
def weigh_detail(fine: np.ndarray, weight: np.ndarray, detail: np.ndarray) -> None:
    """detail = weight (fine - detail): each (h, w, c), the weight (h, w); detail is read and written."""
    for y in range(np.uint64(fine.shape[0])):
        for x in range(np.uint64(fine.shape[1])):
            share = weight[y, x]
            for c in range(np.uint64(fine.shape[2])):
                detail[y, x, c] = share * (fine[y, x, c] - detail[y, x, c])


@compiled_apart
def add_detail(detail: np.ndarray, weight: np.ndarray, least: float, light: np.ndarray) -> None:
    """light += detail / weight, (h, w, c) and (h, w), where the weight is more than `least`; light is written."""
    for y in range(np.uint64(light.shape[0])):
        for x in range(np.uint64(light.shape[1])):
            if weight[y, x] > least:
                per_weight = np.float32(1) / weight[y, x]
                for c in range(np.uint64(light.shape[2])):
                    light[y, x, c] += detail[y, x, c] * per_weight


@compiled_apart
def fill_in(weighted: np.ndarray, coverage: np.ndarray, coarser: np.ndarray) -> None:
    """coarser = weighted + (1 - coverage) coarser: what is known here, and for the rest what is there.

    weighted (h, w, c) is a picture times its coverage (h, w), 0 to 1; coarser (h, w, c) is read and written.  Where the
    coverage is 1 the picture is what it was, to the bit.
    """
    one = np.float32(1)
    for y in range(np.uint64(coarser.shape[0])):
        for x in range(np.uint64(coarser.shape[1])):
            unknown = one - min(coverage[y, x], one)
            for c in range(np.uint64(coarser.shape[2])):
                coarser[y, x, c] = weighted[y, x, c] + unknown * coarser[y, x, c]
