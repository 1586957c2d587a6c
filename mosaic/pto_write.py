"""A mosaic as a Hugin project (.pto), in which Hugin can go on."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, InputError, OutputError
from fullsphere.model.files import output_errors, replacing
from fullsphere.model.images import picture_size
from fullsphere.model.lens import FloatArray
from fullsphere.model.store import camera_to_dict
from fullsphere.mosaic.loading import Crop
from fullsphere.mosaic.orientation_tag import turned_from_stored
from fullsphere.mosaic.project import Frame, Link, Mosaic
from fullsphere.mosaic.pto_fit import FittedLens, circle_shows, lens_of
from fullsphere.mosaic.pto_images import RECORD
from fullsphere.mosaic.pto_lens import CIRCULAR
from fullsphere.mosaic.pto_vignetting import coefficients_of
from fullsphere.mosaic.store_frames import relative_path, yaw_pitch_roll_deg

MOST_POINTS = 200
"""Control points of a pair of pictures: Hugin's own search gives ten or so, and its optimiser takes all."""

_SRGB = {"Ra": 0.357, "Rb": -1.245, "Rc": -0.044, "Rd": -0.218, "Re": 0.0865}
"""Response of a camera that writes sRGB, in Hugin's model (Grossberg & Nayar 2004): fitted to what `nona` made of a
ramp, 0.06 EV rms off sRGB's own curve from code 8 on; zeros, the mean of all cameras, would be 0.5 EV off."""

_SHARED = ("v", "Ra", "Rb", "Rc", "Rd", "Re", "a", "b", "c", "d", "e", "g", "t", "Va", "Vb", "Vc", "Vd", "Vx", "Vy")
_DECIMALS = 10  # of angles in degrees: as many as come back from a matrix
_CIRCLE_KEPT = 0.9  # of the radius: a circle cut by more to lie within its part of the file is no longer cropped as one


class _Picture(NamedTuple):
    """A frame in the coordinates of its file: camera and crop, the file's size, the lens, and world_from_camera."""

    frame: Frame
    camera: Camera
    crop: Crop | None
    size: tuple[int, int]
    fitted: FittedLens
    camera_from_world: FloatArray


def write_pto(path: Path, mosaic: Mosaic, overwrite: bool = False) -> dict[str, float]:
    """Write the registered frames of a mosaic as a Hugin project.

    Parameters
    ----------
    path
        The .pto to write; pictures are named relative to it.
    mosaic
        What to write.  Of the matches of a link at most `MOST_POINTS` become control points, evenly picked.
    overwrite
        Whether a file at `path` may be replaced.

    Returns
    -------
    By the frame's `id`, how far Hugin's lens is off the frame's camera at most, in pixels.

    Raises
    ------
    OutputError
        If the file cannot be written, exists and `overwrite` is false, no frame is registered, or libpano's polynomial
        follows a camera nowhere near.
    """
    path = Path(path)
    registered = [k for k, frame in enumerate(mosaic.frames) if frame.registered]
    if not registered:
        raise OutputError(f"{path}: not written: no frame is registered")
    try:
        pictures = _pictures(mosaic, registered)
    except CameraError as error:
        raise OutputError(f"{path}: not written: {error}") from error
    lines = [*_head(pictures), *_images(pictures, mosaic, path.parent)]
    lines += ["", "# specify variables that should be optimized"]
    lines += [f"v {variable}{k}" for k in range(1, len(pictures)) for variable in "ryp"] + ["v", ""]
    lines += ["# control points", *_points(pictures, mosaic.links, registered), ""]
    lines += [f"# left out: {frame.id}: {frame.reason}" for frame in mosaic.frames if not frame.registered]
    text = "\n".join(" ".join(line.split("\n")) for line in lines) + "\n"
    with replacing(path, overwrite) as temporary, output_errors(path):
        temporary.write_bytes(text.encode("utf-8", "surrogateescape"))
    return {picture.frame.id: picture.fitted.error_px for picture in pictures}


def _pictures(mosaic: Mosaic, registered: Sequence[int]) -> list[_Picture]:
    sizes: dict[str, tuple[int, int]] = {}
    lenses: dict[tuple[Camera, Crop | None, tuple[int, int]], FittedLens] = {}
    found = []
    for k in registered:
        frame = mosaic.frames[k]
        if frame.image not in sizes:
            sizes[frame.image] = _file_size(frame, mosaic.frames)
        camera, size = _as_stored(mosaic.cameras[frame.camera], frame.turned), sizes[frame.image]
        key = (camera, frame.crop_px, size)
        if key not in lenses:
            lenses[key] = lens_of(camera, size, *(frame.crop_px or (0, 0))[:2])
        turn = turned_from_stored(frame.turned).T @ np.asarray(frame.camera_from_world)
        found.append(_Picture(frame, camera, frame.crop_px, size, lenses[key], turn))
    return found


def _file_size(frame: Frame, frames: Sequence[Frame]) -> tuple[int, int]:
    """Of the file; where it cannot be read, the least that holds all frames from it."""
    try:
        return picture_size(Path(frame.image))
    except InputError:
        parts = [f.crop_px for f in frames if f.image == frame.image and f.crop_px]
        if parts:
            return max(c[0] + c[2] for c in parts), max(c[1] + c[3] for c in parts)
        width, height = frame.size
        return (width, height) if frame.turned % 2 == 0 else (height, width)


