"""How close a remap comes to the truth: the target rendered from the scene itself, each pixel the mean of its area.

Every program resamples the same scene, photographed through the camera as that program understands it; that it does is
checked first, with a frame whose pixels hold their own positions.
"""

import math
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from remap_peers import (
    FFMPEG_INTERPOLATIONS,
    NONA_INTERPOLATIONS,
    PY360CONVERT_INTERPOLATIONS,
    BareCv2,
    Job,
    Programs,
    ViewJob,
    ffmpeg_remap,
    nona_remap,
    py360convert_view,
    scipy_remap,
)
from remap_pictures import Codes, frame_of, panorama_of
from remap_table import Row, absent_row, decibel_row, limit_row, note

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import (
    BaksteinPajdla,
    Equidistant,
    Equisolid,
    KannalaBrandt,
    Lens,
    Perspective,
    Stereographic,
    Thoby,
)
from fullsphere.model.remap import remap
from fullsphere.model.table import tabulate
from fullsphere.mosaic.photographer import Scene, panorama

Pixels = NDArray[Any]
Mask = NDArray[np.bool_]
Decibels = dict[str, float]

OUR_INTERPOLATIONS = ("nearest", "linear", "cubic", "lanczos3")
_JUDGED_DEG = (
    88.0  # from the axis: the rim of a frame of 183 degrees, which every program cuts its own way, is left out
)
_AREA_SAMPLES = 16  # along each side of a target pixel, for means over its area
_MINIFICATION = 4.0
_PIXELS_PER_STEP = 80  # codes of the position frames: 16 bits hold 800 pixels


def accuracy_rows(
    scene: Scene, job: Job, view: ViewJob, programs: Programs, executor: Executor, folder: Path
) -> list[Row]:
    """Every comparison of accuracy."""
    note("accuracy: rendering frames and their truth")
    frame = frame_of(scene, job.camera, executor)
    frame_for_ffmpeg = frame_of(scene, job.camera_of_ffmpeg, executor) if programs.ffmpeg else frame
    return [
        *_position_rows(programs),
        *_sphere_rows(scene, frame, frame_for_ffmpeg, job, programs, executor),
        *_view_rows(scene, view, programs, executor, folder),
        *_minification_rows(scene, frame, frame_for_ffmpeg, job, programs, executor),
        *_table_rows(),
    ]


def psnr(picture: Pixels, truth: Pixels, where: Mask | None = None) -> float:
    """Peak signal to noise ratio of uint8 pictures, decibels."""
    error = picture.astype(np.float32) - truth.astype(np.float32)
    return 10 * math.log10(255**2 / float(np.mean(np.square(error if where is None else error[where]), dtype=float)))


def _position_rows(programs: Programs) -> list[Row]:
    """How far from where it should a program reads, so that a convention misunderstood does not pass for an error."""
    job = Job(750, 2048)
    ramp = np.arange(job.side, dtype=np.uint16) * _PIXELS_PER_STEP
    u, v = np.meshgrid(ramp, ramp)
    frame = np.stack([u, v, np.full_like(u, 65535)], -1)
    readers: dict[str, tuple[Camera, Callable[[], Pixels]]] = {
        "fullsphere": (job.camera, lambda: remap(frame, job.camera, job.target, None, "linear")[0]),
    }
    if programs.nona:
        nona = programs.nona
        readers["nona"] = job.camera, lambda: nona_remap(nona, frame, job, "linear")
    if programs.ffmpeg:
        ffmpeg = programs.ffmpeg
        readers["ffmpeg"] = job.camera_of_ffmpeg, lambda: ffmpeg_remap(ffmpeg, frame, job, "linear")
    inside = _judged(job.target)
    rays = _rays(job.target)
    rows = []
    for name, (camera, read) in readers.items():
        off = read()[..., :2].astype(float) / _PIXELS_PER_STEP - camera.project(rays)
        rms = float(np.sqrt(np.mean(np.sum(off[inside] ** 2, -1))))
        rows.append(limit_row(f"positions that {name} reads, rms off the job's", rms, 0.05, "px"))
    return rows


