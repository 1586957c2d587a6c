"""`fullsphere stitch`: frames of a rotating camera -> a full-sphere panorama."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console, messages
from fullsphere.cli.calibrating import (
    Measured,
    add_lens_arguments,
    calibrated,
    check_lens,
    is_table,
    measure_photos,
    target_file,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import numpy as np

    from fullsphere.model.camera import Camera
    from fullsphere.mosaic.project import Frame, Mosaic

EPILOG = """\
examples:
  fullsphere stitch IMG_*.jpg -o pano.jpg                          the lens is found from the frames themselves
  fullsphere stitch IMG_*.jpg -o pano.tif --camera camera.json     with a lens calibrated before
  fullsphere stitch IMG_*.jpg -o pano.tif --calibrate points.csv   calibrated first, from known points
  fullsphere stitch IMG_*.jpg -o pano.tif --calibrate BOARD_*.jpg --target chessboard:6x8:30mm
                                                                   calibrated first, from photos of a target
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "frames", nargs="+", type=Path, metavar="FRAME", help="pictures taken from one place (JPEG, PNG, TIFF, EXR)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="PANO", help="panorama to write: .tif, .png or .jpg"
    )
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument(
        "--camera",
        type=Path,
        metavar="CAMERA.json",
        help="the calibrated camera; without it the lens is found from the frames",
    )
    lens.add_argument(
        "--calibrate",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="calibrate first: from photos of a --target, or from one CSV of known 3D points and their pixels",
    )
    add_lens_arguments(parser)
    parser.add_argument(
        "--size",
        type=int,
        default=4096,
        metavar="WIDTH",
        help="width of the panorama in pixels, even (default: %(default)s)",
    )
    parser.add_argument("--mosaic", type=Path, metavar="MOSAIC.json", help="also write the solved project")


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    import numpy as np

    from fullsphere.model.files import check_output
    from fullsphere.model.images import check_panorama
    from fullsphere.model.surface import Equirectangular
    from fullsphere.model.workers import thread_pool
    from fullsphere.mosaic.frames import open_frames
    from fullsphere.mosaic.stitch import solve
    from fullsphere.mosaic.store import save_mosaic

    _check_given(args)
    check_lens(args)
    surface = Equirectangular(console.panorama_size(args.size))
    check_panorama(args.output, surface.size, 4, np.uint8)
    inputs = [*args.frames, *([args.camera] if args.camera else []), *(args.calibrate or []), *target_file(args)]
    for output in filter(None, (args.output, args.mosaic)):
        check_output(output, args.overwrite, inputs)
    with thread_pool(args.threads) as executor:
        measured = _measured(args)
        camera = _given_camera(args)
        progress = console.progress(args)
        size = camera.size if camera else measured.image_size if measured else None
        frames = open_frames(args.frames, size, executor, progress)
        if args.calibrate:
            camera = _calibrated(args, measured, frames)
        mosaic = solve(frames, camera, executor, progress)
        write_panorama(args.output, mosaic, surface, executor, args)
        if args.mosaic:
            save_mosaic(args.mosaic, mosaic, args.overwrite)
    left_out = [frame for frame in mosaic.frames if not frame.registered]
    for frame in left_out:
        messages.warn(f"{frame.id} is left out: {frame.reason}")
    console.report(args, _summary(args, mosaic), _lines(args, mosaic))
    return console.done(args, with_warnings=bool(left_out))


def _given_camera(args: argparse.Namespace) -> Camera | None:
    from fullsphere.model.store import load_camera

    return load_camera(args.camera) if args.camera else None


def _check_given(args: argparse.Namespace) -> None:
    from fullsphere.model.errors import UsageError

    if args.target and not args.calibrate:
        raise UsageError("--target says what is in the photos of --calibrate; give those too")
    if args.target and is_table(args.calibrate):
        raise UsageError("--target is for photos; a table of points holds its target's coordinates itself")


def _measured(args: argparse.Namespace) -> Measured | None:
    """The views in photos of a target; None where there are none, or a table has them, which does not tell its size."""
    return measure_photos(args, args.calibrate) if args.calibrate and not is_table(args.calibrate) else None


def _calibrated(args: argparse.Namespace, measured: Measured | None, frames: list[Frame]) -> Camera:
    from fullsphere.model.calibration.points import read_points
    from fullsphere.mosaic.rim import common_circle

    good = [frame for frame in frames if not frame.reason]
    if measured is None:
        measured = Measured(read_points(args.calibrate[0]), good[0].size)
    calibration = calibrated(args, measured).calibration
    console.say(
        args,
        f"calibrated from {console.counted(len(calibration.views), 'view')}: "
        f"{calibration.camera.lens.projection} lens, {calibration.rms_px:.4f} px rms",
    )
    return calibration.within(measured.circle).within(common_circle(good)).camera


def write_panorama(path: Path, mosaic: Mosaic, surface: Any, executor: Executor, args: argparse.Namespace) -> None:
    """Compose a mosaic into a file, in the depth that its frames have and the format holds."""
    from fullsphere.model.images import gpano, open_panorama
    from fullsphere.mosaic.compose import compose

    dtype = _depth(path, mosaic)
    bands = console.progress(args)(
        compose(mosaic, surface, dtype, executor), title="composing", total=-(-surface.size[1] // 512)
    )
    with open_panorama(path, surface.size, 4, dtype, gpano(surface.size), args.overwrite) as writer:
        for band in bands:
            writer.write_rows(band.top, band.rows)


def _depth(path: Path, mosaic: Mosaic) -> type[np.uint8] | type[np.uint16] | type[np.float32]:
    import numpy as np

    deepest = mosaic.registered[0].load().dtype
    if path.suffix.lower() in (".jpg", ".jpeg") or deepest == np.uint8:
        return np.uint8
    return np.float32 if deepest == np.float32 and path.suffix.lower() in (".tif", ".tiff") else np.uint16


def _summary(args: argparse.Namespace, mosaic: Mosaic) -> dict[str, Any]:
    return {
        "panorama": str(args.output),
        "frames": len(mosaic.frames),
        "registered": len(mosaic.registered),
        "left_out": {frame.id: frame.reason for frame in mosaic.frames if not frame.registered},
        "level": mosaic.level,
        "self_calibrated": mosaic.self_calibrated,
        **mosaic.quality,
    }


def _lines(args: argparse.Namespace, mosaic: Mosaic) -> list[str]:
    quality = mosaic.quality
    return [
        f"{args.output}: {len(mosaic.registered)} of {len(mosaic.frames)} frames, {quality['matches']} matches agree "
        f"to {quality['residual_median_px']:.2f} px (median), {quality['residual_rms_px']:.2f} px (rms)",
    ]
