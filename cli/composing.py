"""What `compose` and `stitch` share: what the panorama is to be, by their options."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console

if TYPE_CHECKING:
    import numpy as np

    from fullsphere.model.projection_text import Placed
    from fullsphere.mosaic.project import Mosaic
    from fullsphere.mosaic.reference import Exposure

AUTO = "auto"
PREVIEW_PX = 1024

DTYPES = {"8": "uint8", "16": "uint16", "half": "float16", "float": "float32"}
_MEMORY = 2 * 10**9
_JPEG = (".jpg", ".jpeg")


class Wanted(NamedTuple):
    """What the panorama is to be, by the options.

    Attributes
    ----------
    target
        The surface and how it stands; None for a whole sphere that is as wide as its frames resolve.
    exposure, blend, compression
        As `parse_exposure`, `planned` and `open_panorama` take them.
    dtype
        Type of the samples; None for that of the frames, as far as the format holds it.
    resume
        Keep finished bands, and go on with those of a run that was killed.
    fill
        Whether what nobody sees is filled.
    layers
        Folder for the single frames; None for none.
    memory
        Bytes that the run may take.
    preview
        A quick look is enough.
    hide_turning
        Whether what turns with the camera is hidden.
    report
        The page about it to write; None for none.
    """

    target: Placed | None
    exposure: Exposure
    blend: Any
    dtype: np.dtype[Any] | None
    compression: str | None = None
    resume: bool = False
    fill: bool = False
    layers: Path | None = None
    memory: int = _MEMORY
    preview: bool = False
    hide_turning: bool = True
    report: Path | None = None


def add_arguments(parser: argparse.ArgumentParser, width: str) -> None:
    """Declare what the panorama is to be; `width` is the default of --size."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="PANO",
        help="panorama to write: .tif, .exr, .png or .jpg",
    )
    group = parser.add_argument_group("panorama")
    surface = group.add_mutually_exclusive_group()
    surface.add_argument(
        "--size",
        type=_width,
        metavar="WIDTH",
        help="width of the whole sphere in pixels, even, or auto: as many as the frames resolve on their axes "
        f"(default: {width})",
    )
    surface.add_argument(
        "--to",
        metavar="PROJECTION",
        help="another surface with its size, as 'fullsphere remap' spells it: perspective:1920x1080:hfov=90:yaw=30, "
        "cube:1024, littleplanet:2048, cylindrical:4096:lat=-40..40",
    )
    surface.add_argument(
        "--preview",
        action="store_true",
        help=f"a quick look: the sphere {PREVIEW_PX} pixels wide (less for many or small frames), frames mixed softly",
    )
    group.add_argument(
        "--exposure",
        default=AUTO,
        metavar="auto|none|FRAME",
        help="how bright: auto keeps the frames' mean and their highlights; a frame, by name or number, keeps its own; "
        "none evens nothing out (default: auto)",
    )
    group.add_argument(
        "--blend",
        choices=("multiband", "feather"),
        default="multiband",
        help="seams where frames agree, or all frames mixed softly (default: %(default)s)",
    )
    group.add_argument(
        "--depth",
        choices=tuple(DTYPES),
        help="bits of a sample, or floats of linear light (default: what the frames have and the format holds)",
    )
    console.add_compression(group)
    group.add_argument(
        "--nadir",
        choices=("leave", "fill"),
        default="leave",
        help="what nobody sees: left transparent, or continued smoothly from around it (default: %(default)s)",
    )
    group.add_argument(
        "--turning",
        choices=("hide", "keep"),
        default="hide",
        help="what turns with the camera, a strap or shoes, where other frames see past it (default: %(default)s)",
    )
    group.add_argument(
        "--report",
        type=Path,
        metavar="FILE.html",
        help="also write a page about the panorama: light, seams, where frames disagree, coverage",
    )
    group.add_argument(
        "--layers",
        type=Path,
        metavar="FOLDER",
        help="also write each frame remapped, with its coverage as alpha, and a mask of what it shows in the panorama",
    )
    running = parser.add_argument_group("long runs")
    running.add_argument(
        "--resume",
        action="store_true",
        help="keep finished rows beside the output until it is complete; a run that was killed goes on from them",
    )
    running.add_argument(
        "--memory",
        type=console.bytes_of,
        default=_MEMORY,
        metavar="SIZE",
        help="what the run may take, 500MB for example (default: 2GB)",
    )


