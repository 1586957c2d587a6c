"""`fullsphere remap`: one picture from a camera's projection to a full-sphere panorama, or back."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fullsphere.cli import console
from fullsphere.model.errors import InputError, UsageError

if TYPE_CHECKING:
    from fullsphere.model.camera import Projection

EPILOG = """\
A projection is a camera.json, or equirectangular:WIDTH (a full sphere, half as high as wide).

examples:
  fullsphere remap fisheye.jpg --from camera.json --to equirectangular:4096 -o sphere.tif
  fullsphere remap sphere.tif --from equirectangular:4096 --to camera.json -o fisheye.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("picture", type=Path, metavar="PICTURE", help="picture to resample")
    parser.add_argument("--from", dest="source", required=True, metavar="PROJECTION", help="what the picture is")
    parser.add_argument("--to", dest="target", required=True, metavar="PROJECTION", help="what to make of it")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="picture to write: .tif, .png or .jpg"
    )
    parser.add_argument(
        "--interpolation", choices=("nearest", "linear", "cubic"), default="cubic", help="default: %(default)s"
    )


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    import numpy as np

    from fullsphere.model.files import check_output
    from fullsphere.model.images import check_panorama, gpano, open_panorama, read_picture
    from fullsphere.model.remap import remap
    from fullsphere.model.surface import Equirectangular
    from fullsphere.model.workers import thread_pool

    source, target = parse_projection(args.source), parse_projection(args.target)
    check_output(args.output, args.overwrite, [args.picture])
    picture = read_picture(args.picture)
    height, width = picture.pixels.shape[:2]
    if (width, height) != source.size:
        raise InputError(
            f"{args.picture}: is {width} x {height} pixels, but --from {args.source} is for "
            f"{source.size[0]} x {source.size[1]}"
        )
    colour = picture.pixels[..., :3]
    if colour.shape[2] == 1:
        colour = np.repeat(colour, 3, axis=2)
    dtype = colour.dtype
    check_panorama(args.output, target.size, 4, dtype)
    with thread_pool(args.threads) as executor:
        pixels, weight = remap(np.ascontiguousarray(colour), source, target, None, args.interpolation, executor)
    full = np.iinfo(dtype).max if dtype.kind == "u" else 1
    attributes = gpano(target.size) if isinstance(target, Equirectangular) else {}
    with open_panorama(args.output, target.size, 4, dtype, attributes, args.overwrite) as writer:
        writer.write_rows(0, np.dstack([pixels, (weight * full).astype(dtype)]))
    seen = float(weight.mean())
    console.report(
        args,
        {"output": str(args.output), "size_px": list(target.size), "seen": seen},
        [f"{args.output}: {target.size[0]} x {target.size[1]} pixels, {100 * seen:.1f} % of them seen"],
    )
    return 0


def parse_projection(text: str) -> Projection:
    """A projection from its spelling on the command line.

    Raises
    ------
    UsageError
        If the spelling is none.
    InputError
        If it names a camera.json that cannot be used.
    """
    from fullsphere.model.store import load_camera
    from fullsphere.model.surface import Equirectangular

    kind, colon, rest = text.partition(":")
    if kind == "equirectangular":
        if not (colon and rest.isdecimal()):
            raise UsageError(f"{text!r}: say how wide the panorama is, as in equirectangular:4096")
        return Equirectangular(console.panorama_size(int(rest)))
    if text.endswith(".json"):
        return load_camera(Path(text))
    raise UsageError(f"{text!r} is no projection: use a camera.json, or equirectangular:WIDTH")
