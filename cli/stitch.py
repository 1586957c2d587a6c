"""`fullsphere stitch`: frames of a rotating camera -> a full-sphere panorama."""

from __future__ import annotations

import argparse
from pathlib import Path

from fullsphere.cli import composing, console, registering, rendering

EPILOG = """\
examples:
  fullsphere stitch IMG_*.jpg -o pano.jpg                          the lens is found from the frames themselves
  fullsphere stitch IMG_*.jpg -o pano.tif --camera camera.json     with a lens calibrated before
  fullsphere stitch IMG_*.jpg -o pano.tif --calibrate points.csv   calibrated first, from known points
  fullsphere stitch IMG_*.jpg -o pano.tif --calibrate BOARD_*.jpg --target chessboard:6x8:30mm
                                                                   calibrated first, from photos of a target
"""

_WIDTH_PX = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    registering.add_arguments(parser)
    composing.add_arguments(parser, str(_WIDTH_PX))
    parser.add_argument("--mosaic", type=Path, metavar="MOSAIC.json", help="also write the solved project")


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.workers import thread_pool
    from fullsphere.mosaic.stitch import solve
    from fullsphere.mosaic.store import save_mosaic

    options = registering.check_arguments(args)
    wanted = composing.check_arguments(args, _WIDTH_PX)
    composing.check_outputs(args, [args.output, args.mosaic], registering.inputs_of(args))
    with thread_pool(args.threads) as executor:
        frames, (cameras, covariances) = registering.gather(args, executor)
        with registering.told_of_frames(frames):
            mosaic = solve(frames, cameras, executor, console.progress(args), options, covariances)
        if args.mosaic:
            save_mosaic(args.mosaic, mosaic, args.overwrite)
        written = rendering.write_panorama(args.output, mosaic, wanted, executor, args)
    left_out = registering.warn(mosaic)
    rendering.warn(written)
    summary = {"panorama": str(args.output), **registering.summary(mosaic), **rendering.summary(written)}
    said = [*registering.lines(args.output, mosaic), f"  {rendering.described(written)}"]
    console.report(args, summary, said)
    return console.done(args, with_warnings=left_out)
