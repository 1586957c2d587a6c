"""The compiled loop that adds one bracket to the light of a frame, pixel by pixel, as far as it is to be trusted."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.kernels import compiled

FLOOR = 0.003
"""Linear light at which the noise of rounding and reading is as strong as that of counted photons."""

LEAST = 1e-6
"""What the reference counts where it is clipped: nothing beside a bracket that is not, all where there is none."""


@compiled
def add_bracket(
    codes: np.ndarray,
    light_of_code: np.ndarray,
    exposure: float,
    darkest: bool,
    least: float,
    nearly: float,
    clipped: float,
    moved: np.ndarray,
    factor: int,
    light: np.ndarray,
    weight: np.ndarray,
) -> None:
    """Add light times weight, and weight, of a bracket.

    The weight is the inverse of the variance: of light E at exposure t a pixel records t E with the variance
    t E + FLOOR in some unit, so E is known with (t E + FLOOR)/t^2 (Granados et al. 2010, where the noise of a camera is
    measured).  E is taken from the brackets before, not from the noisy pixel itself, which would favour dark noise.

    Parameters
    ----------
    codes
        (h, w, c): the first three channels are colours, or the first alone where there are less.
    light_of_code
        (n,) the light that each code stands for.
    exposure
        How many times as bright as the frame the bracket is.
    darkest
        Whether no bracket is darker: it is trusted however bright it is.
    least
        Share of its weight that a pixel keeps where it is not to be trusted.
    nearly, clipped
        Light of a code: brighter than the first a pixel is trusted less, from the second on not at all.
    moved
        (H, W) 0..1 over squares of `factor` pixels: where the bracket shows another thing than those before.
    light, weight
        (h, w, 1 or 3) and (h, w), added to.
    """
    channels, bottom, right = light.shape[2], moved.shape[0] - 1, moved.shape[1] - 1
    value = np.empty(3, np.float32)
    per_square, per_exposure = np.float32(1 / factor), np.float32(1 / exposure)
    t, half, one, zero = np.float32(exposure), np.float32(0.5), np.float32(1), np.float32(0)
    full, span, floor = np.float32(nearly), np.float32(clipped - nearly), np.float32(FLOOR)
    for j in range(weight.shape[0]):
        y = min(max((np.float32(j) + half) * per_square - half, zero), np.float32(bottom))
        above = np.int64(math.floor(y))
        below, dy = min(above + 1, bottom), y - np.float32(above)
        for i in range(weight.shape[1]):
            brightest = zero
            before = zero
            for k in range(channels):
                value[k] = light_of_code[np.int64(codes[j, i, k])]
                brightest = max(brightest, value[k])
                before = max(before, light[j, i, k])
            x = min(max((np.float32(i) + half) * per_square - half, zero), np.float32(right))
            left = np.int64(math.floor(x))
            beside, dx = min(left + 1, right), x - np.float32(left)
            upper = moved[above, left] + dx * (moved[above, beside] - moved[above, left])
            lower = moved[below, left] + dx * (moved[below, beside] - moved[below, left])
            still = one - (upper + dy * (lower - upper))
            s = min(max((brightest - full) / span, zero), one)
            trust = one if darkest else one - s * s * (np.float32(3) - s - s)
            expected = t * before / weight[j, i] if weight[j, i] > zero else brightest
            much = t * t / (expected + floor) * max(trust * still, np.float32(least))
            for k in range(channels):
                light[j, i, k] += much * value[k] * per_exposure
            weight[j, i] += much