def _as_stored(camera: Camera, turned: int) -> Camera:
    """The camera of the picture as its file holds it, which was turned clockwise by so many quarter turns."""
    if turned % 4 == 0:
        return camera
    (width, height), aspect, lens = camera.size, camera.aspect, camera.lens
    centre = _stored_pixels(np.array([camera.centre]), camera.size, turned)[0]
    if turned % 2:
        width, height, lens, aspect = height, width, lens.scaled(aspect), 1 / aspect
    return Camera(lens, (width, height), (float(centre[0]), float(centre[1])), half_fov=camera.half_fov, aspect=aspect)


def _stored_pixels(pixels: FloatArray, size: tuple[int, int], turned: int) -> FloatArray:
    """Pixels (n, 2) of a frame in its part of the file, before that was turned clockwise."""
    back = turned_from_stored(turned).T[:2, :2]
    stored = size if turned % 2 == 0 else size[::-1]
    return np.asarray((pixels - (np.array(size) - 1) / 2) @ back.T + (np.array(stored) - 1) / 2)


def _head(pictures: Sequence[_Picture]) -> list[str]:
    picture = pictures[0]
    per_degree = picture.camera.image_radius / math.degrees(picture.camera.half_fov)
    width = 2 * round(180 * per_degree)
    return [
        "# hugin project file",
        "#hugin_ptoversion 2",
        f'p f2 w{width} h{width // 2} v360 E0 R0 n"TIFF_m c:LZW r:CROP"',
        "m g1 i0 f0 m2 p0.00784314",
        "",
        "# image lines",
    ]


def _images(pictures: Sequence[_Picture], mosaic: Mosaic, folder: Path) -> Iterator[str]:
    first_of: dict[tuple[FittedLens, Crop | None], int] = {}
    for k, picture in enumerate(pictures):
        frame, lens = picture.frame, picture.fitted.lens
        record = {
            "camera": {key: v for key, v in camera_to_dict(picture.camera).items() if key != "curve"},
            "crop_px": picture.crop,
            "error_px": picture.fitted.error_px,
            "id": frame.id,
            "shot": frame.shot,
        }
        yield RECORD + json.dumps(record, sort_keys=True)
        vb, vc, vd = coefficients_of(mosaic.vignetting_of(frame.camera), picture.camera, lens)
        red, green, blue = frame.white_balance
        red, blue, exposure_ev = red / green, blue / green, frame.exposure_ev + math.log2(green)
        values = {"v": lens.hfov_deg, **_SRGB, "Eev": -exposure_ev}
        yaw, pitch, roll = (round(angle, _DECIMALS) for angle in yaw_pitch_roll_deg(picture.camera_from_world))
        values |= {
            "Er": red,
            "Eb": blue,
            "r": roll,
            "p": pitch,
            "y": yaw,
            "TrX": 0,
            "TrY": 0,
            "TrZ": 0,
            "Tpy": 0,
            "Tpp": 0,
        }
        values |= {"j": 0, "a": lens.a, "b": lens.b, "c": lens.c, "d": lens.d, "e": lens.e, "g": 0, "t": 0}
        values |= {"Va": 1, "Vb": vb, "Vc": vc, "Vd": vd, "Vx": lens.d, "Vy": lens.e}
        owner = first_of.setdefault((picture.fitted, picture.crop), k)
        written = [f"{key}={owner}" if key in _SHARED and owner < k else _number(key, v) for key, v in values.items()]
        crop = _selection(picture)
        name = relative_path(frame.image, folder)
        yield f'i w{picture.size[0]} h{picture.size[1]} f{lens.kind} {" ".join(written)} {crop} Vm5 n"{name}"'


def _number(key: str, value: float) -> str:
    """Name and shortest text of the number, without an exponent, which not every reader of the format takes."""
    return f"{key}{np.format_float_positional(float(value) + 0.0, trim='-')}"


def _selection(picture: _Picture) -> str:
    """The crop: for a circular fisheye the box of the image circle, else the part of the file."""
    left, top, width, height = picture.crop or (0, 0, *picture.size)
    if picture.fitted.lens.kind in CIRCULAR and circle_shows(picture.camera):
        u, v, radius = picture.camera.centre[0] + left, picture.camera.centre[1] + top, picture.camera.image_radius
        within = min(u - left, v - top, left + width - 1 - u, top + height - 1 - v)
        if picture.crop:
            radius = min(radius, max(within, _CIRCLE_KEPT * radius))
        box = (math.ceil(u - radius), math.floor(u + radius) + 1, math.ceil(v - radius), math.floor(v + radius) + 1)
        return f"S{box[0]},{box[1]},{box[2]},{box[3]}"
    return f"S{left},{left + width},{top},{top + height}" if picture.crop else ""


def _points(pictures: Sequence[_Picture], links: Sequence[Link], registered: Sequence[int]) -> Iterator[str]:
    number = {k: n for n, k in enumerate(registered)}
    for link in links:
        if link.i not in number or link.j not in number:
            continue
        step = -(-len(link.pixels_i) // MOST_POINTS) or 1
        ends = number[link.i], number[link.j]
        both = [
            _file_pixels(pictures[n], px[::step]) for n, px in zip(ends, (link.pixels_i, link.pixels_j), strict=True)
        ]
        for (x, y), (X, Y) in zip(both[0].tolist(), both[1].tolist(), strict=True):
            yield f"c n{ends[0]} N{ends[1]} x{x:.6f} y{y:.6f} X{X:.6f} Y{Y:.6f} t0"


def _file_pixels(picture: _Picture, pixels: FloatArray) -> FloatArray:
    stored = _stored_pixels(pixels, picture.frame.size, picture.frame.turned)
    return np.asarray(stored + np.array((picture.crop or (0, 0))[:2], float))
