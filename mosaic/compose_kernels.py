"""The compiled loop that brings one frame's samples into a tile: their light, evened out, with its share."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.kernels import compiled

_SIXTH, _TWO_THIRDS, _HALF, _ONE = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5), np.float32(1)
_NEARLY, _CLIPPED = np.float32(0.85), np.float32(0.98)  # linear light of a frame
_LEAST = np.float32(1e-3)  # of a share: less counts for nothing


@compiled
def _spline(t: float, weights: np.ndarray) -> None:
    """Weights (4,) of the uniform cubic B-spline at the fraction t: never negative, with the sum 1."""
    rest = _ONE - t
    weights[0] = _SIXTH * rest * rest * rest
    weights[1] = _TWO_THIRDS - t * t * (_ONE - _HALF * t)
    weights[3] = _SIXTH * t * t * t
    weights[2] = _ONE - weights[0] - weights[1] - weights[3]


@compiled
def _clipped(code: np.ndarray, light_of_code: np.ndarray) -> float:
    """How surely a pixel is clipped in all channels, 0 to 1; light of its own (no codes) never is."""
    if light_of_code.size == 0:
        return 0.0
    least = light_of_code[np.int64(min(code[0], code[1], code[2]))]
    t = min(max((least - _NEARLY) / (_CLIPPED - _NEARLY), np.float32(0)), _ONE)
    return float(t * t * (np.float32(3) - t - t))


@compiled
def add_frame(
    codes: np.ndarray,
    light_of_code: np.ndarray,
    opaque: float,
    u: np.ndarray,
    z: np.ndarray,
    z_rim: float,
    factors: np.ndarray,
    over_z: np.ndarray,
    z_min: float,
    at: np.ndarray,
    sphere_width: int,
    share: np.ndarray,
    left: int,
    top: int,
    floor: float,
    white: float,
    light: np.ndarray,
    weight: np.ndarray,
) -> None:
    """Add a frame to the light of a tile, and its share to the weight.

    Parameters
    ----------
    codes
        (h, w, 3 or 4) samples of the frame; with four channels a pixel counts whose last is `opaque` or more.
    light_of_code
        (n,) the light of each code; empty where the samples are light.
    u
        (h, w) NaN where the frame shows nothing.
    z, z_rim
        (h, w) cosine of the angle from the frame's axis; what is below `z_rim` does not count.
    factors, over_z, z_min
        What takes recorded light to the scene's: (3,), and a table of equal cells of z from `z_min` to 1.
    at
        (h, w, 2) the pixels' places on the working sphere, which is `sphere_width` wide.
    share
        (H, W, 4) of a window of the working sphere from column `left` and row `top` on: how much the frame owns, and
        the logarithms by which its channels are brightened.
    floor
        The light that is added before brightening and taken off after it, so that black stays black.
    white
        Light that is white in the panorama.  What is clipped in all channels of a frame becomes as bright at least: of
        a lamp an overexposed frame only tells that it is brighter than its own white, which may be grey by now.
    light, weight
        (h, w, 3) and (h, w), added to.
    """
    across, down, value = np.empty(4, np.float32), np.empty(4, np.float32), np.empty(4, np.float32)
    per_z = np.float32((over_z.shape[0] - 1) / (1 - z_min))
    last = over_z.shape[0] - 2
    height, width = share.shape[0], share.shape[1]
    for j in range(weight.shape[0]):
        for i in range(weight.shape[1]):
            if not (u[j, i] == u[j, i] and z[j, i] >= z_rim):
                continue
            if codes.shape[2] == 4 and not codes[j, i, 3] >= opaque:
                continue
            x, y = math.floor(at[j, i, 0]), math.floor(at[j, i, 1])
            column = (np.int64(x) - 1 - left) % sphere_width
            row = np.int64(y) - 1 - top
            if row < 0 or row + 4 > height or column + 4 > width:
                continue
            _spline(at[j, i, 0] - np.float32(x), across)
            _spline(at[j, i, 1] - np.float32(y), down)
            value[:] = 0
            for m in range(4):
                for n in range(4):
                    part = down[m] * across[n]
                    for k in range(4):
                        value[k] += part * share[row + m, column + n, k]
            if value[0] < _LEAST:
                continue
            much = value[0] * value[0]
            much *= much
            cell = (z[j, i] - np.float32(z_min)) * per_z
            first = min(max(np.int64(cell), 0), last)
            gain = over_z[first] + (cell - np.float32(first)) * (over_z[first + 1] - over_z[first])
            weight[j, i] += much
            clipped = _clipped(codes[j, i], light_of_code)
            for k in range(3):
                code = codes[j, i, k]
                linear = (
                    light_of_code[np.int64(code)] if light_of_code.size > 0 else max(np.float32(code), np.float32(0))
                )
                linear *= gain * factors[k]
                linear += clipped * max(np.float32(white) - linear, np.float32(0))
                if value[k + 1] != 0:
                    linear += (linear + np.float32(floor)) * np.float32(math.expm1(value[k + 1]))
                light[j, i, k] += much * linear
