"""Compiled loops of the seams: what a frame may gain, the middle of several frames, the nearest owner."""

from __future__ import annotations

from typing import Any

import numpy as np

from fullsphere.model.kernels import compiled

_UNSEEN = 400  # difference, where one frame of two does not look: its rim is no good place for a seam
_NEVER = 1 << 24
_STRONG = 1 << 28  # holds the pixels of a pole together
_MOST = 64  # frames of which a middle is taken


@compiled
def _difference(features: np.ndarray, quality: np.ndarray, a: Any, b: Any, y: int, x: int) -> Any:
    """How different frames a and b are at a pixel; a sum over channels, so that it obeys the triangle inequality."""
    if a == b:
        return 0
    if quality[a, y, x] <= 0 or quality[b, y, x] <= 0:
        return _UNSEEN
    total: Any = 0
    for c in range(features.shape[3]):
        total += abs(np.int32(features[a, y, x, c]) - np.int32(features[b, y, x, c]))
    return total


@compiled
def _cost(quality: np.ndarray, penalty: np.ndarray, area: np.ndarray, loss: float, k: Any, y: int, x: int) -> Any:
    """What it costs to give a pixel to frame k."""
    if quality[k, y, x] <= 0:
        return _NEVER
    step = quality.shape[1] // penalty.shape[1]
    return np.int32(area[y] * (loss * (1 - quality[k, y, x]) + penalty[k, y // step, x // step]))


@compiled
def expansion(
    owner: np.ndarray,
    alpha: int,
    pixels: np.ndarray,
    neighbours: np.ndarray,
    features: np.ndarray,
    quality: np.ndarray,
    penalty: np.ndarray,
    area: np.ndarray,
    along: int,
    across: np.ndarray,
    loss: float,
    short: int,
) -> tuple[np.ndarray, np.ndarray]:
    """The graph of which a minimum cut says which pixels gain by going over to frame alpha (the sink's side).

    After Boykov, Veksler & Zabih, PAMI 2001, with the edges of Kolmogorov & Zabih, PAMI 2004: no extra nodes.

    Parameters
    ----------
    owner
        (H, W) of now, -1 where nobody sees.
    pixels, neighbours
        The same pixels (n,) as y W + x and their neighbours (n, 4), as `max_flow.grid_neighbours` makes them.
    features, quality
        (K, H, W, c) whole numbers of which differences are taken, (K, H, W) 0 where a frame does not see.
    penalty
        (K, h, w) cost for a frame beside quality, per steradian; H and W are multiples of h and w.
    area, along, across
        (H,) of a pixel, length of an edge between columns, (H,) of the edge below a row.
    loss, short
        Cost per area of quality lost, and per length of any seam.

    Returns
    -------
    `terminal` (n,) and `capacity` (n, 4) for `max_flow.minimum_cut`.
    """
    height, width = owner.shape
    n = pixels.size
    terminal = np.zeros(n, np.int32)
    capacity = np.zeros((n, 4), np.int32)
    for i in range(n):
        y, x = pixels[i] // width, pixels[i] % width
        mine = np.int64(owner[y, x])  # of one type with alpha: one version of what is called
        terminal[i] += _cost(quality, penalty, area, loss, alpha, y, x) - _cost(
            quality, penalty, area, loss, mine, y, x
        )
        gained = _difference(features, quality, mine, alpha, y, x)
        for d in range(4):
            yy, xx, length = y, x, along
            if d == 0:
                xx = x + 1 if x + 1 < width else 0
            elif d == 1:
                xx = x - 1 if x > 0 else width - 1
            elif d == 2:
                yy, length = y + 1, across[y]
            else:
                yy, length = y - 1, across[max(y - 1, 0)]
            if yy < 0 or yy >= height:
                continue
            other, j = np.int64(owner[yy, xx]), neighbours[i, d]
            if other < 0 or (
                j >= 0 and (d == 1 or d == 3)
            ):  # between two that may change: once, from the left or above
                continue
            if d < 2 and (y == 0 or y == height - 1):  # a pole is one place
                if j >= 0:
                    capacity[i, d] = capacity[j, d ^ 1] = _STRONG
                continue
            stay = go = both = 0
            if mine != other:
                stay = _difference(features, quality, mine, other, y, x)
                stay = length * (stay + _difference(features, quality, mine, other, yy, xx) + short)
            if other != alpha:
                go = length * (
                    _difference(features, quality, alpha, other, y, x)
                    + _difference(features, quality, alpha, other, yy, xx)
                    + short
                )
            if j < 0:
                terminal[i] += go - stay
                continue
            # both may change: stay = E(0, 0), both = E(0, 1), go = E(1, 0), E(1, 1) = 0
            both = length * (gained + _difference(features, quality, mine, alpha, yy, xx) + short)
            terminal[i] += go - stay
            terminal[j] -= go
            capacity[i, d] = max(both + go - stay, 0)
    return terminal, capacity


@compiled
def code_at(
    light: np.ndarray, quality: np.ndarray, needed: np.ndarray, scale: Any, per_stop: Any, features: np.ndarray
) -> None:
    """Code the light (H, W, 3) of a frame at the pixels `needed` (H, W) into `features` (H, W, 5).

    Three channels of logarithmic light, less steep in the dark, and the slopes of their mean to the right and down, as
    far as the frame sees (`quality` > 0) and pixels beside are needed too.
    """
    height, width = quality.shape
    grey = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            if needed[y, x] and quality[y, x] > 0:
                total = np.float32(0)
                for c in range(3):
                    bright = min(max(light[y, x, c] * scale, np.float32(0)), np.float32(1e9))
                    code = per_stop * np.log2(bright + np.float32(0.125))
                    features[y, x, c] = round(code)
                    total += code
                grey[y, x] = total / np.float32(3)
    for y in range(height):
        for x in range(width):
            if not needed[y, x] or quality[y, x] <= 0:
                continue
            features[y, x, 3] = features[y, x, 4] = 0
            if y == 0 or y == height - 1:
                continue
            right, left = x + 1 if x + 1 < width else 0, x - 1 if x > 0 else width - 1
            if quality[y, left] > 0 and quality[y, right] > 0 and needed[y, left] and needed[y, right]:
                features[y, x, 3] = round(grey[y, right] - grey[y, left])
            if quality[y - 1, x] > 0 and quality[y + 1, x] > 0 and needed[y - 1, x] and needed[y + 1, x]:
                features[y, x, 4] = round(grey[y + 1, x] - grey[y - 1, x])


@compiled
def best_frame(quality: np.ndarray, owner: np.ndarray) -> None:
    """Where `owner` (H, W) is negative, put the frame of the best `quality` (K, H, W) there, if any is positive."""
    for y in range(owner.shape[0]):
        for x in range(owner.shape[1]):
            if owner[y, x] < 0:
                best = np.float32(0)
                for k in range(quality.shape[0]):
                    if quality[k, y, x] > best:
                        best = quality[k, y, x]
                        owner[y, x] = k


@compiled
def middle(light: np.ndarray, quality: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The median (H, W, c) over the frames that see a pixel (those with the best 64), and how many they are (H, W).

    Of an even number it is the mean of the two in the middle.
    """
    frames, height, width, channels = light.shape
    result = np.zeros((height, width, channels), np.int16)
    count = np.zeros((height, width), np.int16)
    values = np.empty(_MOST, np.int32)
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                n = 0
                for k in range(frames):
                    if quality[k, y, x] > 0 and n < _MOST:
                        value = np.int32(light[k, y, x, c])
                        i = n
                        while i > 0 and values[i - 1] > value:
                            values[i] = values[i - 1]
                            i -= 1
                        values[i] = value
                        n += 1
                count[y, x] = n
                if n > 0:
                    result[y, x, c] = (values[(n - 1) // 2] + values[n // 2]) // 2
    return result, count


@compiled
def _outside(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> Any:
    total = 0
    for c in range(value.size):
        v = np.int32(value[c])
        total += max(v - high[c], low[c] - v, 0)
    return total


@compiled
def deviations(
    light: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    quality: np.ndarray,
    mid: np.ndarray,
    mid_low: np.ndarray,
    mid_high: np.ndarray,
    count: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """How far frames are from what the others saw, beyond what a small shift explains.

    Parameters
    ----------
    light, low, high
        (K, H, W, c) of the frames, and its least and largest value around a pixel.
    quality
        (K, H, W) 0 where a frame does not see.
    mid, mid_low, mid_high, count
        The same (H, W, c) of the frames' median, and how many saw (H, W).

    Returns
    -------
    `single` (K, H, W): of a frame from the median, 0 where fewer than three see.  `any_two` (H, W): the largest of
    these, or how far two are from each other.
    """
    frames, height, width = quality.shape
    single = np.zeros((frames, height, width), np.int16)
    any_two = np.zeros((height, width), np.int16)
    for y in range(height):
        for x in range(width):
            if count[y, x] == 2:
                a, b = -1, -1
                for k in range(frames):
                    if quality[k, y, x] > 0:
                        a, b = b, k
                any_two[y, x] = max(
                    _outside(light[a, y, x], low[b, y, x], high[b, y, x]),
                    _outside(light[b, y, x], low[a, y, x], high[a, y, x]),
                )
            elif count[y, x] > 2:
                for k in range(frames):
                    if quality[k, y, x] > 0:
                        single[k, y, x] = max(
                            _outside(light[k, y, x], mid_low[y, x], mid_high[y, x]),
                            _outside(mid[y, x], low[k, y, x], high[k, y, x]),
                        )
                        any_two[y, x] = max(any_two[y, x], single[k, y, x])
    return single, any_two


@compiled
def fill_nearest(owner: np.ndarray, latitude_sin: np.ndarray, latitude_cos: np.ndarray, turn: np.ndarray) -> None:
    """Give every pixel whose `owner` (H, W) is negative the owner nearest on the sphere.

    The nearest owned pixel is handed on from neighbour to neighbour (after Danielsson, 1980): rightwards and
    leftwards, down and up, past the edge and over the poles, until nothing gets nearer.  `turn` (W,) is the cosine of
    the longitude between two columns so many apart.
    """
    height, width = owner.shape
    nearest = np.empty((height, width), np.int32)
    missing = 0
    for y in range(height):
        for x in range(width):
            nearest[y, x] = y * width + x if owner[y, x] >= 0 else -1
            missing += owner[y, x] < 0
    if missing == 0 or missing == height * width:
        return
    changed = True
    while changed:
        changed = False
        for sweep in range(2):
            for i in range(height):
                y = i if sweep == 0 else height - 1 - i
                for j in range(2 * width):  # twice around, so that what comes past the edge goes on
                    x = j % width if sweep == 0 else width - 1 - j % width
                    if owner[y, x] >= 0:
                        continue
                    held = nearest[y, x]
                    best = np.float64(-2.0)
                    if held >= 0:
                        best = latitude_sin[y] * latitude_sin[held // width]
                        best += latitude_cos[y] * latitude_cos[held // width] * turn[abs(x - held % width)]
                    for d in range(8):
                        yy = y + (d % 3 - 1 if d < 6 else 0)
                        xx = x + (1 if d < 3 else -1)
                        if d >= 6:
                            yy, xx = y + (1 if d == 6 else -1), x
                        if yy < 0 or yy >= height:
                            yy, xx = y, xx + width // 2
                        xx = xx % width
                        new = nearest[yy, xx]
                        if new < 0 or new == held:
                            continue
                        near = latitude_sin[y] * latitude_sin[new // width]
                        near += latitude_cos[y] * latitude_cos[new // width] * turn[abs(x - new % width)]
                        if near > best:
                            held, best, changed = new, near, True
                    nearest[y, x] = held
    for y in range(height):
        for x in range(width):
            if owner[y, x] < 0:
                owner[y, x] = owner[nearest[y, x] // width, nearest[y, x] % width]
