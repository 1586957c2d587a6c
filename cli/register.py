"""`fullsphere register`: frames of a rotating camera -> mosaic.json with their orientations."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fullsphere.cli import console, messages, registering

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from fullsphere.mosaic.options import Options
    from fullsphere.mosaic.project import Mosaic

EPILOG = """\
examples:
  fullsphere register IMG_*.jpg -o mosaic.json                          the lens is found from the frames themselves
  fullsphere register IMG_*.jpg -o mosaic.json --camera camera.json     with a lens calibrated before
  fullsphere register IMG_*.jpg -o mosaic.json --save-camera found.json keeps the lens that was found, for other sets
  fullsphere register R00*.jpg --dual -o mosaic.json                    both circles of a dual-fisheye camera
  fullsphere register project.pto -o mosaic.json                        from a Hugin project
  fullsphere register IMG_*.jpg -o project.pto                          to go on in Hugin
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    registering.add_arguments(parser)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="MOSAIC", help="mosaic.json to write, or Hugin's .pto"
    )
    parser.add_argument(
        "--save-camera", type=Path, metavar="CAMERA.json", help="also write the camera that was found or refined"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html", help="also write a page about the mosaic: frames, links, residuals"
    )


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.errors import UsageError
    from fullsphere.model.files import check_output
    from fullsphere.model.workers import thread_pool

    options = registering.check_arguments(args)
    if args.save_camera and args.dual:
        raise UsageError("--save-camera writes one camera, and --dual has two; they are both in mosaic.json")
    for output in filter(None, (args.output, args.save_camera)):
        check_output(output, args.overwrite, registering.inputs_of(args))
    if args.report:
        from fullsphere.cli.page import check_page

        check_page(args.report, args.overwrite, registering.inputs_of(args))
    with thread_pool(args.threads) as executor:
        mosaic = _project(args, options, executor) if _is_project(args) else _registered(args, options, executor)
    said = [*registering.lines(args.output, mosaic), *_written(args, mosaic)]
    left_out = registering.warn(mosaic)
    console.report(args, {"mosaic": str(args.output), **registering.summary(mosaic)}, said)
    return console.done(args, with_warnings=left_out)


def _registered(args: argparse.Namespace, options: Options, executor: Executor) -> Mosaic:
    from fullsphere.mosaic.stitch import solve

    frames, (cameras, covariances) = registering.gather(args, executor)
    with registering.told_of_frames(frames):
        return solve(frames, cameras, executor, console.progress(args), options, covariances)


def _is_project(args: argparse.Namespace) -> bool:
    return len(args.frames) == 1 and args.frames[0].suffix.lower() == registering.PTO


def _project(args: argparse.Namespace, options: Options, executor: Executor) -> Mosaic:
    """A Hugin project's pictures with its lenses, or its control points where it has no pictures here."""
    from fullsphere.model.errors import UsageError
    from fullsphere.mosaic.control_points import register_points
    from fullsphere.mosaic.frames import refuse_if_fewer
    from fullsphere.mosaic.pto import read_pto
    from fullsphere.mosaic.register import register

    if args.camera or args.calibrate or args.dual or args.mask or args.prior or args.brackets:
        raise UsageError("a .pto tells its cameras, circles, masks and angles itself; give its pictures to tell others")
    path = args.frames[0]
    project = read_pto(path)
    for note in project.notes:
        messages.warn(note if note.startswith(f"{path}: ") else f"{path}: {note}")
    if len(project.missing) == len({frame.image for frame in project.frames}):
        messages.warn(
            f"{path}: none of its {len(project.missing)} pictures is here ({project.missing[0]} ...); its control "
            "points are adjusted alone"
        )
        return register_points(project)
    project = project.opened(executor, console.progress(args))
    refuse_if_fewer(project.frames, 2, f"{path}: a mosaic needs at least two frames")
    cameras = project.cameras if project.calibrated else None
    with registering.told_of_frames(project.frames):
        return register(project.frames, cameras, executor, console.progress(args), options)


def _written(args: argparse.Namespace, mosaic: Mosaic) -> list[str]:
    """Write what was asked for; say what is to be said of it."""
    from fullsphere.mosaic.found_camera import save_found_camera
    from fullsphere.mosaic.pto_write import write_pto
    from fullsphere.mosaic.store import save_mosaic

    said = []
    if args.output.suffix.lower() == registering.PTO:
        errors = write_pto(args.output, mosaic, args.overwrite)
        said.append(f"  Hugin's lens follows the camera to {max(errors.values(), default=0.0):.2f} px")
    else:
        save_mosaic(args.output, mosaic, args.overwrite)
    if args.save_camera:
        save_found_camera(args.save_camera, mosaic, args.overwrite)
    if args.report:
        from fullsphere.cli.mosaic_page import page_of_mosaic
        from fullsphere.cli.page import write_page

        write_page(args.report, page_of_mosaic(args.output.name, mosaic), args.overwrite)
        said.append(f"  report: {args.report}")
    return said
