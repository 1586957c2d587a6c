"""How exactly, how honestly and how fast frames are registered, in two tables.

    python tests/benchmarks/registration.py [FOLDER ...] [--only PART ...] [--borrow FOLDER FOLDER] [--seeds N]

A FOLDER holds frames.  Where a truth.json lies beside them the orientations found are compared with it, with the lens
of a camera.json beside it (part `true`) and without (part `self`); other folders are photographs, judged by matches
that no fit has seen (part `photographs`).  FOLDER[0:4] takes the first four files only, FOLDER=0.75 says what their
median residual may be, FOLDER=4+4 that four were taken from one place and four from another.  Without a folder the sets
are rendered from a built-in room.  docs/registration.md says what is measured and how.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from registration_growth import growth_rows
from registration_peer import time_rows
from registration_pictures import rendered_sets
from registration_scores import HeldOut, Score
from registration_sets import FrameSet
from registration_sigma import sigma_rows
from registration_table import SetRow, failed_row, photographs_row, print_sets, scored_row
from remap_table import Row, note, print_table

from fullsphere.model.camera import Camera
from fullsphere.model.errors import FullsphereError
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.frames import open_frames
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.register import register

PARTS = ("true", "self", "photographs", "borrow", "sigma", "time", "growth")


def main() -> None:
    parser = argparse.ArgumentParser(description="How exactly, how honestly and how fast frames are registered.")
    parser.add_argument("folders", nargs="*", metavar="FOLDER", help="frames; FOLDER[0:4] some, FOLDER=0.75 a limit")
    parser.add_argument("--only", nargs="+", metavar="PART", choices=PARTS, help=f"of {', '.join(PARTS)}")
    parser.add_argument(
        "--borrow", nargs=2, metavar="FOLDER", help="the lens found from the first set is used for the second"
    )
    parser.add_argument("--runs", type=int, default=3, help="runs of each timed job, turn about (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=30, help="for stated sigmas (default: %(default)s)")
    args = parser.parse_args()
    parts = args.only or PARTS
    note(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with thread_pool(os.cpu_count() or 1) as executor, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sets = [FrameSet.parse(f) for f in args.folders] or rendered_sets(folder, executor)
        print_sets(set_rows(sets, parts, executor))
        rows: list[Row] = []
        if "borrow" in parts and args.borrow:
            lender, borrower = map(FrameSet.parse, args.borrow)
            rows.append(borrow_row(lender, borrower, executor))
        if "sigma" in parts:
            rows += sigma_rows(args.seeds)
        if "time" in parts:
            rows += time_rows(sets, args.runs, folder)
        if "growth" in parts:
            rows += growth_rows(folder, executor)
    if rows:
        print_table(rows)


def set_rows(sets: Sequence[FrameSet], parts: Sequence[str], executor: Executor) -> list[SetRow]:
    """Each set with its true lens and without, photographs without."""
    rows = []
    for files in sets:
        if files.truth is None:
            lenses: dict[str, Camera | None] = {"self": None} if "photographs" in parts else {}
        else:
            lenses = {"true": files.truth.camera, "self": None}
        for lens, camera in lenses.items():
            if files.truth is not None and (lens not in parts or (lens == "true" and camera is None)):
                continue
            note(f"registering {files.name}, {files.scene}, {lens} lens")
            rows.append(_row(files, lens, camera, executor))
    return rows


def _row(files: FrameSet, lens: str, camera: Camera | None, executor: Executor) -> SetRow:
    try:
        mosaic, seconds = registered(files, camera, executor)
    except FullsphereError as error:
        return failed_row(files, lens, error)
    if files.truth is None:
        return photographs_row(files, lens, mosaic, seconds)
    return scored_row(files, lens, mosaic, Score.of(mosaic, files, files.truth), seconds)


def registered(files: FrameSet, camera: Camera | None, executor: Executor) -> tuple[Mosaic, float]:
    """The mosaic, and the seconds from the files to it."""
    started = time.perf_counter()
    mosaic = register(open_frames(files.files, None, executor), camera, executor)
    return mosaic, time.perf_counter() - started


def borrow_row(lender: FrameSet, borrower: FrameSet, executor: Executor) -> Row:
    """The residual of a set under the lens that another of the same camera gave, against that under its own."""
    camera = registered(lender, None, executor)[0].camera
    lent, own = (HeldOut.of(registered(borrower, c, executor)[0]) for c in (camera, None))
    more = lent.median_px - own.median_px
    return Row(
        f"{borrower.name} with the lens found from {lender.name}, held-out matches",
        str(lent),
        str(own),
        f"{more:+.3f} px",
        "<= 0.1",
        "yes" if more <= 0.1 else "NO",
    )


if __name__ == "__main__":
    main()
