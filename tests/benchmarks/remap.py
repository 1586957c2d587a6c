"""Time and accuracy of remapping beside other programs, in one table.

    python tests/benchmarks/remap.py [--slow] [--runs N] [--only PART ...] [--scene PANORAMA] [--scale S]

The peers are ffmpeg (v360), nona (of Hugin), py360convert, bare `cv2.remap`, and a program of numpy and scipy alone;
those that are not installed are named as missing.  docs/performance.md says what is measured and how.
"""

import argparse
import os
import tempfile
from pathlib import Path

import cv2
from remap_accuracy import accuracy_rows
from remap_peers import Job, Programs, ViewJob
from remap_pictures import scene_of
from remap_speed import SPEED_PARTS, gigapixel_rows, speed_rows
from remap_table import Row, note, print_table

from fullsphere.model.workers import thread_pool

PARTS = (*SPEED_PARTS, "accuracy", "gigapixel")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time and accuracy of remapping beside other programs.")
    parser.add_argument("--slow", action="store_true", help="measure the gigapixel too; takes minutes and 5 GB of disk")
    parser.add_argument("--runs", type=int, default=7, help="runs of each job, turn about (default: %(default)s)")
    parser.add_argument("--only", nargs="+", metavar="PART", choices=PARTS, help=f"of {', '.join(PARTS)}")
    parser.add_argument("--scene", type=Path, metavar="PANORAMA", help="equirectangular picture to photograph")
    parser.add_argument(
        "--scale", type=float, default=1.0, help="of all sides, for a quick look (default: %(default)s)"
    )
    args = parser.parse_args()
    print_table(_rows(args))


def _rows(args: argparse.Namespace) -> list[Row]:
    def sides(*pixels: int) -> list[int]:
        return [2 * max(1, round(p * args.scale / 2)) for p in pixels]

    parts = args.only or PARTS[: None if args.slow else -1]
    programs = Programs.found()
    rows: list[Row] = []
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    cv2.setNumThreads(cores)
    note(f"{cores} cores, load {os.getloadavg()[0]:.1f}; OpenCV {cv2.__version__}; {programs}")
    with thread_pool(cores) as executor, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = scene_of(args.scene, executor)
        if set(SPEED_PARTS).intersection(parts):
            rows += speed_rows(parts, scene, Job(*sides(3000, 8192)), programs, args.runs, executor, folder)
        if "accuracy" in parts:
            job, view = Job(*sides(1500, 4096)), ViewJob(*sides(4096, 1800))
            rows += accuracy_rows(scene, job, view, programs, executor, folder)
        if "gigapixel" in parts:
            rows += gigapixel_rows(scene, executor, folder)
    return rows


if __name__ == "__main__":
    main()