def _sphere_rows(
    scene: Scene, frame: Pixels, frame_for_ffmpeg: Pixels, job: Job, programs: Programs, executor: Executor
) -> list[Row]:
    """Fisheye to full sphere, all programs and interpolations."""
    truth = panorama_of(scene, job.width, executor)
    inside = _judged(job.target)
    ours = _ours(frame, job.camera, job.target, truth, inside, executor)
    rows = [_listing(f"frame {job.side} to sphere {job.width}, PSNR: fullsphere", ours)]
    for name, values in _peers(frame, frame_for_ffmpeg, job, programs, truth, inside).items():
        rows.append(_listing(f"frame {job.side} to sphere {job.width}, PSNR: {name}", values))
        rows += _compared(f"frame {job.side} to sphere {job.width}", ours, name, values)
    rows += [absent_row("PSNR", name) for name in ("nona", "ffmpeg") if getattr(programs, name) is None]
    return rows


def _peers(
    frame: Pixels, frame_for_ffmpeg: Pixels, job: Job, programs: Programs, truth: Pixels, inside: Mask
) -> dict[str, Decibels]:
    """PSNR of every peer by its interpolations."""
    found: dict[str, Decibels] = {}
    if programs.nona:
        nona = programs.nona
        found["nona"] = {i: psnr(nona_remap(nona, frame, job, i), truth, inside) for i in NONA_INTERPOLATIONS}
    if programs.ffmpeg:
        ffmpeg = programs.ffmpeg
        found["ffmpeg"] = {
            i: psnr(ffmpeg_remap(ffmpeg, frame_for_ffmpeg, job, i), truth, inside) for i in FFMPEG_INTERPOLATIONS
        }
    found["numpy and scipy"] = {"linear": psnr(scipy_remap(frame, job), truth, inside)}
    bare = BareCv2(job)
    found["cv2.remap"] = {name: psnr(bare(frame, flag), truth, inside) for name, flag in BareCv2.INTERPOLATIONS.items()}
    return found


def _view_rows(scene: Scene, job: ViewJob, programs: Programs, executor: Executor, folder: Path) -> list[Row]:
    """Panorama to perspective view: what py360convert can do."""
    what = f"sphere {job.width} to view {job.side}"
    python = programs.python_with_py360convert
    if python is None:
        return [absent_row(f"{what}, PSNR", "py360convert")]
    picture = panorama_of(scene, job.width, executor)
    np.save(folder / "scene.npy", picture)
    truth = frame_of(scene, job.camera, executor)
    ours = _ours(picture, job.source, job.camera, truth, None, executor)
    theirs = {
        name: psnr(py360convert_view(python, folder / "scene.npy", job, name)[0], truth)
        for name in PY360CONVERT_INTERPOLATIONS
    }
    return [
        _listing(f"{what}, PSNR: fullsphere", ours),
        _listing(f"{what}, PSNR: py360convert", theirs),
        *_compared(what, ours, "py360convert", theirs),
    ]


def _minification_rows(
    scene: Scene, frame: Pixels, frame_for_ffmpeg: Pixels, job: Job, programs: Programs, executor: Executor
) -> list[Row]:
    """A target four times coarser than the frame, beside the exact means of the frame over the target's pixels."""
    width = 2 * round(job.side / math.radians(job.fov_deg) * math.pi / _MINIFICATION)
    small = Job(job.side, width, job.fov_deg)
    inside = _judged(small.target)
    means = panorama(Codes(scene), width, supersampling=_AREA_SAMPLES, executor=executor)
    truth = np.round(means * 255).astype(np.uint8)
    exact = _area_exact(frame, small, executor)
    reference = psnr(exact, truth, inside)
    ours = _ours(frame, small.camera, small.target, truth, inside, executor)
    what = f"minification {_MINIFICATION:g} x, frame {job.side} to sphere {width}"
    rows = [
        decibel_row(f"{what}: {name} / area-exact", value, reference, -1.0)
        for name, value in ours.items()
        if name != "nearest"
    ]
    near = _ours(frame, small.camera, small.target, exact, inside, executor)
    rows.append(_listing(f"{what}, PSNR against area-exact: fullsphere", near))
    for name, values in _peers(frame, frame_for_ffmpeg, small, programs, truth, inside).items():
        rows.append(_listing(f"{what}, PSNR: {name}", values))
    return rows


