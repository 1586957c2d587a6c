"""`fullsphere omnistereo`: frames of a camera on a turning arm -> the 360 x 360 mosaic, both eyes, range."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console, messages, omnistereo_files

if TYPE_CHECKING:
    from fullsphere.model.camera import Camera
    from fullsphere.model.lens import FloatArray
    from fullsphere.mosaic.arm import ArmTurn
    from fullsphere.mosaic.omnistereo import Omnistereo
    from fullsphere.mosaic.project import Frame

EPILOG = """\
examples:
  fullsphere omnistereo TURN_*.jpg --camera camera.json -o mosaic360.tif
  fullsphere omnistereo TURN_*.jpg --camera camera.json --left left.jpg --right right.jpg --size 8192
  fullsphere omnistereo TURN_*.jpg --camera camera.json --over-under scene_TB.jpg          for VR viewers
  fullsphere omnistereo TURN_*.jpg --camera camera.json --arm 0.15 --depth depth.exr       range in metres
  fullsphere omnistereo TURN_*.jpg --camera camera.json --angles even -o mosaic360.tif     a motor's even steps

The camera stands at the end of an arm and looks outward along it, through a lens of more than 180 degrees. Rows of the
mosaic are the circle of rays at right angles to its axis, columns the turn of the arm; docs/omnistereo.md tells more.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("frames", nargs="+", type=Path, metavar="FRAME", help="pictures of one full turn, in order")
    parser.add_argument(
        "--camera", type=Path, required=True, metavar="CAMERA.json", help="the calibrated lens: 'fullsphere calibrate'"
    )
    turn = parser.add_argument_group("turn")
    turn.add_argument(
        "--angles",
        default="auto",
        metavar="auto|even|FILE",
        help="turn angles: found in the frames (default), even steps round a full turn, or a text file of a file name "
        "and degrees a line",
    )
    turn.add_argument(
        "--direction",
        choices=("right", "left"),
        help="which way the arm turned, for --angles even (default: right)",
    )
    turn.add_argument(
        "--mount",
        choices=("auto", "straight"),
        default="auto",
        help="yaw, pitch and roll of the camera on its arm: found in the frames, or none (default: %(default)s)",
    )
    turn.add_argument(
        "--arm", type=_length, default=1.0, metavar="LENGTH", help="from the axis to the lens: the unit of --depth"
    )
    omnistereo_files.add_arguments(parser.add_argument_group("results, at least one"))


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.errors import UsageError
    from fullsphere.model.workers import thread_pool
    from fullsphere.mosaic.omnistereo import omnistereo, pictures_for
    from fullsphere.mosaic.turn_frames import open_turn
    from fullsphere.mosaic.whole_turn import whole_turn

    if args.direction and args.angles != "even":
        raise UsageError("--direction is for --angles even; angles found or told in a file have their sign")
    camera = _camera(args)
    told = [] if args.angles in ("auto", "even") else [Path(args.angles)]
    omnistereo_files.check(args, camera, [*args.frames, args.camera, *told])
    with thread_pool(args.threads) as executor:
        frames = open_turn(args.frames, camera.size)
        usable = [frame for frame in frames if not frame.reason]
        room_bytes = omnistereo_files.room_bytes(args, camera, usable)
        pictures = pictures_for(camera, usable, room_bytes)
        progress, straight = console.progress(args), args.mount == "straight"
        frames, turn = whole_turn(frames, camera, pictures, _told(args, frames), straight, executor, progress)
        with omnistereo_files.room(args, room_bytes - pictures.kept_bytes) as room:
            dtype = omnistereo_files.samples(args, turn.frames[0])
            made = omnistereo(turn, args.size, executor, pictures=pictures, dtype=dtype, progress=progress, room=room)
            written = omnistereo_files.write(args, turn, made)
    left_out = _warn(frames, turn, made)
    console.report(args, _summary(frames, turn, made, written), _lines(turn, made, written))
    return console.done(args, with_warnings=left_out)


def _length(text: str) -> float:
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not 0 < length < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no length")
    return length


