"""`fullsphere remap`: pictures, or raw video frames, from any projection to any other."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console, messages
from fullsphere.cli.remap_source import crop, scale
from fullsphere.cli.viewer_metadata import viewer_metadata
from fullsphere.model.projection_help import PROJECTIONS_HELP

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.cli.remap_batch import Outcome
    from fullsphere.model.camera import Projection
    from fullsphere.model.remap import Remapper

EPILOG = f"""\
projections:
{PROJECTIONS_HELP}
examples:
  fullsphere remap fisheye.jpg --from camera.json --to equirectangular:4096 -o sphere.tif
  fullsphere remap sphere.tif --from equirectangular:4096 --to camera.json -o fisheye.png
  fullsphere remap sphere.tif --from equirectangular:4096 --to perspective:1920x1080:hfov=90:yaw=30 -o view.jpg
  fullsphere remap shots/ --from camera.json --to cube:1024 -o cubes/ --format png
  ffmpeg -v error -i in.mp4 -f rawvideo -pix_fmt rgb24 - |
    fullsphere remap - --raw 3000x3000:rgb24 --from camera.json --to equirectangular:4096 -o - |
    ffmpeg -f rawvideo -pix_fmt rgb24 -s 4096x2048 -r 25 -i - out.mp4
"""

_INPUT_EXIT = 3
_KEPT_BYTES = 1 << 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "pictures", nargs="+", metavar="PICTURE", help="pictures to resample, or folders of them; - for --raw"
    )
    parser.add_argument("--from", dest="source", required=True, metavar="PROJECTION", help="what the pictures are")
    parser.add_argument("--to", dest="target", required=True, metavar="PROJECTION", help="what to make of them")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="picture to write: .tif, .exr, .png or .jpg; for several pictures a folder (out/); - for --raw",
    )
    _add_sampling_arguments(parser.add_argument_group("sampling"))
    source = parser.add_argument_group("where the pictures are not as the camera's were; applied in the order given")
    source.add_argument(
        "--scale",
        dest="changes",
        action="append",
        type=scale,
        metavar="K",
        help="the pictures are K times as wide and high as those that camera.json was made from: 0.5, or 1/3",
    )
    source.add_argument(
        "--crop",
        dest="changes",
        action="append",
        type=crop,
        metavar="LEFT,TOP,WIDTHxHEIGHT",
        help="they are this rectangle of those, in pixels",
    )
    _add_output_arguments(parser.add_argument_group("output"))


def _add_sampling_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--interpolation",
        choices=("nearest", "linear", "cubic", "lanczos3"),
        default="cubic",
        help="between the pixels of the source (default: %(default)s)",
    )
    group.add_argument(
        "--no-antialias",
        action="store_true",
        help="do not average over the source where the target is coarser: quicker, with jagged detail",
    )
    group.add_argument(
        "--linear-light",
        action="store_true",
        help="average light instead of its sRGB codes: right for small bright lights, and slower",
    )


def _add_output_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--format",
        choices=("tif", "exr", "png", "jpg"),
        help="of the pictures in a folder (default: that of each source; .tif where it cannot be written)",
    )
    group.add_argument("--no-alpha", action="store_true", help="leave out the alpha that says which pixels were seen")
    console.add_compression(group)
    group.add_argument(
        "--raw",
        metavar="WxH:PIXELS",
        help="raw video frames of this size from standard input to standard output, in rgb24, bgr24, rgba, gray, "
        "gray16le or rgb48le as ffmpeg names them",
    )
    group.add_argument(
        "--memory",
        type=console.bytes_of,
        default=_KEPT_BYTES,
        metavar="SIZE",
        help="what may be used to keep the geometry from picture to picture, 500MB for example (default: 1GB)",
    )


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    if args.raw:
        return _run_raw(args)
    return _run_pictures(args)


class _Way(NamedTuple):
    source: Projection
    target: Projection
    target_from_source: NDArray[np.float64]


def _way(args: argparse.Namespace) -> _Way:
    from fullsphere.cli.remap_source import changed
    from fullsphere.model.projection_text import parse_projection

    source, target = parse_projection(args.source), parse_projection(args.target)
    return _Way(
        changed(source.projection, args.changes or (), args.source),
        target.projection,
        target.world_from_projection.T @ source.world_from_projection,
    )


def _remapper(args: argparse.Namespace, way: _Way, kept_bytes: int, executor: Executor) -> Remapper:
    from fullsphere.model.remap import Remapper

    return Remapper(
        *way,
        args.interpolation,
        antialias=not args.no_antialias,
        linear_light=args.linear_light,
        kept_bytes=kept_bytes,
        executor=executor,
    )


def _run_pictures(args: argparse.Namespace) -> int:
    from fullsphere.cli.remap_batch import BAND_ROWS, Work, is_folder, outputs_of, planned, remap_many, remap_one
    from fullsphere.cli.remap_source import check_size
    from fullsphere.model.errors import UsageError
    from fullsphere.model.workers import thread_pool

    if "-" in (*args.pictures, args.output):
        raise UsageError("- is for raw frames: say with --raw WxH:PIXELS, such as 3000x3000:rgb24, what they are")
    way = _way(args)
    jobs = planned([Path(name) for name in args.pictures], args.output, args.format)
    progress = console.progress(args)
    several = len(jobs) > 1
    with outputs_of(jobs, args.overwrite, is_folder(args.output)), thread_pool(args.threads) as executor:
        work = Work(
            _remapper(args, way, args.memory if several else 0, executor),
            lambda name, size: check_size(name, size, way.source, args.source, args.changes or ()),
            viewer_metadata(way.target),
            not args.no_alpha,
            args.compression,
            args.overwrite,
        )
        if several:
            outcomes = []
            for outcome in progress(remap_many(jobs, work, args.threads), title="remapping", total=len(jobs)):
                if outcome.fault:
                    messages.warn(outcome.fault)
                outcomes.append(outcome)
        else:
            bands = -(-way.target.size[1] // BAND_ROWS)
            outcomes = [remap_one(jobs[0], work, lambda items: progress(items, title="remapping", total=bands))]
    return _report(args, way.target.size, outcomes)


def _report(args: argparse.Namespace, size: tuple[int, int], outcomes: list[Outcome]) -> int:
    done = [outcome for outcome in outcomes if not outcome.fault]
    failed = [outcome for outcome in outcomes if outcome.fault]
    summary = {
        "size_px": list(size),
        "pictures": [{"picture": str(x.job.picture), "output": str(x.job.output), "seen": x.seen} for x in done],
        "left_out": {str(x.job.picture): x.fault for x in failed},
    }
    what = f"{size[0]} x {size[1]} pixels"
    lines = [f"{x.job.output}: {what}, {100 * x.seen:.1f} % of them seen" for x in done]
    if len(outcomes) > 1:
        of_all = f"{len(done)} of {len(outcomes)}" if failed else str(len(done))
        lines = [f"{outcomes[0].job.output.parent}: {of_all} pictures of {what}"]
    console.report(args, summary, lines)
    if not failed:
        return 0
    messages.error(
        f"{len(failed)} of {len(outcomes)} pictures could not be remapped: {failed[0].job.picture}"
        f"{' and others, named above' if len(failed) > 1 else ''}"
    )
    return _INPUT_EXIT


def _run_raw(args: argparse.Namespace) -> int:
    from fullsphere.cli.remap_raw import STDIN, remap_frames
    from fullsphere.cli.remap_source import check_size
    from fullsphere.model.coverage import with_channels
    from fullsphere.model.raw_frames import parse_raw_format
    from fullsphere.model.workers import thread_pool

    _check_raw(args)
    form = parse_raw_format(args.raw)
    way = _way(args)
    check_size(STDIN, form.size, way.source, args.source, args.changes or ())
    becomes = form.resized(way.target.size)
    console.say(args, f"frames of {form} become {becomes}")
    progress = console.progress(args)
    with thread_pool(args.threads) as executor:
        remapper = _remapper(args, way, args.memory, executor)

        def remapped(frame: NDArray[Any]) -> NDArray[Any]:
            pixels, weight = remapper(frame)
            return with_channels(pixels, weight, form.channels) if form.channels == 4 else pixels

        count = remap_frames(form, becomes, remapped, lambda frames: progress(frames, title="remapping frames"))
    done = {"frames": count, "raw": str(becomes), "size_px": list(becomes.size)}
    messages.note(json.dumps(done, sort_keys=True) if args.json else f"{console.counted(count, 'frame')} of {becomes}")
    return 0  # said on standard error, because the frames are on standard output


def _check_raw(args: argparse.Namespace) -> None:
    from fullsphere.model.errors import UsageError

    if args.pictures != ["-"] or args.output != "-":
        raise UsageError("--raw is for frames from standard input to standard output: PICTURE is -, and -o -")
    others = {"--format": args.format, "--compression": args.compression, "--no-alpha": args.no_alpha}
    for option, given in others.items():
        if given:
            raise UsageError(f"{option} is for picture files, not for the raw frames of --raw")
    if os.isatty(1):
        raise UsageError("raw frames are nothing for a terminal: lead them on with | or >")
