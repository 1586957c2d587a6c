"""Other programs that resample a fisheye frame, each driven through the one job that all of them can be asked for.

The job: an equidistant fisheye frame, square, its image circle touching the sides, into a whole equirectangular
picture.  py360convert knows no fisheye; it makes a perspective view of a panorama instead.  A program that is not
installed is `None` in `Programs`; nothing here fails for that.
"""

import dataclasses
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, Perspective
from fullsphere.model.surface import Equirectangular

Pixels = NDArray[Any]

NONA_INTERPOLATIONS = {"linear": 5, "cubic": 0, "spline16": 1, "spline36": 2, "spline64": 4, "sinc256": 3}
"""By their number in the m line of a .pto; "cubic" is PanoTools' poly3, its default."""

FFMPEG_INTERPOLATIONS = ("linear", "cubic", "lagrange9", "lanczos", "spline16", "mitchell")

PY360CONVERT_INTERPOLATIONS = {"linear": "bilinear", "cubic": "bicubic", "quintic": "biquintic"}


@dataclasses.dataclass(frozen=True)
class Job:
    """A fisheye frame of `side` x `side` pixels into an equirectangular picture `width` wide."""

    side: int
    width: int
    fov_deg: float = 183.0

    @property
    def camera(self) -> Camera:
        """The frame's camera: the field of view reaches from the outer edge of the first pixel to that of the last."""
        return self._camera_over(self.side)

    @property
    def camera_of_ffmpeg(self) -> Camera:
        """The frame's camera as v360 takes it: the field of view reaches from pixel centre to pixel centre."""
        return self._camera_over(self.side - 1)

    def _camera_over(self, span_px: float) -> Camera:
        fov = math.radians(self.fov_deg)
        middle = (self.side - 1) / 2
        return Camera(Equidistant(span_px / fov), (self.side, self.side), (middle, middle), half_fov=fov / 2)

    @property
    def target(self) -> Equirectangular:
        return Equirectangular((self.width, self.width // 2))


@dataclasses.dataclass(frozen=True)
class Programs:
    """Where the peers are, None for one that is not installed."""

    ffmpeg: str | None
    nona: str | None
    python_with_py360convert: str | None

    @classmethod
    def found(cls) -> "Programs":
        """Those on the PATH; py360convert in this Python, or in that of the environment PEERS_VENV (/opt/peers)."""
        candidates = [sys.executable, str(Path(os.environ.get("PEERS_VENV", "/opt/peers")) / "bin" / "python")]
        python = next((p for p in candidates if _imports(p, "py360convert")), None)
        return cls(shutil.which("ffmpeg"), shutil.which("nona"), python)


def _imports(python: str, module: str) -> bool:
    if not Path(python).exists():
        return False
    return subprocess.run([python, "-c", f"import {module}"], capture_output=True).returncode == 0


class BareCv2:
    """`cv2.remap` on float32 maps that are ready beforehand; outside the lens they are -1, which reads the border."""

    INTERPOLATIONS: ClassVar = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC, "lanczos4": cv2.INTER_LANCZOS4}

    def __init__(self, job: Job) -> None:
        maps = np.full((2, job.width // 2, job.width), -1.0, np.float32)
        for top in range(0, job.width // 2, 256):
            rows = slice(top, min(top + 256, job.width // 2))
            pixels = job.camera.project(job.target.window_rays(slice(0, job.width), rows))
            maps[:, rows] = np.nan_to_num(np.moveaxis(pixels, -1, 0), nan=-1.0)
        self._u, self._v = maps

    def __call__(self, frame: Pixels, interpolation: int = cv2.INTER_LINEAR) -> Pixels:
        return np.asarray(cv2.remap(frame, self._u, self._v, interpolation, borderMode=cv2.BORDER_CONSTANT))


def scipy_remap(frame: Pixels, job: Job) -> Pixels:
    """The linear program that one writes with numpy and scipy alone: whole arrays, `map_coordinates` by channel."""
    width, height = job.target.size
    lon = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    lat = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    lon, lat = np.meshgrid(lon, lat)
    x, y, z = np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)
    theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    r = np.where(theta <= math.radians(job.fov_deg) / 2, theta * job.side / math.radians(job.fov_deg), np.nan)
    middle = (job.side - 1) / 2
    at = np.nan_to_num(np.stack([middle + r * np.sin(phi), middle + r * np.cos(phi)]), nan=-10.0)
    channels = [map_coordinates(frame[..., c], at, order=1) for c in range(frame.shape[2])]
    return np.stack(channels, -1)


def ffmpeg_remap(ffmpeg: str, frame: Pixels, job: Job, interpolation: str) -> Pixels:
    """One frame through v360, in planes, which is what the filter works in."""
    command = [*_ffmpeg_input(ffmpeg, job, _planar(frame.dtype), "-"), "-vf", _v360(job, interpolation)]
    command += ["-f", "rawvideo", "-pix_fmt", _planar(frame.dtype), "-"]
    done = subprocess.run(command, input=_planes(frame), capture_output=True, check=True)
    width, height = job.target.size
    green, blue, red = np.frombuffer(done.stdout, frame.dtype).reshape(3, height, width)
    return np.stack([red, green, blue], -1)


def ffmpeg_seconds_per_frame(ffmpeg: str, raw: Path, job: Job, layout: str, frames: int = 9) -> float:
    """Seconds a frame in steady state, linear: from when the first frame is done to the last one, start-up left out.

    `layout` is of the frames, in and out: "gbrp", planes, which is what the filter works in, or "rgb24", as most files
    and pipes have it.  They come from a file that holds one frame and is read over and over.
    """
    command = _ffmpeg_input(ffmpeg, job, layout, str(raw), loop=True)
    command[command.index("error")] = "info"  # at which the filter showinfo says that a frame is done
    command += ["-vf", f"{_v360(job, 'linear')},format={layout},showinfo=checksum=0"]
    command += ["-frames:v", str(frames), "-f", "null", "-"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        lines = process.stderr or ()
        done = [time.perf_counter() for line in lines if "showinfo" in line and " pts_time:" in line]
    if process.returncode or len(done) != frames:
        raise SystemExit(f"ffmpeg: {len(done)} of {frames} frames done, exit code {process.returncode}")
    return (done[-1] - done[0]) / (frames - 1)


def write_planes(path: Path, frame: Pixels) -> None:
    """One frame in planes, as `ffmpeg_seconds_per_frame` reads it with the layout "gbrp"."""
    path.write_bytes(_planes(frame))


def _planes(frame: Pixels) -> bytes:
    return np.ascontiguousarray(np.moveaxis(frame[..., [1, 2, 0]], -1, 0)).tobytes()


def _planar(dtype: np.dtype[Any]) -> str:
    return "gbrp" if dtype == np.uint8 else "gbrp16le"


def _ffmpeg_input(ffmpeg: str, job: Job, layout: str, source: str, loop: bool = False) -> list[str]:
    command = [ffmpeg, "-nostdin", "-v", "error", *(["-stream_loop", "-1"] if loop else []), "-f", "rawvideo"]
    return [*command, "-pix_fmt", layout, "-s", f"{job.side}x{job.side}", "-i", source]


def _v360(job: Job, interpolation: str) -> str:
    field = f"ih_fov={job.fov_deg}:iv_fov={job.fov_deg}"
    return f"v360=input=fisheye:{field}:output=e:interp={interpolation}:w={job.width}:h={job.width // 2}"


def nona_command(nona: str, job: Job, picture: Path, output: Path, interpolation: str) -> list[str]:
    """The command line that turns a TIFF into an uncompressed TIFF; the .pto is written beside `output`."""
    project = output.with_suffix(".pto")
    project.write_text(
        f'p f2 w{job.width} h{job.width // 2} v360 n"TIFF_m c:NONE r:CROP"\n'
        f"m g1 i{NONA_INTERPOLATIONS[interpolation]} f0\n"
        f"i w{job.side} h{job.side} f2 v{job.fov_deg} r0 p0 y0 a0 b0 c0 d0 e0 g0 t0 Ra0 Rb0 Rc0 Rd0 Re0 Eev0 Er1 Eb1 "
        f'Vm5 S0,{job.side},0,{job.side} n"{picture}"\n'
    )
    return [nona, "--ignore-exposure", "-z", "NONE", "-o", str(output.with_suffix("")), str(project)]


def nona_remap(nona: str, frame: Pixels, job: Job, interpolation: str) -> Pixels:
    """One frame through nona, by way of TIFF files, laid on the whole canvas."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cv2.imwrite(str(folder / "in.tif"), frame[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 1])
        timed(nona_command(nona, job, folder / "in.tif", folder / "out.tif", interpolation))
        (result,) = folder.glob("out*.tif")
        pixels = cv2.imread(str(result), cv2.IMREAD_UNCHANGED)
        return np.asarray(pixels[..., 2::-1])


@dataclasses.dataclass(frozen=True)
class ViewJob:
    """A panorama `width` wide into a square perspective view: what py360convert can do.

    Its field of view reaches from the centre of the first pixel to that of the last one.
    """

    width: int
    side: int
    fov_deg: float = 90.0

    @property
    def source(self) -> Equirectangular:
        return Equirectangular((self.width, self.width // 2))

    @property
    def camera(self) -> Camera:
        middle = (self.side - 1) / 2
        half_diagonal = math.atan(1.05 * math.sqrt(2) * math.tan(math.radians(self.fov_deg) / 2))
        focal = middle / math.tan(math.radians(self.fov_deg) / 2)
        return Camera(Perspective(focal), (self.side, self.side), (middle, middle), half_fov=half_diagonal)


_E2P = """
import json, sys, time
import numpy, py360convert
panorama, side, fov, mode, result = sys.argv[1:]
panorama = numpy.load(panorama)
started = time.perf_counter()
view = py360convert.e2p(panorama, float(fov), 0, 0, (int(side), int(side)), mode=mode)
seconds = time.perf_counter() - started
numpy.save(result, view)
with_cv2 = bool(getattr(py360convert.utils, "cv2", None))
print(json.dumps([seconds, "OpenCV" if with_cv2 else "scipy"]))
"""


def py360convert_view(python: str, panorama: Path, job: ViewJob, interpolation: str) -> tuple[Pixels, float, str]:
    """The view, the seconds of the call alone, and the library that py360convert sampled with; `panorama` is .npy."""
    with tempfile.TemporaryDirectory() as name:
        result = Path(name) / "view.npy"
        mode = PY360CONVERT_INTERPOLATIONS[interpolation]
        command = [python, "-c", _E2P, str(panorama), str(job.side), str(job.fov_deg), mode, str(result)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, library = json.loads(done.stdout)
        return np.load(result), float(seconds), str(library)


def timed(command: list[str]) -> float:
    """Seconds of a whole process; SystemExit with what it said if it fails."""
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command[:2])}: {(done.stderr or done.stdout).strip()[-800:]}")
    return time.perf_counter() - started
