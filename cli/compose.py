"""`fullsphere compose`: mosaic.json -> the panorama of its frames."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fullsphere.cli import composing, console, rendering

if TYPE_CHECKING:
    from fullsphere.mosaic.project import Mosaic

EPILOG = """\
examples:
  fullsphere compose mosaic.json -o pano.tif                    as large as the frames resolve, in their depth
  fullsphere compose mosaic.json -o pano.jpg --size 8192
  fullsphere compose mosaic.json -o view.png --to perspective:1920x1080:hfov=90:yaw=30
  fullsphere compose mosaic.json -o planet.jpg --to littleplanet:2048
  fullsphere compose mosaic.json --frames NEW_*.jpg -o next.tif  the next turn of the same head
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("mosaic", type=Path, metavar="MOSAIC.json", help="what 'register' or 'stitch --mosaic' wrote")
    parser.add_argument(
        "--frames",
        nargs="+",
        type=Path,
        metavar="NEW",
        help="new pictures of the same rig and positions instead of the registered ones, in their order",
    )
    parser.add_argument(
        "--brackets",
        type=console.brackets_of,
        metavar="N",
        help="so many of --frames at a time are exposures of one position; auto: by what the camera noted",
    )
    composing.add_arguments(parser, composing.AUTO)


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.errors import UsageError
    from fullsphere.model.workers import thread_pool
    from fullsphere.mosaic.store import load_mosaic

    if args.brackets and not args.frames:
        raise UsageError("--brackets is about the new pictures of --frames; what a mosaic is merged of stands in it")
    wanted = composing.check_arguments(args, None)
    mosaic = load_mosaic(args.mosaic)
    composing.check_frames(mosaic, args.mosaic, args.frames or ())
    inputs = [args.mosaic, *composing.files_of(mosaic, args.frames or ())]
    composing.check_outputs(args, [args.output], inputs)
    with thread_pool(args.threads) as executor:
        if args.frames:
            from fullsphere.mosaic.reuse import with_pictures

            console.say(args, f"measuring the light of {console.counted(len(args.frames), 'new picture')}")
            brackets = console.brackets_in(args, args.frames, positions=1)
            mosaic = with_pictures(mosaic, args.frames, executor, brackets)
            console.say_brackets(args, mosaic.frames)
        written = rendering.write_panorama(args.output, mosaic, wanted, executor, args)
    rendering.warn(written)
    console.report(args, _summary(args, mosaic, written), [f"{args.output}: {rendering.described(written)}"])
    return console.done(args, with_warnings=False)


def _summary(args: argparse.Namespace, mosaic: Mosaic, written: rendering.Written) -> dict[str, object]:
    return {"panorama": str(args.output), "frames": len(mosaic.registered), **rendering.summary(written)}
