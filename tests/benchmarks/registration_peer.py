"""How long registration takes beside Hugin's command-line programs, from the same files."""

import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from registration_process import register_command, run
from registration_sets import FrameSet
from remap_table import Row, absent_row, alternating, note, seconds_row

from fullsphere.mosaic.frames import open_frames
from fullsphere.mosaic.rim import common_circle

PROGRAMS = ("pto_gen", "cpfind", "cpclean", "pto_var", "autooptimiser")
_CIRCULAR, _EQUISOLID = "3", "21"  # Hugin's numbers of projections
_LIMIT = 0.5


def time_rows(sets: Sequence[FrameSet], runs: int, folder: Path) -> list[Row]:
    """Seconds from the frames to a solved project, without a calibration, by both."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return [absent_row("time, frames to orientations", f"hugin-tools ({', '.join(missing)})")]
    return [_row(files, runs, folder) for files in sets]


def _row(files: FrameSet, runs: int, folder: Path) -> Row:
    commands = hugin_commands(files, folder)
    ours = register_command([f.resolve() for f in files.files], folder / "mosaic.json")

    def peer() -> float:
        return sum(run(command, folder).seconds for command in commands)

    jobs: dict[str, Callable[[], float | None]] = {
        "fullsphere register": lambda: run(ours, folder).seconds,
        "hugin": peer,
    }
    seconds = alternating(runs, jobs)
    name = f"time, {files.name}, {files.scene}: frames to orientations, no calibration / Hugin"
    return seconds_row(name, seconds["fullsphere register"], seconds["hugin"], _LIMIT)


def hugin_commands(files: FrameSet, folder: Path) -> list[list[str]]:
    """Hugin's way from frames to orientations and lens, on two threads as its manual recommends for fisheye frames."""
    circle = common_circle(open_frames(files.files))
    half_deg = files.truth.half_fov_deg if files.truth else 90.0
    kind, crop = _EQUISOLID, []
    width, height = open_frames(files.files[:2])[0].size
    if circle is not None:
        kind = _CIRCULAR
        (u, v), r = circle.centre, circle.radius
        crop = ["-c", ",".join(str(round(p)) for p in (u - r, u + r, v - r, v + r))]
        fov = 2 * half_deg
    else:
        fov = math.degrees(4 * math.asin(math.sin(math.radians(half_deg / 2)) * width / math.hypot(width, height)))
    note(f"hugin: {files.name}, lens {kind}, field of view {fov:.1f} degrees {' '.join(crop)}")
    pictures = [str(f.resolve()) for f in files.files]
    return [
        ["pto_gen", "-p", kind, "-f", f"{fov:.1f}", *crop, "-o", "h0.pto", *pictures],
        ["cpfind", "--multirow", "-n", "2", "-o", "h1.pto", "h0.pto"],
        ["cpclean", "-o", "h2.pto", "h1.pto"],
        ["pto_var", "--opt", "y,p,r,v,a,b,c,d,e", "-o", "h3.pto", "h2.pto"],
        ["autooptimiser", "-a", "-l", "-s", "-o", "h4.pto", "h3.pto"],
    ]
