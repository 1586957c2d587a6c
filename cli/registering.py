"""What `register` and `stitch` share: the frames, the cameras, and how to register them."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console, messages
from fullsphere.cli.calibrating import (
    AUTO,
    USUAL_LENS,
    Measured,
    add_lens_arguments,
    calibrated,
    check_lens,
    is_table,
    measure_photos,
    target_file,
)
from fullsphere.cli.levelling import add_level_arguments, levelling_of

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from fullsphere.model.camera import Camera
    from fullsphere.model.lens import FloatArray
    from fullsphere.mosaic.options import Options
    from fullsphere.mosaic.project import Frame, Mosaic


PTO = ".pto"
"""How the name of a Hugin project ends."""


class Cameras(NamedTuple):
    """The cameras of the frames, None where they are to be found, and the covariance of each one's values if known."""

    cameras: tuple[Camera, ...] | None
    covariances: tuple[FloatArray | None, ...] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the frames and everything that says how to register them."""
    parser.add_argument(
        "frames", nargs="+", type=Path, metavar="FRAME", help="pictures taken from one place (JPEG, PNG, TIFF, EXR)"
    )
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument(
        "--camera",
        action="append",
        type=Path,
        metavar="CAMERA.json",
        help="the calibrated camera, twice for the two of --dual; without it the lens is found from the frames",
    )
    lens.add_argument(
        "--calibrate",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="calibrate first: from photos of a --target, or from one CSV of known 3D points and their pixels",
    )
    add_lens_arguments(
        parser,
        auto="auto: with --calibrate all kinds are compared, else two",
        default=None,
        usual=f"with --calibrate {USUAL_LENS}, else auto",
    )
    parser.add_argument(
        "--refine", action="store_true", help="adjust a calibrated camera too, held by what its calibration knows"
    )
    parser.add_argument(
        "--order",
        choices=("any", "ring", "sweep"),
        default="any",
        help="how many frames follow one another: not at all, in a closed turn, or along a path (default: %(default)s)",
    )
    parser.add_argument("--dual", action="store_true", help="each picture holds the circles of two lenses side by side")
    parser.add_argument(
        "--brackets",
        type=console.brackets_of,
        metavar="N",
        help="so many pictures at a time are exposures of one position and merged to light (HDR); "
        "auto: told by the exposures that the camera noted",
    )
    parser.add_argument(
        "--mask",
        type=Path,
        metavar="FILE",
        help="white where frames count: one picture for all, or a folder with NAME_mask.png for single ones",
    )
    parser.add_argument(
        "--prior", type=Path, metavar="CSV", help="angles told beforehand: name,yaw_deg,pitch_deg[,roll_deg]"
    )
    add_level_arguments(parser)


def check_arguments(args: argparse.Namespace) -> Options:
    """What is asked of the registration; UsageError where options do not go together, before anything long begins."""
    from fullsphere.model.errors import UsageError
    from fullsphere.mosaic.options import Options

    if args.lens is None:
        args.lens = USUAL_LENS if args.calibrate else AUTO
    check_lens(args)
    if args.target and not args.calibrate:
        raise UsageError("--target says what is in the photos of --calibrate; give those too")
    if args.target and is_table(args.calibrate):
        raise UsageError("--target is for photos; a table of points holds its target's coordinates itself")
    if args.refine and not (args.camera or args.calibrate):
        raise UsageError("--refine adjusts a calibrated camera; give one with --camera or --calibrate")
    if args.dual and args.calibrate:
        raise UsageError("--dual has two cameras; calibrate each with 'fullsphere calibrate' and give both (--camera)")
    if len(args.camera or ()) > (2 if args.dual else 1):
        raise UsageError("--camera is given once, or twice with --dual: one for each circle")
    return Options(
        order=args.order,
        levelling=levelling_of(args),
        lens=args.lens,
        refine=args.refine,
    )


def inputs_of(args: argparse.Namespace) -> list[Path]:
    """Every file that is read, none of which may be written over."""
    others = [path for path in (args.mask, args.prior) if path is not None]
    return [*args.frames, *(args.camera or []), *(args.calibrate or []), *target_file(args), *others]


def gather(args: argparse.Namespace, executor: Executor) -> tuple[list[Frame], Cameras]:
    """The frames as they are asked for, and the cameras that took them."""
    _refuse_projects(args.frames)
    measured = measure_photos(args, args.calibrate) if args.calibrate and not is_table(args.calibrate) else None
    known = _given(args)
    size = known.cameras[0].size if known.cameras else measured.image_size if measured else None
    centre = known.cameras[0].centre if known.cameras else None
    frames = _frames(args, size, centre, executor)
    if args.calibrate:
        known = _calibrated(args, measured, frames)
    return frames, known


def _refuse_projects(paths: Sequence[Path]) -> None:
    from fullsphere.model.errors import UsageError

    for path in paths:
        if path.suffix.lower() == PTO:
            raise UsageError(f"{path}: a Hugin project is for 'fullsphere register', and has no other frames beside it")


def _given(args: argparse.Namespace) -> Cameras:
    from fullsphere.model.store import load_camera, load_covariance
    from fullsphere.mosaic.frame_camera import frame_camera

    if not args.camera:
        return Cameras(None)
    paths = [*args.camera, *args.camera][: 2 if args.dual else 1]  # one file may stand for both circles
    cameras, covariances = [], []
    for path in paths:
        camera, covariance = load_camera(path), load_covariance(path)
        scaled = camera if args.dual else frame_camera(camera, args.frames)
        if scaled.size != camera.size:
            messages.warn(f"{path}: is for {_by(camera.size)} pixels and was scaled to the frames' {_by(scaled.size)}")
            covariance = None if covariance is None else _scaled(covariance, camera, scaled)
        cameras.append(scaled)
        covariances.append(covariance)
    return Cameras(tuple(cameras), tuple(covariances))


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _scaled(covariance: FloatArray, camera: Camera, scaled: Camera) -> FloatArray:
    """The covariance of values of which those in pixels have grown with the picture."""
    import numpy as np

    factor = scaled.size[0] / camera.size[0]
    grown = np.array([factor if name.endswith("_px") else 1.0 for name in camera.parameter_names])
    return np.asarray(covariance * grown * grown[:, None])


def _frames(
    args: argparse.Namespace, size: tuple[int, int] | None, centre: tuple[float, float] | None, executor: Executor
) -> list[Frame]:
    from fullsphere.mosaic.dual import open_dual_frames
    from fullsphere.mosaic.frames import open_frames
    from fullsphere.mosaic.masks import open_masks
    from fullsphere.mosaic.priors import read_priors, with_priors

    brackets = console.brackets_in(args, args.frames, positions=1 if args.dual else 2)
    masks = open_masks(args.mask) if args.mask else None
    priors = read_priors(args.prior) if args.prior else None
    progress = console.progress(args)
    if args.dual:
        frames = open_dual_frames(args.frames, size, executor, progress, masks=masks, brackets=brackets)
    else:
        frames = open_frames(args.frames, size, executor, progress, centre_px=centre, masks=masks, brackets=brackets)
    console.say_brackets(args, frames)
    turned = sum(frame.turned > 0 for frame in frames)
    if turned:
        messages.warn(f"{console.counted(turned, 'frame')} with exchanged sides turned back to the others'")
    return frames if priors is None else with_priors(frames, priors, args.prior)


def _calibrated(args: argparse.Namespace, measured: Measured | None, frames: Sequence[Frame]) -> Cameras:
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
    camera = calibration.within(measured.circle).within(common_circle(good)).camera
    return Cameras((camera,), (calibration.covariance,))


@contextlib.contextmanager
def told_of_frames(frames: Sequence[Frame]) -> Iterator[None]:
    """Say of each frame what is wrong with it, if no mosaic comes of them."""
    from fullsphere.model.errors import GeometryError, InputError
    from fullsphere.mosaic.unusable import what_is_wrong

    try:
        yield
    except GeometryError:
        for frame in frames:
            with contextlib.suppress(InputError):  # a file that has gone since
                wrong = "" if frame.reason else what_is_wrong(frame.load())
                if wrong:
                    messages.warn(f"{frame.id} {wrong}")
        _warn_of_left_out(frames)
        raise


def warn(mosaic: Mosaic) -> bool:
    """Say which frames were left out and what is wrong with the set; whether frames were."""
    left_out = _warn_of_left_out([frame for frame in mosaic.frames if not frame.registered])
    for sentence in mosaic.diagnosis:
        messages.warn(sentence)
    return left_out


def _warn_of_left_out(frames: Sequence[Frame]) -> bool:
    for frame in frames:
        if frame.reason:
            messages.warn(f"{frame.id} is left out: {frame.reason}")
    return any(frame.reason for frame in frames)


def summary(mosaic: Mosaic) -> dict[str, Any]:
    """What programs want to know."""
    return {
        "frames": len(mosaic.frames),
        "registered": len(mosaic.registered),
        "left_out": {frame.id: frame.reason for frame in mosaic.frames if not frame.registered},
        "sigma_deg": {frame.id: frame.sigma_deg for frame in mosaic.registered},
        "level": mosaic.level,
        "self_calibrated": mosaic.self_calibrated,
        "diagnosis": list(mosaic.diagnosis),
        **mosaic.quality,
    }


def lines(output: Path, mosaic: Mosaic) -> list[str]:
    """What people want to know."""
    import numpy as np

    quality = mosaic.quality
    said = [
        f"{output}: {len(mosaic.registered)} of {len(mosaic.frames)} frames, {quality['matches']} matches agree to "
        f"{quality['residual_median_px']:.2f} px (median)",
    ]
    if quality.get("held_out_matches"):
        said.append(
            f"  {quality['held_out_matches']} matches that no fit saw agree to {quality['held_out_median_px']:.2f} px "
            f"({100 * quality['held_out_share']:.0f} % of all such)"
        )
    sigma = [frame.sigma_deg for frame in mosaic.registered if frame.sigma_deg is not None]
    if sigma:
        said.append(f"  orientations known to {np.median(sigma):.2g} degrees, the worst to {max(sigma):.2g}")
    tilt = quality.get("level_sigma_deg")
    said.append(f"  level by: {mosaic.level}" + ("" if tilt is None else f" (to {tilt:.2g} degrees)"))
    if mosaic.self_calibrated:
        fields = ", ".join(f"{2 * np.degrees(camera.half_fov):.1f}" for camera in mosaic.cameras)
        said.append(f"  lens found from the frames: {mosaic.camera.lens.projection}, field of view {fields} degrees")
    return said
