"""How long a remap takes, beside other programs that do the same job on the same pixels."""

import math
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from remap_peers import (
    BareCv2,
    Job,
    Programs,
    ViewJob,
    ffmpeg_seconds_per_frame,
    nona_command,
    py360convert_view,
    scipy_remap,
    timed,
    write_planes,
)
from remap_pictures import frame_of, panorama_of
from remap_table import Row, absent_row, alternating, limit_row, note, seconds_row

from fullsphere.model.camera import Camera
from fullsphere.model.lens import KannalaBrandt
from fullsphere.model.remap import Remapper, remap
from fullsphere.model.store import save_camera
from fullsphere.model.table import tabulate
from fullsphere.mosaic.photographer import Scene

Pixels = NDArray[Any]

KEPT_BYTES = 512 << 20
_POINTS = 1_000_000
_GIGAPIXEL_WIDTH = 46340
_FRAME_OF_100_MEGAPIXELS = 10000


SPEED_PARTS = ("steady", "first-frame", "python", "points")


def speed_rows(
    parts: Sequence[str], scene: Scene, job: Job, programs: Programs, runs: int, executor: Executor, folder: Path
) -> list[Row]:
    """The comparisons of times of those `parts` that are of SPEED_PARTS; files go to `folder`."""
    rows: list[Row] = []
    if {"steady", "first-frame", "python"}.intersection(parts):
        note("speed: rendering the frame")
        frame = frame_of(scene, job.camera, executor, supersampling=2)
    if "steady" in parts:
        rows += _steady(frame, job, programs, runs, executor, folder)
    if "first-frame" in parts:
        rows += _first_frame(frame, job, programs, runs, folder)
    if "python" in parts:
        rows.append(_against_scipy(frame, job, runs, executor))
        view = ViewJob(job.width, job.side)
        rows.append(_against_py360convert(scene, view, programs, runs, executor, folder))
    if "points" in parts:
        rows += _points(runs)
    return rows


def _steady(frame: Pixels, job: Job, programs: Programs, runs: int, executor: Executor, folder: Path) -> list[Row]:
    """One frame after another in one process."""
    write_planes(folder / "in.gbrp", frame)
    (folder / "in.rgb24").write_bytes(frame.tobytes())
    bare = BareCv2(job)
    keeping = Remapper(job.camera, job.target, None, "linear", kept_bytes=KEPT_BYTES, executor=executor)
    jobs: dict[str, Callable[[], float | None]] = {
        "cv2": lambda: _discarded(bare(frame)),
        "fly": lambda: _discarded(remap(frame, job.camera, job.target, None, "linear", executor)),
        "kept": lambda: _discarded(keeping(frame)),
    }
    layouts = ("gbrp", "rgb24") if programs.ffmpeg else ()
    for layout in layouts:
        jobs[layout] = partial(ffmpeg_seconds_per_frame, programs.ffmpeg or "", folder / f"in.{layout}", job, layout)
    seconds = alternating(runs, jobs)
    fly, kept = "linear, geometry on the fly", "linear, geometry kept"
    rows = [
        seconds_row(f"{fly} / cv2.remap, maps ready", seconds["fly"], seconds["cv2"], 1.0),
        seconds_row(f"{kept} / cv2.remap, maps ready", seconds["kept"], seconds["cv2"], 0.75),
    ]
    if not layouts:
        return [*rows, absent_row(f"{fly} / ffmpeg v360", "ffmpeg")]
    for layout in layouts:
        rows += [
            seconds_row(
                f"{way} / ffmpeg v360, {layout}, a frame in steady state", seconds[name], seconds[layout], limit
            )
            for way, name, limit in ((fly, "fly", None), (kept, "kept", 0.45))
        ]
    return rows


def _first_frame(frame: Pixels, job: Job, programs: Programs, runs: int, folder: Path) -> list[Row]:
    """Whole processes, from an uncompressed TIFF to an uncompressed TIFF."""
    measure = "first frame, whole process, TIFF to TIFF, linear / nona"
    if programs.nona is None:
        return [absent_row(measure, "nona")]
    _write_tiff(folder / "in.tif", frame)
    save_camera(folder / "camera.json", job.camera)
    ours = _command(folder, folder / "in.tif", folder / "camera.json", job.width, "ours.tif")
    ours += ["--interpolation", "linear"]
    if _offers("--compression"):
        ours += ["--compression", "none"]
    theirs = nona_command(programs.nona, job, folder / "in.tif", folder / "nona.tif", "linear")
    seconds = alternating(runs, {"ours": lambda: timed(ours), "nona": lambda: timed(theirs)})
    return [seconds_row(measure, seconds["ours"], seconds["nona"], 0.5)]


def _against_scipy(frame: Pixels, job: Job, runs: int, executor: Executor) -> Row:
    jobs: dict[str, Callable[[], float | None]] = {
        "ours": lambda: _discarded(remap(frame, job.camera, job.target, None, "linear", executor)),
        "scipy": lambda: _discarded(scipy_remap(frame, job)),
    }
    seconds = alternating(runs, jobs)
    return seconds_row("linear, geometry on the fly / numpy and scipy", seconds["ours"], seconds["scipy"], 0.05)


