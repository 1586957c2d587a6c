"""How long composition takes beside Hugin's `nona` with `enblend` or `verdandi`, from the same project."""

import shutil
from collections.abc import Callable
from pathlib import Path

from registration_process import fullsphere, run
from remap_table import Row, absent_row, alternating, seconds_row

from fullsphere.mosaic.pto_write import write_pto
from fullsphere.mosaic.store import load_mosaic

PROGRAMS = ("pano_modify", "nona", "enblend", "verdandi")
_LIMITS = {"enblend": 1 / 5, "verdandi": 1 / 1.5}
_EQUIRECTANGULAR = "2"  # Hugin's number of it


def time_rows(name: str, mosaic: Path, widths: list[int], runs: int, folder: Path) -> list[Row]:
    """Seconds from a solved project to a whole sphere in a TIFF file, whole processes, all turn about."""
    missing = [program for program in PROGRAMS if shutil.which(program) is None]
    if missing:
        return [absent_row("time of composition", f"hugin-tools and enblend ({', '.join(missing)})")]
    place = folder / f"hugin_{name}"
    place.mkdir(exist_ok=True)
    write_pto(place / "solved.pto", load_mosaic(mosaic), overwrite=True)
    rows = []
    for width in widths:
        seconds = alternating(runs, jobs(mosaic, width, place))
        for blender, limit in _LIMITS.items():
            peer = seconds["nona"] + seconds[blender]
            measure = f"time, {name}, {width} x {width // 2}: mosaic to file / nona + {blender}"
            rows.append(seconds_row(measure, seconds["fullsphere compose"], peer, round(limit, 3)))
    return rows


def jobs(mosaic: Path, width: int, place: Path) -> dict[str, Callable[[], float]]:
    """What is timed, each answering its seconds; the blenders take what `nona` has left before them."""
    height = width // 2
    sized = [f"--canvas={width}x{height}", f"--crop=0,{width},0,{height}", "--fov=360x180", "--ldr-file=TIF"]
    run(["pano_modify", f"--projection={_EQUIRECTANGULAR}", *sized, "-o", "sized.pto", "solved.pto"], place)

    def seconds_of(*command: str) -> float:
        return run(command, place).seconds

    def remapped() -> list[str]:
        return sorted(file.name for file in place.glob("remapped*.tif"))

    ours = fullsphere("compose", str(mosaic), "-o", "ours.tif", "--size", str(width), "--threads", "2", "--overwrite")
    return {
        "fullsphere compose": lambda: seconds_of(*ours),
        "nona": lambda: seconds_of("nona", "-m", "TIFF_m", "-o", "remapped", "sized.pto"),
        "enblend": lambda: seconds_of(
            "enblend", "--wrap=horizontal", "-f", f"{width}x{height}", "-o", "enblend.tif", *remapped()
        ),
        "verdandi": lambda: seconds_of("verdandi", "-w", "-o", "verdandi.tif", *remapped()),
    }
