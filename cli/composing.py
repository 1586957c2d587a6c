"""What `compose` and `stitch` share: what the panorama is to be, and writing it."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console, messages
from fullsphere.cli.viewer_metadata import viewer_metadata

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.model.images import PanoramaWriter
    from fullsphere.model.projection_text import Placed
    from fullsphere.mosaic.planning import Plan
    from fullsphere.mosaic.project import Mosaic
    from fullsphere.mosaic.reference import Exposure

AUTO = "auto"

_DTYPES = {"8": "uint8", "16": "uint16", "half": "float16", "float": "float32"}
_JPEG = (".jpg", ".jpeg")
_LARGEST_HALF = 65504.0


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
    """

    target: Placed | None
    exposure: Exposure
    blend: Any
    dtype: np.dtype[Any] | None
    compression: str | None


class Written(NamedTuple):
    """What was written: size and samples, how much brighter than the frames' mean, and the share of pixels seen."""

    size: tuple[int, int]
    dtype: str
    exposure_ev: float
    seen: float


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
        choices=tuple(_DTYPES),
        help="bits of a sample, or floats of linear light (default: what the frames have and the format holds)",
    )
    group.add_argument(
        "--compression",
        metavar="KIND",
        help=".tif: zip (default), lzw, none; .exr: zip, piz, none, dwaa; .png: zip, none; .jpg: quality 1 to 100",
    )


def check_arguments(args: argparse.Namespace, width: int | None) -> Wanted:
    """What is wanted; UsageError where it makes no sense, before anything long begins.

    `width` is that of a whole sphere where no size was asked for; None: as the frames resolve.
    """
    import numpy as np

    from fullsphere.model.images import check_panorama
    from fullsphere.model.projection_text import parse_projection
    from fullsphere.mosaic.reference import parse_exposure

    asked = args.size or width
    target = None
    if args.to:
        target = parse_projection(args.to)
    elif asked not in (None, AUTO):
        target = whole_sphere(int(asked))
    exposure = args.exposure if args.exposure in (AUTO, "none") else f"frame {args.exposure}"
    dtype = np.dtype(_DTYPES[args.depth]) if args.depth else None
    wanted = Wanted(target, parse_exposure(exposure), args.blend, dtype, args.compression)
    size = target.projection.size if target else (2, 1)
    check_panorama(args.output, size, 4, dtype or _held(args.output, np.dtype(np.uint8)), args.compression)
    return wanted


def plain(width: int) -> Wanted:
    """A whole sphere with nothing else asked for."""
    from fullsphere.mosaic.reference import Exposure

    return Wanted(whole_sphere(width), Exposure(), "multiband", None, None)


def files_of(mosaic: Mosaic, instead: Sequence[Path] = ()) -> list[Path]:
    """The files that are read, none of which may be written over; `instead` of the registered pictures, if any."""
    masks = [Path(frame.mask_image) for frame in mosaic.registered if frame.mask_image]
    return [*(instead or [Path(frame.image) for frame in mosaic.registered]), *masks]


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


def write_panorama(path: Path, mosaic: Mosaic, wanted: Wanted, executor: Executor, args: argparse.Namespace) -> Written:
    """Compose a mosaic into a file; as `wanted`, and otherwise as its frames are.

    Raises
    ------
    UsageError, ResourceError
        As `check_panorama`; if no frame sees anything of what is wanted.
    InputError
        If a frame cannot be read any more.
    OutputError
        If the file cannot be written.
    """
    from fullsphere.model.images import check_panorama, open_panorama
    from fullsphere.mosaic.planning import own_width, planned, shows_anything, turned_to

    target = wanted.target
    if target is None:
        target = whole_sphere(own_width(mosaic))
        console.say(args, f"{path}: {_by(target.projection.size)} pixels, as finely as the frames resolve")
    size = target.projection.size
    dtype = wanted.dtype or _held(path, _deepest(mosaic, args))
    check_panorama(path, size, 4, dtype, wanted.compression)
    console.say(args, f"looking at {console.counted(len(mosaic.registered), 'frame')}")
    plan = planned(turned_to(mosaic, target.world_from_projection), wanted.exposure, wanted.blend, executor)
    _refuse_nothing(shows_anything(plan, target.projection), path)
    attributes, icc_profile = _metadata(mosaic, dtype)
    attributes |= viewer_metadata(target.projection)
    with open_panorama(path, size, 4, dtype, attributes, args.overwrite, icc_profile, wanted.compression) as writer:
        seen = _write_bands(writer, plan, target, dtype, executor, args)
        _refuse_nothing(seen, path)
    return Written(size, dtype.name, plan.exposure_ev, seen / (size[0] * size[1]))


