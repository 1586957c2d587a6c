"""The compiled loops that make a frame small, its light averaged over squares, and show it on the working sphere."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.kernels import compiled


@compiled
def reduced_light(
    codes: np.ndarray,
    light_of_code: np.ndarray,
    white: float,
    disc: np.ndarray,
    factor: int,
    light: np.ndarray,
    seen: np.ndarray,
    clipped: np.ndarray,
) -> None:
    """Average the light of the pixels that count over squares of `factor` pixels a side.

    Parameters
    ----------
    codes
        (h, w, 3 or 4) of a frame; a pixel with a fourth channel of zero, or one that is not finite, does not count.
    light_of_code
        (n,) the light that each code stands for; empty where the codes are light.
    white
        Codes from which on a channel is clipped.
    disc
        Centre u, centre v, aspect and the square of the radius outside which pixels do not count.
    light, seen, clipped
        Written: (H, W, 3) the average, (H, W) the share of pixels that count, (H, W) the share of those clipped.
    """
    for j in range(seen.shape[0]):
        for i in range(seen.shape[1]):
            r, g, b = np.float32(0), np.float32(0), np.float32(0)
            count, bright = 0, 0
            for y in range(j * factor, (j + 1) * factor):
                down = (y - disc[1]) / disc[2]
                for x in range(i * factor, (i + 1) * factor):
                    across = x - disc[0]
                    if not across * across + down * down <= disc[3]:
                        continue
                    if codes.shape[2] == 4 and not codes[y, x, 3] > 0:
                        continue
                    p, q, s = codes[y, x, 0], codes[y, x, 1], codes[y, x, 2]
                    if light_of_code.size > 0:
                        r += light_of_code[np.int64(p)]
                        g += light_of_code[np.int64(q)]
                        b += light_of_code[np.int64(s)]
                    elif np.isfinite(np.float32(p) + np.float32(q) + np.float32(s)):
                        r += max(np.float32(p), np.float32(0))
                        g += max(np.float32(q), np.float32(0))
                        b += max(np.float32(s), np.float32(0))
                    else:
                        continue
                    count += 1
                    if p >= white or q >= white or s >= white:
                        bright += 1
            share = np.float32(1) / np.float32(max(count, 1))
            light[j, i, 0], light[j, i, 1], light[j, i, 2] = r * share, g * share, b * share
            seen[j, i] = np.float32(count) / np.float32(factor * factor)
            clipped[j, i] = np.float32(bright) * share


@compiled
def _between(table: np.ndarray, place: float) -> float:
    """A table (n,) over 0 to 1, straight between its values, at a place; its ends beyond."""
    at = min(max(place, 0.0), 1.0) * (table.size - 1)
    low = min(int(at), table.size - 2)
    return float(table[low] + (table[low + 1] - table[low]) * (at - low))


@compiled
def shown_on_sphere(
    u: np.ndarray,
    v: np.ndarray,
    z: np.ndarray,
    small: np.ndarray,
    clipped: np.ndarray,
    factor: int,
    size: np.ndarray,
    factors: np.ndarray,
    over_z: np.ndarray,
    z_min: float,
    rim: float,
    density: np.ndarray,
    finest: float,
    far: float,
    clipped_worth: float,
    light: np.ndarray,
    quality: np.ndarray,
) -> None:
    """Show a frame on the working sphere, and say how good it is there.

    Parameters
    ----------
    u, v, z
        (H, W) positions in the frame, NaN where it does not see, and cosines of the angle from its axis.
    small, clipped
        The frame made `factor` times smaller: (h, w, 4) its light times the share that counts, and that share; (h, w)
        how much of it is clipped.
    size
        Width and height of the frame.
    factors, over_z, z_min
        What takes its light to the scene's: of `Gain`.
    rim
        The angle from the axis up to which the frame is used.
    density, finest
        (n,) pixels per radian at angles from 0 to the rim, and the most that any frame has.
    far
        The angle from rim and borders at which a frame is worth half of what it is far from them.
    clipped_worth
        What a clipped pixel is worth.
    light, quality
        Written where the frame sees: (H, W, 3) the scene's light, and (H, W) its worth, 0.001 to 1.
    """
    z_rim = math.cos(rim)
    high, wide = clipped.shape
    value = np.empty(4, np.float32)
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            if not (z[j, i] > z_rim and np.isfinite(u[j, i])):
                continue
            x = min(max((u[j, i] + 0.5) / factor - 0.5, 0.0), wide - 1.0)
            y = min(max((v[j, i] + 0.5) / factor - 0.5, 0.0), high - 1.0)
            left, top = int(x), int(y)
            right, below = min(left + 1, wide - 1), min(top + 1, high - 1)
            p, q = np.float32(x - left), np.float32(y - top)
            for c in range(4):
                upper = small[top, left, c] + (small[top, right, c] - small[top, left, c]) * p
                lower = small[below, left, c] + (small[below, right, c] - small[below, left, c]) * p
                value[c] = upper + (lower - upper) * q
            if not value[3] > 0.5:
                continue
            gain = _between(over_z, (z[j, i] - z_min) / (1 - z_min))
            for c in range(3):
                light[j, i, c] = value[c] / value[3] * gain * factors[c]
            theta = math.acos(min(z[j, i], 1.0))
            scale = _between(density, theta / rim)
            across = min(u[j, i], size[0] - 1 - u[j, i])
            down = min(v[j, i], size[1] - 1 - v[j, i])
            inwards = max(min(rim - theta, min(across, down) / scale), 0.0)
            upper = clipped[top, left] + (clipped[top, right] - clipped[top, left]) * p
            lower = clipped[below, left] + (clipped[below, right] - clipped[below, left]) * p
            dull = 1 - (1 - clipped_worth) * (upper + (lower - upper) * q)
            quality[j, i] = min(max(scale / finest * inwards / (inwards + far) * dull, 1e-3), 1.0)
