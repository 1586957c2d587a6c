"""Rays to pixels of the surfaces that are no lens: time a ray beside the same formulas in NumPy, and the errors.

    python tests/benchmarks/surfaces_against_numpy.py [RUNS]

One thread, rays all round in lots of 128 x 128, as tiles are that stay in the cache, turned by a rotation.  Runs take
turns; a figure is the median.  Errors are the largest against NumPy's float64 formulas, of rays that the picture shows.
"""

import math
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fullsphere.model.camera import FastProjection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator, Mosaic360, SeparableSurface

SIDE, REPEATS = 128, 16
SURFACES: dict[str, FastProjection] = {
    "equirectangular 8192": Equirectangular((8192, 4096)),
    "equirectangular 32768": Equirectangular((32768, 16384)),
    "cylindrical 8192": Cylindrical((8192, 4096)),
    "mercator 8192": Mercator((8192, 8192)),
    "360x360 8192": Mosaic360((8192, 8192)),
    "cube 2048": CubeMap(2048),
}
HEIGHTS: dict[type[SeparableSurface], Callable[[FloatArray, FloatArray], FloatArray]] = {
    Equirectangular: np.arctan2,
    Cylindrical: np.divide,
    Mercator: lambda y, rho: np.arcsinh(y / rho),
    Mosaic360: np.arctan2,
}


def main(runs: str = "9") -> None:
    rng = np.random.default_rng(0)
    many = rng.normal(size=(500_000, 3))
    many /= np.linalg.norm(many, axis=-1, keepdims=True)
    rays = many[: SIDE**2].copy()
    rays32 = rays.astype(np.float32)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tile = slice(700, 700 + SIDE), slice(300, 300 + SIDE)
    print(f"one thread, medians of {runs} runs in turn; ns a ray; errors in px")
    print(f"{'':22}{'project':>34}{'window_rays':>18}{'largest error':>20}")
    print(f"{'':22}{'NumPy':>10}{'float64':>9}{'ratio':>6}{'float32':>9}{'float64':>9}{'float32':>9}", end="")
    print(f"{'float64':>10}{'float32':>10}")
    for name, surface in SURFACES.items():
        functions: list[Callable[[], Any]] = [
            lambda s=surface: numpy_pixels(s, rays, turn),  # type: ignore[misc]
            lambda s=surface: s.project(rays, turn),  # type: ignore[misc]
            lambda s=surface: s.project(rays32, turn, np.float32),  # type: ignore[misc]
            lambda s=surface: s.window_rays(*tile),  # type: ignore[misc]
            lambda s=surface: s.window_rays(*tile, np.float32),  # type: ignore[misc]
        ]
        plain, double, single, window, window32 = nanoseconds(functions, int(runs))
        errors = [largest_error(surface, many, turn, dtype) for dtype in (np.float64, np.float32)]
        print(
            f"{name:22}{plain:10.1f}{double:9.2f}{plain / double:5.0f}x{single:9.2f}{window:9.2f}{window32:9.2f}",
            end="",
        )
        print("".join(f"{error:10.1e}" for error in errors))


def numpy_pixels(surface: FastProjection, rays: FloatArray, turn: FloatArray) -> FloatArray:
    """The formulas of docs/projections.md, written plainly."""
    turned = rays @ turn.T
    if isinstance(surface, CubeMap):
        return numpy_cube(surface, turned)
    assert isinstance(surface, SeparableSurface)
    x, y, z = turned.T
    (left, right), (bottom, top), (width, height) = surface.longitudes, surface.heights, surface.size
    lon = (np.arctan2(x, z) - left) % (2 * math.pi)
    high = -HEIGHTS[type(surface)](y, np.hypot(x, z))
    return np.stack([lon / (right - left) * width - 0.5, (top - high) / (top - bottom) * height - 0.5], -1)


def numpy_cube(cube: CubeMap, rays: FloatArray) -> FloatArray:
    x, y, z = rays.T
    longest = np.argmax(np.abs(rays), -1)
    depth = np.take_along_axis(rays, longest[:, None], -1)[:, 0]
    sign = np.sign(depth)
    across = np.choose(longest, [-z * sign, x, x * sign]) / np.abs(depth)
    down = np.choose(longest, [y, -z * sign, y]) / np.abs(depth)
    names = [["left", "up", "back"], ["right", "down", "front"]]
    corners = np.array([[cube.corners[name] for name in row] for row in names])[(depth > 0).astype(int), longest]
    return np.asarray(np.stack([across, down], -1) * (cube.side / 2) + corners + (cube.side - 1) / 2)


def largest_error(surface: FastProjection, rays: FloatArray, turn: FloatArray, dtype: type) -> float:
    exact = numpy_pixels(surface, rays, turn)
    off = np.abs(surface.project(rays, turn, dtype) - exact)
    width, height = surface.size
    off[:, 0] = np.minimum(off[:, 0], width - off[:, 0])  # the seam
    return float(off[(exact[:, 1] >= -0.5) & (exact[:, 1] <= height - 0.5)].max())


def nanoseconds(functions: list[Callable[[], Any]], runs: int) -> list[float]:
    for function in functions:
        function()  # compiles
    taken: list[list[float]] = [[] for _ in functions]
    for _ in range(runs):
        for function, times in zip(functions, taken, strict=True):
            started = time.perf_counter()
            for _ in range(REPEATS):
                function()
            times.append((time.perf_counter() - started) / (REPEATS * SIDE**2) * 1e9)
    return [statistics.median(times) for times in taken]


if __name__ == "__main__":
    main(*sys.argv[1:])
