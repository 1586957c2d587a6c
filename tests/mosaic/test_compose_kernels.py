"""The kernel of composition against its slow twin."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.mosaic.compose_kernels import add_frame

WIDTH = 32  # of the working sphere
SHAPE = (6, 7)


def spline(distance: float) -> float:
    """The uniform cubic B-spline."""
    x = abs(distance)
    if x >= 2:
        return 0.0
    return (2 - x) ** 3 / 6 if x >= 1 else 2 / 3 - x * x * (1 - x / 2)


def read(share: NDArray[Any], left: int, top: int, x: float, y: float) -> NDArray[Any]:
    """(4,) of the window at a place of the working sphere, which goes round."""
    value = np.zeros(4)
    for row in range(share.shape[0]):
        for column in range(share.shape[1]):
            across = (left + column - x + WIDTH / 2) % WIDTH - WIDTH / 2
            value += spline(top + row - y) * spline(across) * share[row, column]
    return value


@pytest.mark.parametrize("left", [5, 27], ids=["in the middle", "over the right edge"])
@pytest.mark.parametrize(("dtype", "channels"), [(np.uint8, 3), (np.uint16, 4), (np.float32, 3), (np.float32, 4)])
def test_a_frame_is_added_as_its_twin_does(dtype: Any, channels: int, left: int) -> None:
    rng = np.random.default_rng(left)
    full = 1.0 if dtype == np.float32 else float(np.iinfo(dtype).max)
    codes = (rng.uniform(-0.1 if dtype == np.float32 else 0, 1, (*SHAPE, channels)) * full).astype(dtype)
    codes[:2, :2, :3] = full  # clipped
    if channels == 4:
        codes[..., 3] = np.where(rng.random(SHAPE) < 0.7, full, 0.4 * full)
    table = np.empty(0, np.float32)
    if dtype != np.float32:
        table = (np.arange(full + 1) / full).astype(np.float32) ** 2
    u = np.where(rng.random(SHAPE) < 0.9, 1.0, np.nan).astype(np.float32)
    z = rng.uniform(-0.3, 1, SHAPE).astype(np.float32)
    z_min, over_z = -0.2, rng.uniform(0.5, 2, 9).astype(np.float32)
    factors = np.array([1.5, 0.5, 1.0], np.float32)
    share = rng.uniform(0, 1, (11, 12, 4)).astype(np.float32)
    share[:, :6, 0] *= rng.random((11, 6)) > 0.8
    share[..., 1:] -= 0.5
    top = 3
    at = np.stack([left + rng.uniform(1, 10, SHAPE), top + rng.uniform(-1, 10, SHAPE)], -1)
    at[..., 0] = (at[..., 0] + 0.5) % WIDTH - 0.5
    at = at.astype(np.float32)
    light, weight = np.full((*SHAPE, 3), 0.25, np.float32), np.full(SHAPE, 0.5, np.float32)
    add_frame(
        codes,
        table,
        0.999 * full,
        u,
        z,
        0.0,
        factors,
        over_z,
        z_min,
        at,
        WIDTH,
        share,
        left,
        top,
        0.02,
        1.2,
        light,
        weight,
    )
    added = 0
    for j, i in np.ndindex(SHAPE):
        expected, much = np.full(3, 0.25), 0.0
        value = read(share, left, top, *at[j, i].astype(float))
        in_window = math.floor(at[j, i, 1]) - 1 >= top and math.floor(at[j, i, 1]) + 3 <= top + 11
        counts = np.isfinite(u[j, i]) and z[j, i] >= 0 and (channels == 3 or codes[j, i, 3] >= 0.999 * full)
        if counts and in_window and value[0] >= 1e-3:
            much = value[0] ** 4
            gain = np.interp((z[j, i] - z_min) / (1 - z_min) * 8, np.arange(9), over_z)
            linear = np.maximum(codes[j, i, :3], 0) if not table.size else table[codes[j, i, :3]]
            least = np.clip((linear.min() - 0.85) / 0.13, 0, 1) if table.size else 0.0
            linear = linear.astype(float) * gain * factors
            linear += least**2 * (3 - 2 * least) * np.maximum(1.2 - linear, 0)
            expected = expected + much * ((linear + 0.02) * np.exp(value[1:]) - 0.02)
            added += 1
        np.testing.assert_allclose(weight[j, i], 0.5 + much, rtol=2e-5)
        np.testing.assert_allclose(light[j, i], expected, rtol=1e-4, atol=1e-6)
    assert added > 8
