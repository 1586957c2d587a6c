"""The compiled loop that makes a frame small: its light averaged over squares of pixels."""

from __future__ import annotations

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
