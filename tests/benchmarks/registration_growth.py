"""What registration costs as frames become many: time per frame, and memory."""

import tempfile
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from registration_pictures import circular, render, room
from registration_process import register_command, run
from remap_table import Row, note

_MOST = 360
_SIDE_PX = 700
_LIMIT = 1.3


def growth_rows(folder: Path, executor: Executor) -> list[Row]:
    """One turn in 40, 120 and 360 steps, and one, three and nine turns of 40 steps: the same pictures, reordered."""
    note(f"growth: rendering {_MOST} frames")
    index = np.arange(_MOST)
    angles = np.stack([360 * index / _MOST, 8 * np.sin(index / 36), 3 * np.cos(index / 45)], -1)
    files = render(folder / "sweep", room(executor), angles, circular(_SIDE_PX), executor)
    winding = [files[(9 * i + i // 40) % _MOST] for i in range(_MOST)]
    orders = {
        "one turn in ever finer steps": {n: files[:: _MOST // n] for n in (40, 120, 360)},
        "ever more turns of 40 frames": {n: winding[:n] for n in (40, 120, 360)},
    }
    return [row for name, sweeps in orders.items() for row in _rows(name, sweeps, folder)]


def _rows(name: str, sweeps: dict[int, list[Path]], folder: Path) -> list[Row]:
    per_frame, peak = {}, {}
    for count, files in sweeps.items():
        with tempfile.TemporaryDirectory(dir=folder) as place:
            spent = run(
                register_command(files, Path(place) / "mosaic.json", "--camera", str(folder / "sweep" / "camera.json")),
                Path(place),
            )
        per_frame[count], peak[count] = spent.seconds / count, spent.peak_bytes
        note(f"growth, {name}: {count} frames {spent.seconds:.1f} s, {spent.peak_bytes / 2**20:.0f} MiB")
    growth = per_frame[360] / per_frame[40]
    return [
        Row(
            f"{name}: time per frame, 360 frames / 40 frames",
            f"{1000 * per_frame[360]:.0f} ms",
            f"{1000 * per_frame[40]:.0f} ms",
            f"{growth:.2f}",
            f"<= {_LIMIT}",
            "yes" if growth <= _LIMIT else "NO",
        ),
        Row(
            f"{name}: memory, 360 frames / 40 frames",
            f"{peak[360] / 2**20:.0f} MiB",
            f"{peak[40] / 2**20:.0f} MiB",
            f"{(peak[360]) / peak[40]:.2f}",
        ),
    ]
