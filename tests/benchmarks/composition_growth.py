"""What a panorama costs as it becomes large, and whether its bytes depend on how it was made."""

import hashlib
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from registration_process import Spent, fullsphere, run
from remap_table import Row, limit_row, note

from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.compose import compose, plan
from fullsphere.mosaic.store import load_mosaic

WIDTHS = (4096, 8192, 16384, 32768)
_PEAK_BYTES, _GROWTH, _SLOWER = 2 << 30, 1.2, 1.3


def growth_rows(name: str, mosaic: Path, widths: list[int], folder: Path) -> list[Row]:
    """Whole processes that write a TIFF file.

    The peak of a child includes what its parent held when it began, so this has to run before anything large.
    """
    spent = {width: _composed(mosaic, width, folder) for width in widths}
    rows = [
        Row(f"memory, {name}, {width} x {width // 2}: peak", f"{one.peak_bytes / 2**20:.0f} MiB")
        for width, one in spent.items()
    ]
    most, half, quarter = WIDTHS[3], WIDTHS[2], WIDTHS[1]
    if most in spent:
        peak = spent[most].peak_bytes / 2**20
        rows.append(limit_row(f"memory, {name}, {most} wide: peak", peak, _PEAK_BYTES / 2**20, "MiB"))
    if most in spent and half in spent:
        growth = spent[most].peak_bytes / spent[half].peak_bytes
        rows.append(limit_row(f"memory, {name}: {most} wide / {half} wide", growth, _GROWTH, "times"))
    if most in spent and quarter in spent:
        slower = (spent[most].seconds / most**2) / (spent[quarter].seconds / quarter**2)
        rows.append(limit_row(f"time for a pixel, {name}: {most} wide / {quarter} wide", slower, _SLOWER, "times"))
    return rows


def _composed(mosaic: Path, width: int, folder: Path) -> Spent:
    picture = folder / "large.tif"
    sized = ["--size", str(width), "--threads", "2", "--overwrite"]
    spent = run(fullsphere("compose", str(mosaic), "-o", str(picture), *sized), folder)
    nanoseconds = 1e9 * spent.seconds / (width * width / 2)
    note(
        f"{width} wide: {spent.seconds:.1f} s, {nanoseconds:.0f} ns a pixel, {spent.peak_bytes / 2**20:.0f} MiB,"
        f" file {picture.stat().st_size / 2**20:.0f} MiB"
    )
    picture.unlink()
    return spent


def same_rows(name: str, mosaic: Path, width: int, folder: Path) -> list[Row]:
    """Whether one and two threads, and tiles of 512 and 2048 pixels, give the same bytes."""
    files = set()
    for threads in ("1", "2"):
        picture = folder / "same.tif"
        sized = ["--size", str(width), "--threads", threads, "--overwrite"]
        run(fullsphere("compose", str(mosaic), "-o", str(picture), *sized), folder)
        files.add(hashlib.sha256(picture.read_bytes()).hexdigest())
        picture.unlink()
    with thread_pool(2) as pool:
        pixels = {_pixels(mosaic, width, tile, pool) for tile in (512, 2048)}
    return [
        _same_row(f"bytes of the file, {name}, {width} wide, 1 and 2 threads", len(files)),
        _same_row(f"bytes of the pixels, {name}, {width} wide, tiles of 512 and 2048", len(pixels)),
    ]


def _pixels(mosaic: Path, width: int, tile_px: int, executor: Executor) -> str:
    held, digest = load_mosaic(mosaic), hashlib.sha256()
    surface = Equirectangular((width, width // 2))
    for band in compose(held, surface, np.uint16, executor, plan(held, executor), tile_px=tile_px):
        digest.update(band.rows.tobytes())
    return digest.hexdigest()


def _same_row(measure: str, different: int) -> Row:
    same = different == 1
    return Row(measure, "same" if same else f"{different} different", limit="same", holds="yes" if same else "NO")
