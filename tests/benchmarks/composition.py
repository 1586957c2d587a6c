"""How like their scene finished panoramas are, how fast they come, and what they cost, in one table.

    python tests/benchmarks/composition.py [FOLDER ...] [--scenes FOLDER] [--only PART ...] [--keep FOLDER]

A FOLDER holds rendered frames, and beside them camera.json and truth.json (frames, gains, vignetting, the lens as a
curve, the scene).  What is stitched from them stays in the folder --keep, and is used again.  `steps` needs no folder.
docs/composition.md says what is measured and how.
"""

import argparse
import os
import tempfile
from pathlib import Path

from composition_growth import WIDTHS, growth_rows, same_rows
from composition_peer import time_rows
from composition_scene import RenderedTruth
from composition_scores import light_rows, likeness_rows, stitched
from composition_steps import step_rows
from remap_table import Row, note, print_table

from fullsphere.model.workers import thread_pool

PARTS = ("growth", "same", "time", "true", "self", "light", "steps")


def main() -> None:
    parser = argparse.ArgumentParser(description="How like their scene panoramas are, how fast, and what they cost.")
    parser.add_argument(
        "folders", nargs="*", type=Path, metavar="FOLDER", help="frames with truth.json and camera.json"
    )
    parser.add_argument("--scenes", type=Path, metavar="FOLDER", help="where the scenes lie that truth.json names")
    parser.add_argument("--only", nargs="+", metavar="PART", choices=PARTS, help=f"of {', '.join(PARTS)}")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where stitched files are, and stay")
    parser.add_argument("--runs", type=int, default=3, help="runs of each timed job, turn about (default: %(default)s)")
    parser.add_argument("--time-widths", nargs="+", type=int, default=[4096, 8192], metavar="WIDTH")
    parser.add_argument("--growth-widths", nargs="+", type=int, default=list(WIDTHS), metavar="WIDTH")
    args = parser.parse_args()
    parts = args.only or PARTS
    note(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as name:
        folder = args.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        truths = [RenderedTruth.read(f, args.scenes) for f in args.folders]
        rows: list[Row] = []
        for truth in truths:  # first: the peak of a process includes what its parent held
            mosaic = stitched(truth, "true", folder)[1]
            if "growth" in parts and truth is truths[0]:
                rows += growth_rows(truth.folder.name, mosaic, args.growth_widths, folder)
            if "time" in parts:
                rows += time_rows(truth.folder.name, mosaic, args.time_widths, args.runs, folder)
        for truth in truths:
            if "same" in parts:
                rows += same_rows(truth.folder.name, stitched(truth, "true", folder)[1], WIDTHS[0], folder)
        rows += likeness_rows(truths, [lens for lens in ("true", "self") if lens in parts], folder)
        if "light" in parts:
            rows += light_rows(truths, folder)
        if "steps" in parts:
            with thread_pool(os.cpu_count() or 1) as executor:
                rows += step_rows(executor)
    print_table(rows)


if __name__ == "__main__":
    main()
