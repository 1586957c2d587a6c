"""`fullsphere demo`: the whole way on a built-in scene, measured against the truth."""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from fullsphere.model.camera import Camera
    from fullsphere.mosaic.photographer import Scene, Shot
    from fullsphere.mosaic.project import Mosaic

EPILOG = """\
The demo renders a photo of a known three-dimensional target and the frames of a hand-held turn in a furnished room,
both through a fisheye lens of 183 degrees; finds the target's corners and calibrates; stitches the frames with that
calibration; and compares lens, rotations and panorama with the truth, of which the program was told nothing.
"""

_FRAME_PX, _FRAMES, _PANORAMA_PX, _PREVIEW_PX = 1500, 8, 4096, 1600
_NOISE = 0.006
_VIGNETTING = (-0.25, -0.1)
_CURVE_TO_DEG = 91.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("fullsphere-demo"),
        metavar="FOLDER",
        help="folder for the pictures (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another room, turn and noise (default: 0)")


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.workers import thread_pool

    started = time.monotonic()
    folder: Path = args.output
    _make_folder(folder, args.overwrite)
    with thread_pool(args.threads) as executor:
        camera = true_camera()
        calibrated = _calibrate(args, folder, camera, executor)
        mosaic, errors = _stitch(args, folder, camera, calibrated, executor)
    rows = [*_curve_rows(calibrated, camera), *errors]
    lines = [
        f"{'':34}{'measured':>10}",
        *(f"{name:34}{_figure(value):>10} {unit}" for name, value, unit in rows),
        "",
        f"{folder}: target.png, target.json, points.csv, frame_*.jpg, camera.json, mosaic.json, panorama.tif, "
        f"preview.png ({time.monotonic() - started:.0f} s)",
    ]
    console.report(args, {"folder": str(folder), **{_key(n, u): v for n, v, u in rows}}, lines)
    return console.done(args, with_warnings=len(mosaic.registered) < len(mosaic.frames))


def _make_folder(folder: Path, overwrite: bool) -> None:
    from fullsphere.model.errors import OutputError
    from fullsphere.model.files import output_errors

    with output_errors(folder):
        if folder.is_dir() and not overwrite:
            raise OutputError(
                f"{folder}: exists already; add --overwrite to replace its pictures, or name another folder"
            )
        folder.mkdir(exist_ok=overwrite)


def true_camera() -> Camera:
    """The camera that takes the demo's pictures: 183 degrees, a centre off the middle, pixels not quite square."""
    import math

    from fullsphere.model.camera import Camera
    from fullsphere.model.lens import BaksteinPajdla

    half_fov = math.radians(91.5)
    shape = BaksteinPajdla(1.35, 2.11, 0.42, 1.13)
    lens = shape.scaled(0.97 * _FRAME_PX / 2 / float(shape.radius(half_fov)))
    middle = (_FRAME_PX - 1) / 2
    return Camera(lens, (_FRAME_PX, _FRAME_PX), (middle + 5.3, middle - 4.1), half_fov=half_fov, aspect=1.002)


def _calibrate(args: argparse.Namespace, folder: Path, camera: Camera, executor: Executor) -> Camera:
    """Photograph the target, find its corners, calibrate from them; only the target itself is known."""
    from fullsphere.model.calibration.calibrate import calibrate
    from fullsphere.model.calibration.photos import Photo, views_of_photos
    from fullsphere.model.calibration.points import read_points
    from fullsphere.model.calibration.record import save_calibration
    from fullsphere.model.calibration.target_file import save_target
    from fullsphere.model.calibration.targets import Target
    from fullsphere.model.images import read_picture
    from fullsphere.model.yaw_pitch_roll import rotation_of_angles
    from fullsphere.mosaic.worlds import charuco_box, photograph, target_scene

    boards = charuco_box()
    console.say(args, "photographing the target")
    pose = rotation_of_angles(2.5, -1.8, 1.2).T
    photo = photograph(
        target_scene(boards, (25.0, -18.0, 12.0)), camera, pose, noise=_NOISE, seed=args.seed, executor=executor
    )
    _write_picture(folder / "target.png", photo, args)
    console.say(args, "finding its corners and calibrating")
    saved = Photo("target.png", lambda: read_picture(folder / "target.png").pixels)
    target = Target("the box", boards)
    save_target(folder / "target.json", target, args.overwrite)
    seen = views_of_photos([saved], target)
    points, pixels = seen.views[0].points_on_target, seen.views[0].pixels
    _write_points(folder / "points.csv", "target.png", points, pixels, args)
    calibration = calibrate(read_points(folder / "points.csv"), camera.size)
    calibration = calibration.within(seen.circle)
    save_calibration(folder / "camera.json", calibration, [folder / "points.csv"], args.overwrite)
    lowest, highest = calibration.observed_theta_deg
    console.say(
        args,
        f"{len(points)} corners from {lowest:.1f} to {highest:.1f} degrees off axis, rms {calibration.rms_px:.3f} px",
    )
    return calibration.camera