def check_arguments(args: argparse.Namespace, width: int | None) -> Wanted:
    """What is wanted; UsageError where it makes no sense, before anything long begins.

    `width` is that of a whole sphere where no size was asked for; None: as the frames resolve.
    """
    import numpy as np

    from fullsphere.model.errors import UsageError
    from fullsphere.model.images import check_panorama
    from fullsphere.model.projection_text import parse_projection
    from fullsphere.mosaic.reference import parse_exposure

    if args.preview and (args.layers or args.resume or args.report or args.nadir != "leave"):
        raise UsageError(
            "--preview is only a quick look: --layers, --nadir, --report and --resume are for the panorama itself"
        )
    asked = PREVIEW_PX if args.preview else args.size or width
    target = None
    if args.to:
        target = parse_projection(args.to)
    elif asked not in (None, AUTO):
        target = whole_sphere(int(asked))
    exposure = args.exposure if args.exposure in (AUTO, "none") else f"frame {args.exposure}"
    dtype = np.dtype(DTYPES[args.depth]) if args.depth else None
    wanted = Wanted(
        target,
        parse_exposure(exposure),
        args.blend,
        dtype,
        args.compression,
        args.resume,
        args.nadir == "fill",
        args.layers,
        args.memory,
        args.preview,
        args.turning == "hide",
        args.report,
    )
    size = target.projection.size if target else (2, 1)
    check_panorama(args.output, size, 4, dtype or held(args.output, np.dtype(np.uint8)), args.compression)
    return wanted


def check_outputs(args: argparse.Namespace, outputs: Sequence[Path | None], inputs: Sequence[Path]) -> None:
    """Make sure, before the work, that the files and the page can be written; OutputError if not."""
    from fullsphere.model.files import check_output

    for output in filter(None, outputs):
        check_output(output, args.overwrite, inputs)
    if args.report:
        from fullsphere.cli.page import check_page

        check_page(args.report, args.overwrite, inputs)


def plain(width: int) -> Wanted:
    """A whole sphere with nothing else asked for."""
    from fullsphere.mosaic.reference import Exposure

    return Wanted(whole_sphere(width), Exposure(), "multiband", None)


def files_of(mosaic: Mosaic, instead: Sequence[Path] = ()) -> list[Path]:
    """The files that are read, none of which may be written over; `instead` of the registered pictures, if any."""
    masks = [Path(frame.mask_image) for frame in mosaic.registered if frame.mask_image]
    return [*(instead or [Path(image) for frame in mosaic.registered for image in frame.images]), *masks]


def check_frames(mosaic: Mosaic, path: Path, instead: Sequence[Path] = ()) -> None:
    """Make sure that there are frames to compose, and all their files; what is in them is checked when it is read.

    Raises
    ------
    InputError
        If the mosaic at `path` has no registered frame, or a file is missing.
    """
    from fullsphere.model.errors import InputError

    if not mosaic.registered:
        raise InputError(f"{path}: no frame of it is registered, so there is nothing to compose; register others")
    for name in files_of(mosaic, instead):
        if name.exists():
            continue
        if name in instead:
            raise InputError(f"{name}: there is no such file; check the name")
        raise InputError(
            f"{name}: there is no such file, and {path} needs it; put it there again, or change its place in {path}"
        )


def whole_sphere(width: int) -> Placed:
    """The whole sphere, upright; UsageError where the width is odd or out of range."""
    import numpy as np

    from fullsphere.model.projection_text import Placed
    from fullsphere.model.surface import Equirectangular

    return Placed(Equirectangular(console.panorama_size(width)), np.eye(3))


def _width(text: str) -> str:
    if text != AUTO and not (text.isdecimal() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is no width in pixels, and not auto")
    return text


def held(path: Path, dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type of samples that a format holds which is nearest to another one."""
    import numpy as np

    ending = path.suffix.lower()
    if ending in _JPEG:
        return np.dtype(np.uint8)
    if ending == ".exr":
        return np.dtype(np.float32 if dtype == np.float32 else np.float16)
    if ending == ".png":
        return np.dtype(np.uint8 if dtype == np.uint8 else np.uint16)
    return np.dtype(np.float32) if dtype.kind == "f" else dtype