def _area_exact(frame: Pixels, job: Job, executor: Executor) -> Pixels:
    """The frame, linear between its pixels, averaged over the area of every target pixel."""
    table, light = tabulate(job.camera), frame.astype(np.float32)

    class Frame:
        def radiance(self, rays: Any) -> NDArray[np.float32]:
            u, v = np.moveaxis(np.nan_to_num(table.project(rays, None, np.float32), nan=-10.0), -1, 0)
            return np.asarray(cv2.remap(light, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.float32)

    means = panorama(Frame(), job.width, supersampling=_AREA_SAMPLES, executor=executor)
    return np.round(means).astype(np.uint8)


def _ours(
    picture: Pixels, source: Projection, target: Projection, truth: Pixels, where: Mask | None, executor: Executor
) -> Decibels:
    """PSNR of this program by its interpolations, of those that this version has."""
    found = {}
    for interpolation in OUR_INTERPOLATIONS:
        try:
            result, _ = remap(picture, source, target, None, interpolation, executor)  # type: ignore[arg-type]
        except UsageError:
            continue
        found[interpolation] = psnr(result, truth, where)
    return found


def _compared(what: str, ours: Decibels, name: str, theirs: Decibels) -> list[Row]:
    """Best against best, cubic against cubic."""
    our_best, their_best = max(ours, key=lambda i: ours[i]), max(theirs, key=lambda i: theirs[i])
    measure = f"{what}: best ({our_best}) / best of {name} ({their_best})"
    rows = [decibel_row(measure, ours[our_best], theirs[their_best], 0.0)]
    if "cubic" in theirs:
        rows.append(decibel_row(f"{what}: cubic / cubic of {name}", ours["cubic"], theirs["cubic"], 0.0))
    return rows


def _listing(measure: str, values: Decibels) -> Row:
    return Row(f"{measure}: " + ", ".join(f"{name} {value:.2f}" for name, value in values.items()))


def _rays(target: Projection) -> NDArray[np.float64]:
    width, height = target.size
    return target.unproject(np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), -1))


def _judged(target: Projection) -> Mask:
    return np.asarray(_rays(target)[..., 2] > math.cos(math.radians(_JUDGED_DEG)))


def _table_rows() -> list[Row]:
    """The largest error of tables over random rays and pixels, against the exact functions of the camera."""
    lenses: list[tuple[type[Lens], tuple[float, ...], float]] = [
        (Equidistant, (1.0,), 195),
        (Equisolid, (1.0,), 195),
        (Stereographic, (1.0,), 195),
        (Thoby, (1.0,), 195),
        (KannalaBrandt, (1.0, -0.02, 0.003, -0.0004, 0.0), 195),
        (BaksteinPajdla, (0.9, 2.11, 0.28, 1.13), 195),
        (Perspective, (1.0,), 150),
    ]
    worst = {"float32": 0.0, "float64": 0.0, "unproject": 0.0}
    for kind, values, fov_deg in lenses:
        camera = _filling(kind, values, math.radians(fov_deg) / 2)
        table = tabulate(camera, 1e-8)
        random = np.random.default_rng(0)
        theta, phi = camera.half_fov * np.sqrt(random.uniform(size=100_000)), random.uniform(0, 2 * math.pi, 100_000)
        rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        exact = camera.project(rays)
        for name in ("float32", "float64"):
            off = table.project(rays, None, getattr(np, name)).astype(float) - exact
            worst[name] = max(worst[name], float(np.nanmax(np.hypot(*off.T))))
        off = camera.project(table.unproject(exact)) - exact
        worst["unproject"] = max(worst["unproject"], float(np.nanmax(np.hypot(*off.T))))
    what = f"table of {len(lenses)} lenses, 4000 px, largest error"
    return [
        limit_row(f"{what}: project in float32", worst["float32"], 1e-3, "px"),
        limit_row(f"{what}: project in float64", worst["float64"], 1e-8, "px"),
        limit_row(f"{what}: unproject in float64", worst["unproject"], 1e-8, "px"),
    ]


def _filling(kind: type[Lens], values: tuple[float, ...], half_fov: float) -> Camera:
    """A camera of 4000 px whose image circle touches the sides; `values` are for a scale of one."""
    unit = kind(*values)
    scale = 2000 / float(unit.radius(half_fov))
    lengths = [p.key.endswith("_px") for p in unit.parameters]
    scaled = [value * scale if length else value for value, length in zip(values, lengths, strict=True)]
    return Camera(kind(*scaled), (4000, 4000), (1999.5, 1999.5), half_fov=half_fov)
