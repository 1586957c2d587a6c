"""`fullsphere stitch`: frames of a rotating camera -> a full-sphere panorama."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console, registering

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import numpy as np

    from fullsphere.mosaic.project import Mosaic

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
    registering.add_arguments(parser)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="PANO", help="panorama to write: .tif, .png or .jpg"
    )
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
    from fullsphere.mosaic.stitch import solve
    from fullsphere.mosaic.store import save_mosaic

    options = registering.check_arguments(args)
    surface = Equirectangular(console.panorama_size(args.size))
    check_panorama(args.output, surface.size, 4, np.uint8)
    for output in filter(None, (args.output, args.mosaic)):
        check_output(output, args.overwrite, registering.inputs_of(args))
    with thread_pool(args.threads) as executor:
        frames, (cameras, covariances) = registering.gather(args, executor)
        mosaic = solve(frames, cameras, executor, console.progress(args), options, covariances)
        write_panorama(args.output, mosaic, surface, executor, args)
        if args.mosaic:
            save_mosaic(args.mosaic, mosaic, args.overwrite)
    left_out = registering.warn(mosaic)
    summary = {"panorama": str(args.output), **registering.summary(mosaic)}
    console.report(args, summary, registering.lines(args.output, mosaic))
    return console.done(args, with_warnings=left_out)


def write_panorama(path: Path, mosaic: Mosaic, surface: Any, executor: Executor, args: argparse.Namespace) -> None:
    """Compose a mosaic into a file, in the depth and colour space that its frames have and the format holds."""
    import numpy as np

    from fullsphere.model.images import gpano, open_panorama
    from fullsphere.mosaic.compose import compose
    from fullsphere.mosaic.frame_colour import common_profile

    dtype = _depth(path, mosaic)
    icc_profile = None if dtype is np.float32 else common_profile(mosaic.registered).icc or None
    bands = console.progress(args)(
        compose(mosaic, surface, dtype, executor), title="composing", total=-(-surface.size[1] // 512)
    )
    with open_panorama(path, surface.size, 4, dtype, gpano(surface.size), args.overwrite, icc_profile) as writer:
        for band in bands:
            writer.write_rows(band.top, band.rows)


def _depth(path: Path, mosaic: Mosaic) -> type[np.uint8] | type[np.uint16] | type[np.float32]:
    import numpy as np

    deepest = mosaic.registered[0].load().dtype
    if path.suffix.lower() in (".jpg", ".jpeg") or deepest == np.uint8:
        return np.uint8
    return np.float32 if deepest == np.float32 and path.suffix.lower() in (".tif", ".tiff") else np.uint16