def _camera(args: argparse.Namespace) -> Camera:
    """The camera, scaled to the frames if they are a scaled copy of what it is for."""
    from fullsphere.model.store import load_camera
    from fullsphere.mosaic.frame_camera import frame_camera
    from fullsphere.mosaic.omnistereo import refuse_narrow

    camera = load_camera(args.camera)
    refuse_narrow(camera)
    scaled = frame_camera(camera, args.frames)
    if scaled.size != camera.size:
        (width, height), (own_width, own_height) = camera.size, scaled.size
        messages.warn(
            f"{args.camera}: is for {width} x {height} pixels and was scaled to the frames' {own_width} x {own_height}"
        )
    return scaled


def _told(args: argparse.Namespace, frames: Sequence[Frame]) -> FloatArray | None:
    """The turn angles (n,) of the frames, if they are told."""
    from fullsphere.mosaic.turn_frames import even_angles, read_angles

    if args.angles == "auto":
        return None
    if args.angles == "even":
        return even_angles(frames, args.direction != "left")
    return read_angles(Path(args.angles), frames)


def _warn(frames: Sequence[Frame], turn: ArmTurn, made: Omnistereo) -> bool:
    """Say what was left out, and what is wrong with the turn; whether frames were left out."""
    left_out = [frame for frame in frames if frame.reason]
    for frame in left_out:
        messages.warn(f"{frame.id} is left out: {frame.reason}")
    for sentence in turn.diagnosis:
        messages.warn(sentence)
    unseen = 1 - float(made.seen.mean(dtype=float))
    if unseen > 0:
        messages.warn(
            f"{100 * unseen:.2g} % of the mosaic is seen by no frame: between frames that lie too far apart, or where "
            "the tilted lens does not reach 90 degrees"
        )
    return bool(left_out) or len(turn.frames) < len(frames)


def _summary(frames: Sequence[Frame], turn: ArmTurn, made: Omnistereo, written: dict[str, str]) -> dict[str, Any]:
    """What programs want to know."""
    import numpy as np

    from fullsphere.mosaic.arm import mount_angles

    assert turn.sigmas is not None
    return {
        "frames": len(frames),
        "left_out": {frame.id: frame.reason for frame in frames if frame.reason},
        "angles_deg": {f.id: round(float(np.degrees(a)), 5) for f, a in zip(turn.frames, turn.angles, strict=True)},
        "angle_sigma_deg": float(np.degrees(turn.sigmas).max()),
        "mount_deg": dict(zip(_MOUNT, np.degrees(mount_angles(turn.mount)).tolist(), strict=True)),
        "mount_sigma_deg": dict(zip(_MOUNT, np.degrees(turn.mount_sigmas).tolist(), strict=True)),
        "size_px": list(made.codes.shape[1::-1]),
        "seen": float(made.seen.mean(dtype=float)),
        "diagnosis": list(turn.diagnosis),
        "written": written,
        **{name: value if math.isfinite(value) else None for name, value in turn.quality.items()},
    }


_MOUNT = ("yaw", "pitch", "roll")


def _lines(turn: ArmTurn, made: Omnistereo, written: dict[str, str]) -> list[str]:
    """What people want to know."""
    import numpy as np

    from fullsphere.mosaic.arm import mount_angles

    assert turn.sigmas is not None
    steps = np.degrees(turn.gaps)
    said = [f"{path}: {what}" for path, what in written.items()]
    sigma = f", each known to {np.degrees(turn.sigmas).max():.2g}" if turn.sigmas.any() else ""
    said.append(
        f"  {len(turn.frames)} frames, {np.median(steps):.3g} degrees apart ({steps.min():.3g} to {steps.max():.3g})"
        f"{sigma}"
    )
    held = zip(_MOUNT, np.degrees(mount_angles(turn.mount)), np.degrees(turn.mount_sigmas), strict=True)
    if turn.mount_sigmas.any():
        said.append("  camera on the arm: " + ", ".join(f"{n} {a:.2f} +- {s:.2g}" for n, a, s in held) + " degrees")
    flicker = float(np.log2(made.gains).std())
    said.append(f"  light of the frames evened out: {flicker:.3f} EV rms")
    return said