def _against_py360convert(
    scene: Scene, job: ViewJob, programs: Programs, runs: int, executor: Executor, folder: Path
) -> Row:
    """A panorama to a perspective view: py360convert has no fisheye."""
    measure = f"panorama {job.width} to a view of {job.side} x {job.side}, linear / py360convert"
    python = programs.python_with_py360convert
    if python is None:
        return absent_row(measure, "py360convert")
    panorama = panorama_of(scene, job.width, executor, supersampling=1)
    np.save(folder / "panorama.npy", panorama)
    libraries = set()

    def theirs() -> float:
        _, seconds, library = py360convert_view(python, folder / "panorama.npy", job, "linear")
        libraries.add(library)
        return seconds

    jobs: dict[str, Callable[[], float | None]] = {
        "ours": lambda: _discarded(remap(panorama, job.source, job.camera, None, "linear", executor)),
        "py360convert": theirs,
    }
    seconds = alternating(runs, jobs)
    measure += f" (with {' '.join(libraries)})"
    return seconds_row(measure, seconds["ours"], seconds["py360convert"], 0.05)


def _points(runs: int) -> list[Row]:
    """A million points through a table in double precision, on one core."""
    camera = Camera(KannalaBrandt(600.0, -0.02, 0.003, -0.0005, 0.0), (2000, 2000), (999.5, 999.5), half_fov=1.4)
    table = tabulate(camera)
    random = np.random.default_rng(0)
    theta, phi = random.uniform(0, 1.35, _POINTS), random.uniform(0, 2 * math.pi, _POINTS)
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    pixels = table.project(rays)
    matrix = np.array([[600.0, 0, 999.5], [0, 600.0, 999.5], [0, 0, 1]])
    coefficients = np.array([-0.02, 0.003, -0.0005, 0.0])
    objects, nothing = rays.reshape(1, -1, 3), np.zeros(3)

    def theirs() -> None:
        cv2.fisheye.projectPoints(objects, nothing, nothing, matrix, coefficients)

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    jobs: dict[str, Callable[[], float | None]] = {
        "project": lambda: _discarded(table.project(rays)),
        "unproject": lambda: _discarded(table.unproject(pixels)),
        "cv2": theirs,
    }
    seconds = alternating(max(runs, 7), jobs)
    cv2.setNumThreads(threads)
    return [
        seconds_row(f"table, {way} a million points / cv2.fisheye.projectPoints", seconds[way], seconds["cv2"], 1 / 3)
        for way in ("project", "unproject")
    ]


def gigapixel_rows(scene: Scene, executor: Executor, folder: Path) -> list[Row]:
    """A gigapixel from a frame of 100 megapixels: memory, and time beside smaller targets."""
    large, usual = Job(_FRAME_OF_100_MEGAPIXELS, _GIGAPIXEL_WIDTH), Job(3000, 8192)
    _photographed(scene, large, executor, folder / "large")
    _photographed(scene, usual, executor, folder / "usual")

    def run(name: str, width: int) -> tuple[float, float]:
        """Seconds a megapixel, and peak bytes."""
        note(f"gigapixel: {width} x {width // 2} from the {name} frame")
        command = _command(folder, folder / f"{name}.tif", folder / f"{name}.json", width, "out.tif")
        seconds, peak = _time_and_peak(command)
        return seconds / (width * (width // 2)) * 1e6, peak

    of_usual, _ = run("usual", usual.width)
    of_small, _ = run("large", usual.width)
    of_gigapixel, peak = run("large", large.width)
    size = f"{large.width} x {large.width // 2} from 100 megapixels, defaults"
    return [
        limit_row(f"{size}: peak memory", peak / (1 << 30), 1.5, "GiB"),
        seconds_row(f"{size}: a megapixel / of 8192 x 4096 from 9 megapixels", of_gigapixel, of_usual, 1.25),
        seconds_row(f"{size}: a megapixel / of 8192 x 4096 from the same frame", of_gigapixel, of_small, 1.25),
    ]


def _photographed(scene: Scene, job: Job, executor: Executor, stem: Path) -> None:
    """The job's frame and camera as files."""
    note(f"rendering a frame of {job.side} x {job.side}")
    _write_tiff(stem.with_suffix(".tif"), frame_of(scene, job.camera, executor, supersampling=1))
    save_camera(stem.with_suffix(".json"), job.camera)


def _time_and_peak(command: list[str]) -> tuple[float, float]:
    """Seconds and peak resident bytes of a whole process, measured by a process in between that has no other child."""
    watcher = (
        "import resource, subprocess, sys, time; t = time.perf_counter(); "
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL); "
        "print(time.perf_counter() - t, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", watcher, *command], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command[:2])}: {done.stderr.strip()[-800:]}")
    seconds, kilobytes = map(float, done.stdout.split())
    return seconds, kilobytes * 1024


def _command(folder: Path, picture: Path, camera: Path, width: int, output: str) -> list[str]:
    command = ["fullsphere", "remap", str(picture), "--from", str(camera), "--to", f"equirectangular:{width}"]
    return [*command, "-o", str(folder / output), "--overwrite"]


def _offers(option: str) -> bool:
    return option in subprocess.run(["fullsphere", "remap", "--help"], capture_output=True, text=True).stdout


def _write_tiff(path: Path, frame: Pixels) -> None:
    cv2.imwrite(str(path), frame[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 1])


def _discarded(_: object) -> None:
    """For timing a call whose result is not wanted."""
