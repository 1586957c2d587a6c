"""Time of `fullsphere calibrate` on one board's corners, as a share of mrcal's with its splined lens.

    python tests/benchmarks/calibration_against_mrcal.py CORNERS.csv WIDTHxHEIGHT SPACING [RUNS]

The table has the columns image, X, Y, u, v (or image, x_mm, y_mm, u_px, v_px) of a flat grid with that spacing.  Both
programs run as whole processes on the same corners, turn about; medians and their ratio are printed.  mrcal is the
Debian package of that name; it is started from a focal length that suits a lens of about 180 degrees, which it needs.
"""

import csv
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

LENS = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=10_fov_x_deg=190"


def main(table: str, size: str, spacing: str, runs: str = "5") -> None:
    width, height = map(int, size.split("x"))
    with Path(table).open(newline="") as file:
        rows = [_row(row) for row in csv.DictReader(file)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_points(folder / "points.csv", rows)
        columns, lines = _write_vnl(folder / "corners.vnl", rows, float(spacing))
        ours = ["fullsphere", "calibrate", "--points", "points.csv", "--image-size", size, "-o", "camera.json"]
        theirs = ["mrcal-calibrate-cameras", "--corners-cache", "corners.vnl", "--lensmodel", LENS]
        theirs += ["--focal", str(width / 4), "--object-spacing", spacing, "--imagersize", str(width), str(height)]
        theirs += ["--object-width-n", str(columns), "--object-height-n", str(lines), "--outdir", ".", "*.png"]
        seconds: dict[str, list[float]] = {"fullsphere": [], "mrcal": []}
        for _ in range(int(runs)):
            seconds["fullsphere"].append(_timed([*ours, "--overwrite"], folder))
            seconds["mrcal"].append(_timed(theirs, folder))
        median = {program: statistics.median(values) for program, values in seconds.items()}
        print(f"{len(rows)} corners, {runs} runs, whole processes, medians:")
        for program, value in median.items():
            print(f"  {program:12}{value:7.2f} s   (from {min(seconds[program]):.2f} to {max(seconds[program]):.2f})")
        print(f"  ratio       {median['fullsphere'] / median['mrcal']:7.3f}")


def _row(row: dict[str, str]) -> tuple[str, float, float, float, float]:
    names = ("x_mm", "y_mm", "u_px", "v_px") if "x_mm" in row else ("X", "Y", "u", "v")
    x, y, u, v = (float(row[name]) for name in names)
    return Path(row["image"]).stem + ".png", x, y, u, v


def _write_points(path: Path, rows: list[tuple[str, float, float, float, float]]) -> None:
    lines = [f"{image},{x},{y},0,{u},{v}" for image, x, y, u, v in rows]
    path.write_text("\n".join(["image,x_mm,y_mm,z_mm,u_px,v_px", *lines]) + "\n")


def _write_vnl(path: Path, rows: list[tuple[str, float, float, float, float]], spacing: float) -> tuple[int, int]:
    """Corners as mrcal reads them: every corner of every picture, row by row, "- -" where it was not seen."""
    left, top = min(row[1] for row in rows), min(row[2] for row in rows)
    seen = {(image, round((x - left) / spacing), round((y - top) / spacing)): (u, v) for image, x, y, u, v in rows}
    columns, lines = 1 + max(key[1] for key in seen), 1 + max(key[2] for key in seen)
    text = ["# filename x y level"]
    for image in dict.fromkeys(row[0] for row in rows):
        for j in range(lines):
            for i in range(columns):
                u, v = seen.get((image, i, j), (None, None))
                text.append(f"{image} - - -" if u is None else f"{image} {u} {v} 0")
    path.write_text("\n".join(text) + "\n")
    return columns, lines


def _timed(command: list[str], folder: Path) -> float:
    started = time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{command[0]}: {done.stderr.strip()[-800:]}")
    return time.perf_counter() - started


if __name__ == "__main__":
    main(*sys.argv[1:])
