"""Rows of registered sets, one table: a line each, with what it is judged by."""

from collections.abc import Sequence
from typing import NamedTuple

from registration_scores import HeldOut, Score
from registration_sets import FrameSet

from fullsphere.mosaic.project import Mosaic

HEADER = (
    "set",
    "scene",
    "lens",
    "frames",
    "rotation median / max deg",
    "sigma factor",
    "curve px",
    "tilt deg",
    "level",
    "held out",
    "seconds",
    "holds",
)


class SetRow(NamedTuple):
    """One registration as text; `holds` is "yes", or names what does not hold, or is empty where nothing is judged."""

    name: str
    scene: str
    lens: str
    frames: str
    rotation: str = ""
    sigma: str = ""
    curve: str = ""
    tilt: str = ""
    level: str = ""
    held_out: str = ""
    seconds: str = ""
    holds: str = ""
    said: tuple[str, ...] = ()


def scored_row(files: FrameSet, lens: str, mosaic: Mosaic, score: Score, seconds: float) -> SetRow:
    """Against the truth.  Two frames without a calibration hardly show their lens: only that they register is asked."""
    known = lens == "true"
    weak = not known and len(files.files) == 2
    missed = [
        name
        for name, holds in {
            "frames": len(mosaic.registered) == len(files.files),
            "median": weak or score.median <= (0.002 if known else 0.05),
            "max": not known or score.worst <= 0.02,
            "curve": known or weak or score.curve_rms_px <= 0.3,
            "tilt": weak or score.tilt <= 3,
        }.items()
        if not holds
    ]
    return SetRow(
        files.name,
        files.scene,
        lens,
        f"{len(mosaic.registered)} of {len(files.files)}",
        f"{score.median:.5f} / {score.worst:.5f}",
        f"{score.sigma_factor:.2f}",
        f"{score.curve_rms_px:.3f}",
        f"{score.tilt:.2f}",
        mosaic.level,
        str(HeldOut.of(mosaic)),
        f"{seconds:.1f}",
        f"NO: {', '.join(missed)}" if missed else "yes",
        diagnosis_of(mosaic),
    )


def photographs_row(files: FrameSet, lens: str, mosaic: Mosaic, seconds: float) -> SetRow:
    """By the matches that no fit has seen."""
    held = HeldOut.of(mosaic)
    missed = []
    if files.places:
        elsewhere = sum("taken from another place" in frame.reason for frame in mosaic.frames)
        if (len(mosaic.registered), elsewhere) != (files.places[0], sum(files.places[1:])):
            missed.append(f"places {' + '.join(map(str, files.places))}")
    elif len(mosaic.registered) < len(files.files):
        missed.append("frames")
    if files.limit_px is not None and not (held.median_px <= files.limit_px and held.inside >= 400):
        missed.append(f"held out, <= {files.limit_px:g} px over >= 400")
    return SetRow(
        files.name,
        files.scene,
        lens,
        f"{len(mosaic.registered)} of {len(files.files)}",
        level=mosaic.level,
        held_out=str(held),
        seconds=f"{seconds:.1f}",
        holds=f"NO: {', '.join(missed)}" if missed else "yes",
        said=diagnosis_of(mosaic),
    )


def failed_row(files: FrameSet, lens: str, error: Exception) -> SetRow:
    """A registration that ended in an error."""
    return SetRow(
        files.name,
        files.scene,
        lens,
        f"0 of {len(files.files)}",
        holds=f"NO: {type(error).__name__}",
        said=(str(error),),
    )


def diagnosis_of(mosaic: Mosaic) -> tuple[str, ...]:
    """What the program says of the set, and which frames it left out."""
    left_out = [f"{frame.id} is left out: {frame.reason}" for frame in mosaic.frames if not frame.registered]
    return (*mosaic.diagnosis, *left_out)


def print_sets(rows: Sequence[SetRow]) -> None:
    """Columns as wide as they need be; below, what the program said of each set."""
    if not rows:
        return
    lines = [HEADER, *(tuple(str(cell) for cell in row[: len(HEADER)]) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEADER))]
    for number, line in enumerate(lines):
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
        if number == 0:
            print("  ".join("-" * width for width in widths))
    print()
    for row in rows:
        for sentence in row.said:
            print(f"{row.name}, {row.scene}, {row.lens} lens: {sentence}")
    print()
