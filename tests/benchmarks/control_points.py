"""How far apart the rays of a Hugin project's control points are: under its own solution, and adjusted here.

    python tests/benchmarks/control_points.py PROJECT.pto ...

Both are computed by the same code from the same points; `stored` uses the project's orientations and libpano's own
formula of its lenses, so that no fit is in between.  Angles between the two rays of a point, in degrees.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.control_points import distances, register_points
from fullsphere.mosaic.pto import read_pto


def main() -> None:
    parser = argparse.ArgumentParser(description="Control points of Hugin projects, as stored and adjusted here.")
    parser.add_argument("projects", nargs="+", type=Path, metavar="PROJECT.pto")
    print(f"{'':34}{'points':>8}{'mean':>9}{'median':>9}{'largest':>9}{'seconds':>9}")
    for path in parser.parse_args().projects:
        project = read_pto(path)
        show(f"{path.stem}, stored", distances(project, project.rotations))
        for refine in (False, True):
            start = time.perf_counter()
            mosaic = register_points(project, refine)
            seconds = time.perf_counter() - start
            found = np.array([f.prior if f.camera_from_world is None else f.camera_from_world for f in mosaic.frames])
            name = "lenses adjusted too" if refine else "orientations only"
            show(f"    {name}", distances(project, found, mosaic.cameras), seconds)


def show(name: str, angles: FloatArray, seconds: float | None = None) -> None:
    """One line of the table."""
    degrees = np.rad2deg(angles)
    figures = "".join(f"{f(degrees):9.4f}" for f in (np.nanmean, np.nanmedian, np.nanmax))
    print(f"{name:34}{np.isfinite(degrees).sum():8}{figures}" + ("" if seconds is None else f"{seconds:9.1f}"))


if __name__ == "__main__":
    main()