def _stitch(
    args: argparse.Namespace, folder: Path, camera: Camera, calibrated: Camera, executor: Executor
) -> tuple[Mosaic, list[tuple[str, float, str]]]:
    """Photograph the room, stitch the frames, and measure the result."""
    from fullsphere.cli.composing import plain
    from fullsphere.cli.rendering import write_panorama
    from fullsphere.mosaic.frames import open_frames
    from fullsphere.mosaic.stitch import solve
    from fullsphere.mosaic.store import save_mosaic
    from fullsphere.mosaic.worlds import environment, furnished_room, turn

    console.say(args, "furnishing the room")
    room = environment(furnished_room(args.seed), executor=executor)
    shots = turn(_FRAMES, seed=args.seed)
    paths = [folder / f"frame_{k}.jpg" for k in range(_FRAMES)]
    progress = console.progress(args)
    for path, shot in progress(zip(paths, shots, strict=True), title="photographing", total=_FRAMES):
        _write_picture(path, _frame(room, camera, shot, executor), args)
    mosaic = solve(open_frames(paths, calibrated.size, executor, progress), calibrated, executor, progress)
    write_panorama(folder / "panorama.tif", mosaic, plain(_PANORAMA_PX), executor, args)
    save_mosaic(folder / "mosaic.json", mosaic, args.overwrite)
    return mosaic, _errors(args, folder, mosaic, room, shots, executor)


def _frame(room: Scene, camera: Camera, shot: Shot, executor: Executor) -> Any:
    from fullsphere.mosaic.worlds import photograph

    return photograph(
        room,
        camera,
        shot.camera_from_world,
        exposure_ev=shot.exposure_ev,
        vignetting=_VIGNETTING,
        noise=_NOISE,
        seed=shot.seed,
        executor=executor,
    )


def _errors(
    args: argparse.Namespace, folder: Path, mosaic: Mosaic, room: Scene, shots: Sequence[Shot], executor: Executor
) -> list[tuple[str, float, str]]:
    """Rows (name, value, unit) on rotations and panorama; writes the preview."""
    import cv2
    import numpy as np

    from fullsphere.model.images import encoded_from_linear, read_picture
    from fullsphere.mosaic.truth import Turned, psnr_db, rotation_errors_deg
    from fullsphere.mosaic.worlds import panorama

    placed = [(f, s) for f, s in zip(mosaic.frames, shots, strict=True) if f.registered]
    angles, true_from_found = rotation_errors_deg(
        [np.asarray(f.camera_from_world) for f, _ in placed], [s.camera_from_world for _, s in placed]
    )
    console.say(args, "comparing with the truth")
    found = read_picture(folder / "panorama.tif").pixels
    truth = encoded_from_linear(panorama(Turned(room, true_from_found), _PANORAMA_PX, executor=executor), np.uint8)
    seen = (found[..., 3] > 0).astype(np.float32)
    preview = cv2.resize(found[..., :3], (_PREVIEW_PX, _PREVIEW_PX // 2), interpolation=cv2.INTER_AREA)
    _write_picture(folder / "preview.png", preview, args)
    return [
        ("frames registered", float(len(placed)), f"of {len(shots)}"),
        ("rotation error, median", float(np.median(angles)), "degrees"),
        ("rotation error, largest", float(angles.max()), "degrees"),
        ("panorama PSNR", psnr_db(found[..., :3], truth, seen), "dB"),
        ("sphere covered", 100 * float(np.average(seen.mean(1), weights=_row_weights(len(seen)))), "%"),
    ]


def _row_weights(height: int) -> Any:
    import numpy as np

    return np.cos((np.arange(height) + 0.5) / height * np.pi - np.pi / 2)


def _curve_rows(calibrated: Camera, camera: Camera) -> list[tuple[str, float, str]]:
    import numpy as np

    from fullsphere.mosaic.truth import curve_errors_px

    gap = curve_errors_px(calibrated, camera, _CURVE_TO_DEG)
    return [
        (f"lens curve to {_CURVE_TO_DEG:.0f} degrees, rms", float(np.sqrt(np.mean(gap**2))), "px"),
        ("lens curve, largest error", float(np.abs(gap).max()), "px"),
    ]


def _figure(value: float) -> str:
    return f"{value:.0f}" if value == int(value) else f"{value:.4f}" if value < 10 else f"{value:.2f}"


def _key(name: str, unit: str) -> str:
    suffix = {"px": "_px", "degrees": "_deg", "dB": "_db", "%": "_percent"}.get(unit, "")
    return name.replace(",", "").replace(" ", "_").lower() + suffix


def _write_picture(path: Path, pixels: Any, args: argparse.Namespace) -> None:
    from fullsphere.model.images import open_panorama

    with open_panorama(path, (pixels.shape[1], pixels.shape[0]), 3, pixels.dtype, {}, args.overwrite) as writer:
        writer.write_rows(0, pixels)


def _write_points(path: Path, image: str, points: Any, pixels: Any, args: argparse.Namespace) -> None:
    from fullsphere.model.files import replacing

    with replacing(path, args.overwrite) as temporary, temporary.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["image", "x_mm", "y_mm", "z_mm", "u_px", "v_px"])
        for point, pixel in zip(points, pixels, strict=True):
            rows.writerow([image, *(f"{v:.4f}" for v in point), *(f"{v:.4f}" for v in pixel)])
