"""Rays to pixels and back: the tables against OpenCV's fisheye functions, time a point, and error of every lens.

    python tests/benchmarks/points_against_opencv.py [RUNS]

Both have the Kannala-Brandt lens, in one thread, on the same points within 85 degrees of the axis, since OpenCV's
functions are wrong past 90.  Runs take turns; a figure is the median.  The second table holds the errors of the tables
against the exact camera, of every lens at its usual widest: 195 degrees, or as stated.  The largest of random rays and
pixels that the tables have not seen: these are not the errors that they state themselves.
"""

import math
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import (
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    EnhancedUnifiedCamera,
    Equidistant,
    Equisolid,
    FloatArray,
    KannalaBrandt,
    Lens,
    Orthographic,
    Perspective,
    ScaledStereographic,
    Scaramuzza,
    Stereographic,
    Thoby,
    UnifiedCamera,
)
from fullsphere.model.table import RayTable, tabulate

COEFFICIENTS = (-0.031, 0.0043, -0.0005, 0.0001)
FOCAL_PX = 1000.0
CENTRE = (2010.5, 1490.25)

LENSES_AND_FIELDS: list[tuple[Lens, float]] = [  # of any scale; degrees
    (Perspective(1.0), 150),
    (Stereographic(1.0), 195),
    (Equidistant(1.0), 195),
    (Equisolid(1.0), 195),
    (Orthographic(1.0), 180),
    (Thoby(1.0), 195),
    (ScaledStereographic(1.0, 1.9), 195),
    (BaksteinPajdla(1350.0, 2.11, 420.0, 1.13), 195),
    (KannalaBrandt(FOCAL_PX, *COEFFICIENTS), 195),
    (Brown(1.0, -0.29, 0.11, -0.02), 110),
    (Scaramuzza(1400.0, -2e-4, 3e-8, -2e-11), 195),
    (UnifiedCamera(1.0, 0.62), 195),
    (EnhancedUnifiedCamera(1.0, 0.6, 1.1), 195),
    (DoubleSphere(1.0, -0.2, 0.58), 195),
]

Function = Callable[[], Any]


def main(runs: str = "9") -> None:
    cv2.setNumThreads(1)
    lens = KannalaBrandt(FOCAL_PX, *COEFFICIENTS)
    table = tabulate(Camera(lens, (4000, 3000), CENTRE, half_fov=math.radians(97.5)))
    print(f"one thread, medians of {runs} runs in turn; ns a point, and how many times as fast as OpenCV's")
    print(f"{'points':>8}  {'':10}{'OpenCV':>9}{'float64':>9}{'ratio':>8}{'float32':>9}{'ratio':>8}")
    for count in (1_000_000, 10_000):
        for name, functions in _contest(table, count).items():
            theirs, *ours = _nanoseconds(functions, int(runs), count)
            print(f"{count:8}  {name:10}{theirs:9.1f}" + "".join(f"{own:9.2f}{theirs / own:7.1f}x" for own in ours))
    print()
    print("errors in px on 4000 x 4000, of 200 000 random rays (turned) and pixels")
    print(f"{'lens':22}{'field':>6}{'cells':>13}{'project':>10}{'unproject':>11}{'float32':>10}{'and back':>10}")
    for shape, field_deg in LENSES_AND_FIELDS:
        _print_errors(shape, field_deg)


def _contest(table: RayTable, count: int) -> dict[str, list[Function]]:
    """For each direction OpenCV's function, the table's in float64 and in float32, on the same points."""
    matrix = np.array([[FOCAL_PX, 0, CENTRE[0]], [0, FOCAL_PX, CENTRE[1]], [0, 0, 1]])
    distortion, still = np.array(COEFFICIENTS), np.zeros(3)
    rays = _random_rays(math.radians(85), count)
    objects, pixels = rays[:, None].copy(), table.project(rays)
    images = pixels[:, None].copy()
    rays32, pixels32 = rays.astype(np.float32), pixels.astype(np.float32)
    peer = cv2.fisheye.projectPoints(objects, still, still, matrix, distortion)[0][:, 0]
    if not np.abs(peer - pixels).max() < 1e-6:
        raise SystemExit("the two programs do not compute the same pixels")
    return {
        "project": [
            lambda: cv2.fisheye.projectPoints(objects, still, still, matrix, distortion),
            lambda: table.project(rays),
            lambda: table.project(rays32, dtype=np.float32),
        ],
        "unproject": [
            lambda: cv2.fisheye.undistortPoints(images, matrix, distortion),
            lambda: table.unproject(pixels),
            lambda: table.unproject(pixels32, np.float32),
        ],
    }


def _nanoseconds(functions: list[Function], runs: int, count: int) -> list[float]:
    """Median time a point of each function, called in turn; short calls are repeated within a run."""
    repeats = max(1, 1_000_000 // count)
    for function in functions:
        function()  # compiles
    taken: list[list[float]] = [[] for _ in functions]
    for _ in range(runs):
        for function, times in zip(functions, taken, strict=True):
            started = time.perf_counter()
            for _ in range(repeats):
                function()
            times.append((time.perf_counter() - started) / (repeats * count) * 1e9)
    return [statistics.median(times) for times in taken]


def _print_errors(lens: Lens, field_deg: float) -> None:
    half_fov = math.radians(field_deg / 2)
    lens = lens.scaled(2000 / float(lens.radius(half_fov)))
    camera = Camera(lens, (4000, 4000), (1999.5, 1999.5), half_fov=half_fov)
    table = tabulate(camera)
    turn = np.linalg.qr(np.cos(np.arange(1.0, 10.0)).reshape(3, 3))[0]  # any frame
    rays = _random_rays(half_fov, 200_000) @ turn
    pixels = np.random.default_rng(1).uniform(-0.5, 3999.5, (200_000, 2))
    pixels = pixels[np.hypot(*(pixels - camera.centre).T) < 0.999999 * camera.image_radius]
    rays32, pixels32 = rays.astype(np.float32), pixels.astype(np.float32)
    errors = [
        _largest(table.project(rays, turn) - camera.project(rays @ turn.T)),
        _largest(camera.project(table.unproject(pixels)) - pixels),
        _largest(table.project(rays32, turn, np.float32) - camera.project(rays32 @ turn.T)),
        _largest(camera.project(table.unproject(pixels32, np.float32)) - pixels32),
    ]
    cells = f"{table.forward.shape[0]} + {table.inverse_s.shape[0]}"
    print(f"{lens.projection:22}{field_deg:6.0f}{cells:>13}" + "".join(f"{e:10.1e}" for e in errors))


def _random_rays(limit: float, count: int) -> FloatArray:
    rng = np.random.default_rng(0)
    theta, phi = limit * np.sqrt(rng.random(count)), rng.uniform(-math.pi, math.pi, count)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def _largest(difference: NDArray[Any]) -> float:
    return float(np.nanmax(np.linalg.norm(difference, axis=-1)))


if __name__ == "__main__":
    main(*sys.argv[1:])
