"""Compiled loops against their plain NumPy twins."""

import math
from typing import Any

import numpy as np
import pytest

from fullsphere.model import surface_kernels as kernels
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.lens import FloatArray
from laws import rotation

HEIGHTS = {
    kernels.LATITUDE: lambda y, rho: np.arctan2(y, rho),
    kernels.TANGENT: lambda y, rho: y / rho,
    kernels.MERCATOR: lambda y, rho: np.arcsinh(y / rho),
}


def random_rays(count: int, seed: int = 0) -> FloatArray:
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def projected(rays: Any, turn: FloatArray, vertical: int, width: int, dtype: Any) -> Any:
    pixels = np.empty((len(rays), 2), dtype)
    per_radian = width / (2 * math.pi)
    columns = np.array([width / 2 - 0.5, per_radian, -0.5, width - 0.5, width], dtype)
    kernels.project_rows(rays, turn, vertical, columns, np.array([width / 4 - 0.5, per_radian], dtype), pixels)
    return pixels


def rows_twin(rays: FloatArray, turn: FloatArray, vertical: int, width: int) -> FloatArray:
    x, y, z = turn @ rays.T
    per_radian = width / (2 * math.pi)
    u = width / 2 - 0.5 + per_radian * np.arctan2(x, z)
    return np.stack([u, width / 4 - 0.5 + per_radian * HEIGHTS[vertical](y, np.hypot(x, z))], -1)


@pytest.mark.parametrize("vertical", HEIGHTS)
@pytest.mark.parametrize("count", [1, 511, 512, 513, 20000])
def test_project_rows(vertical: int, count: int) -> None:
    """1e-9 px in pictures 32768 px wide."""
    turn, rays = rotation(1), random_rays(count)
    exact = rows_twin(rays, turn, vertical, 32768)
    found = projected(rays, turn, vertical, 32768, np.float64)
    near = np.abs(exact[:, 1]) < 1e5  # further from the horizon a tangent has no pixels to a thousandth of itself
    np.testing.assert_allclose(found[near], exact[near], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("vertical", HEIGHTS)
def test_project_rows_in_single_precision(vertical: int) -> None:
    """1e-3 px in pictures 8192 px wide, whose last bit at the right border is 5e-4 px."""
    turn, rays = rotation(2), random_rays(20000)
    exact = rows_twin(rays, turn, vertical, 8192)
    found = projected(rays, turn, vertical, 8192, np.float32)
    assert found.dtype == np.float32
    near = np.abs(exact[:, 1] - 2047.5) < 2048
    np.testing.assert_allclose(found[near], exact[near], rtol=0, atol=1e-3)
    rounded = rays.astype(np.float32)
    np.testing.assert_allclose(
        projected(rounded, turn, vertical, 8192, np.float64),
        rows_twin(rounded.astype(float), turn, vertical, 8192),
        rtol=1e-12,
        atol=1e-9,
    )


@pytest.mark.parametrize("exponent", range(-16, 0))
def test_angles_close_to_the_axes(exponent: int) -> None:
    """Where the series of the arctangent and of the logarithm change over, and near zero."""
    small = 10.0**exponent
    steps = np.array([small, math.tan(math.pi / 8) * (1 + small), math.tan(math.pi / 8) * (1 - small), 1 - small])
    a = np.concatenate([steps, -steps, 1 / steps, -1 / steps])
    rays = np.concatenate([np.stack(p, -1) for p in ((a, 0 * a + 1, 0 * a - 1), (0 * a + 1, a, a), (a, a, 0 * a - 1))])
    for vertical in HEIGHTS:
        found = projected(rays, np.eye(3), vertical, 2048, np.float64)
        exact = rows_twin(rays, np.eye(3), vertical, 2048)
        exact[:, 0] = np.where(exact[:, 0] >= 2047.5, exact[:, 0] - 2048, exact[:, 0])
        apart = np.abs(found - exact) / np.maximum(1, np.abs(exact) * 1e-3)
        apart[:, 0] = np.minimum(apart[:, 0], 2048 - apart[:, 0])  # the seam
        assert apart.max() < 1e-10


def cube_twin(rays: FloatArray, turn: FloatArray, cube: CubeMap) -> FloatArray:
    """One ray after the other, by the definition of the faces."""
    axes = {  # right and down
        "right": ((0, 0, -1), (0, 1, 0)),
        "left": ((0, 0, 1), (0, 1, 0)),
        "up": ((1, 0, 0), (0, 0, 1)),
        "down": ((1, 0, 0), (0, 0, -1)),
        "front": ((1, 0, 0), (0, 1, 0)),
        "back": ((-1, 0, 0), (0, 1, 0)),
    }
    pixels = []
    for ray in rays @ turn.T:
        axis = int(np.argmax(np.abs(ray)))
        name = (("left", "right"), ("up", "down"), ("back", "front"))[axis][int(ray[axis] > 0)]
        sign = -1 if (cube.layout, name) == ("vertical-cross", "back") else 1
        position = np.array([np.dot(a, ray) for a in axes[name]]) * sign / abs(ray[axis])
        pixels.append(np.array(cube.corners[name]) + (cube.side - 1) / 2 + position * cube.side / 2)
    return np.array(pixels)


@pytest.mark.parametrize("layout", ["strip", "3x2", "cross", "vertical-cross"])
@pytest.mark.parametrize("count", [1, 513, 3000])
def test_project_cube(layout: Any, count: int) -> None:
    cube, turn, rays = CubeMap(5000, layout, 3), rotation(3), random_rays(count, 1)
    exact = cube_twin(rays, turn, cube)
    np.testing.assert_allclose(cube.project(rays, turn), exact, rtol=0, atol=1e-9)
    off = np.linalg.norm(cube.project(rays, turn, np.float32) - exact, axis=-1)
    assert np.quantile(off, 0.99) < 4e-3  # the last bit at 30000 px; a ray on an edge may fall to the other face


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_window_of_rows(dtype: Any) -> None:
    rng = np.random.default_rng(4)
    directions, profile = rng.normal(size=(37, 2)), rng.normal(size=(21, 2))
    rays = np.empty((21, 37, 3), dtype)
    kernels.window_of_rows(directions, profile, rays)
    expected = np.empty((21, 37, 3))
    expected[..., 0] = profile[:, :1] * directions[:, 0]
    expected[..., 1] = profile[:, 1:]
    expected[..., 2] = profile[:, :1] * directions[:, 1]
    np.testing.assert_array_equal(rays, expected.astype(dtype))