def described(written: Written) -> str:
    """What people want to know of what was written."""
    darker = f", {-written.exposure_ev:.2f} EV darker than the frames' mean" if written.exposure_ev else ""
    return f"{_by(written.size)} pixels of {written.dtype}, {100 * written.seen:.1f} % of them seen{darker}"


def summary(written: Written) -> dict[str, Any]:
    """What programs want to know of it."""
    return {
        "size_px": list(written.size),
        "samples": written.dtype,
        "reference_ev": written.exposure_ev,
        "seen": written.seen,
    }


def _write_bands(
    writer: PanoramaWriter,
    plan: Plan,
    target: Placed,
    dtype: np.dtype[Any],
    executor: Executor,
    args: argparse.Namespace,
) -> int:
    """Compose from top to bottom; answer how many pixels show something."""
    import numpy as np

    from fullsphere.mosaic.compose import compose
    from fullsphere.mosaic.frame_colour import common_profile

    in_floats = dtype.kind == "f"
    to_srgb = common_profile(plan.mosaic.registered).srgb_from_own.T.astype(np.float32) if in_floats else None
    computed: Any = np.float32 if in_floats else dtype.type
    bands: Iterable[Any] = compose(plan.mosaic, target.projection, computed, executor, plan.shares, plan.exposure_ev)
    seen = 0
    for band in console.progress(args)(bands, title="composing", total=-(-target.projection.size[1] // 512)):
        seen += int(np.count_nonzero(band.rows[..., 3]))
        writer.write_rows(band.top, band.rows if to_srgb is None else _light(band.rows, to_srgb, dtype))
    return seen


def _light(rows: NDArray[Any], to_srgb: NDArray[np.float32], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Linear light (h, w, 4) in the primaries of sRGB, of which every file of floats is."""
    import numpy as np

    if not np.array_equal(to_srgb, np.eye(3)):
        rows[..., :3] = rows[..., :3] @ to_srgb
    if dtype == np.float16:
        np.clip(rows, -_LARGEST_HALF, _LARGEST_HALF, out=rows)
    return rows.astype(dtype, copy=False)


def _refuse_nothing(seen: float, path: Path) -> None:
    from fullsphere.model.errors import UsageError

    if not seen:
        raise UsageError(f"{path}: no frame sees anything of it; choose another window or direction with --to")


def _metadata(mosaic: Mosaic, dtype: np.dtype[Any]) -> tuple[dict[str, Any], bytes | None]:
    """What the first frame's camera noted, and the colour profile that all are composed in."""
    from fullsphere.model.images import carried, open_picture
    from fullsphere.mosaic.frame_colour import common_profile

    first, noted = mosaic.registered[0], {}
    if first.sha256:
        with open_picture(Path(first.image)) as file:
            noted = dict(file.metadata)
    attributes, _ = carried(noted, None, 4)
    icc_profile = None if dtype.kind == "f" else common_profile(mosaic.registered).icc or None
    return attributes, icc_profile


def _deepest(mosaic: Mosaic, args: argparse.Namespace) -> np.dtype[Any]:
    """The type of the frames' samples; of those with most bits where they differ, which is said."""
    import numpy as np

    from fullsphere.model.images import open_picture

    found = set()
    for frame in mosaic.registered:
        if not frame.sha256:
            found.add(frame.load().dtype)
            continue
        with open_picture(Path(frame.image)) as file:
            found.add(file.dtype)
    names = [kind for kind in _DTYPES.values() if np.dtype(kind) in found]
    if len(names) > 1:
        messages.warn(f"the frames have several depths ({', '.join(names)}); the panorama gets {names[-1]}")
    return np.dtype(names[-1])


def _held(path: Path, dtype: np.dtype[Any]) -> np.dtype[Any]:
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


def _width(text: str) -> str:
    if text != AUTO and not (text.isdecimal() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is no width in pixels, and not auto")
    return text


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
