"""What `omnistereo` writes: the mosaic, its eyes, the over-under picture, range and anaglyph."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.model.camera import Camera
    from fullsphere.mosaic.arm import ArmTurn
    from fullsphere.mosaic.omnistereo import Omnistereo
    from fullsphere.mosaic.project import Frame

_MEMORY = 2 * 10**9
_BAND = 256  # rows written at once
_RANGE_WIDTH = 2048  # of what is matched for range: more gives the matcher nothing
_LINEAR = (".exr",)
_DEEP = (".tif", ".tiff", ".png")
_WITHOUT_ALPHA = (".jpg", ".jpeg")
_RANGE = (".exr", ".tif", ".tiff")


class _Picture(NamedTuple):
    """One of the pictures of a mosaic: what it is, and its size."""

    path: Path
    name: str
    size: tuple[int, int]


def add_arguments(group: argparse._ArgumentGroup) -> None:
    """Declare what is to be written."""
    for flag, dest, what in (
        ("-o", "output", "the 360 x 360 mosaic: turn of the arm across, circle of rays down; .tif, .exr, .png or .jpg"),
        ("--left", "left", "what the left eye sees, an equirectangular panorama"),
        ("--right", "right", "what the right eye sees"),
        ("--over-under", "over_under", "both, the left eye's above the right eye's, as VR viewers read them"),
        ("--anaglyph", "anaglyph", "a preview through red-cyan glasses"),
        ("--depth", "depth", "range of the scene from the turning axis, in the unit of --arm; .exr or .tif of floats"),
    ):
        names = (flag, "--output") if flag == "-o" else (flag,)
        group.add_argument(*names, dest=dest, type=Path, metavar="FILE", help=what)
    group.add_argument(
        "--size",
        type=_width,
        metavar="WIDTH",
        help="width of mosaic and eyes in pixels (default: what the lens resolves)",
    )
    console.add_compression(group)
    group.add_argument(
        "--report",
        type=Path,
        metavar="FILE.html",
        help="also write a page about it: the turn, light, the mosaic, range",
    )
    group.add_argument(
        "--memory",
        type=console.bytes_of,
        default=_MEMORY,
        metavar="SIZE",
        help="memory to use, 500MB or 4GB; what does not fit is put on the disk (default: 2GB)",
    )


def _width(text: str) -> int:
    from fullsphere.model.camera import MAX_SIDE_PX

    width = int(text) if text.isdecimal() else 0
    if width % 4 or not 16 <= width <= MAX_SIDE_PX:
        raise argparse.ArgumentTypeError(f"{text!r} is no multiple of 4 from 16 to {MAX_SIDE_PX}")
    return width


def check(args: argparse.Namespace, camera: Camera, inputs: Sequence[Path]) -> None:
    """Say before the work what cannot be written."""
    from fullsphere.model.errors import UsageError
    from fullsphere.model.files import check_output
    from fullsphere.model.images import check_panorama
    from fullsphere.mosaic.omnistereo import own_width

    width = args.size or own_width(camera)
    wanted = [*_pictures(args, width), *_range_picture(args, width)]
    if not wanted:
        raise UsageError("nothing is to be written; give -o, --left, --right, --over-under, --anaglyph or --depth")
    paths = [*(picture.path for picture in wanted), *filter(None, [args.report])]
    resolved = [path.resolve() for path in paths]
    for path, place in zip(paths, resolved, strict=True):
        if resolved.count(place) > 1:
            raise UsageError(f"{path}: is to be written twice; choose different names")
    for picture in wanted:
        check_output(picture.path, args.overwrite, inputs)
        ranges = picture.name == "range"
        if ranges and picture.path.suffix.lower() not in _RANGE:
            raise UsageError(f"{picture.path}: range is floats; write a .exr or a .tif")
        dtype = "float32" if ranges or picture.path.suffix.lower() in _LINEAR else "uint8"
        check_panorama(picture.path, picture.size, 2 if ranges else _channels(picture.path), dtype, args.compression)
    if args.report is not None:
        from fullsphere.cli.page import check_page

        check_page(args.report, args.overwrite, inputs)


def samples(args: argparse.Namespace, frame: Frame) -> type[np.generic]:
    """The type that the mosaic is made in: light if any file holds light, else as deep as the frames and a file."""
    import numpy as np

    from fullsphere.model.images import open_picture

    endings = {picture.path.suffix.lower() for picture in _pictures(args, 16)}
    with open_picture(Path(frame.image)) as file:
        deep = file.dtype
    if deep.kind == "f" or endings & set(_LINEAR):
        return np.float32
    return np.uint16 if deep == np.uint16 and endings & set(_DEEP) else np.uint8


def room_bytes(args: argparse.Namespace, camera: Camera, frames: Sequence[Frame]) -> int:
    """The memory for frames and mosaic; ResourceError if --memory is too little for all else."""
    from fullsphere.model.workers import usable_cores
    from fullsphere.mosaic.omnistereo import own_width
    from fullsphere.mosaic.turn_budget import left_for_pictures

    width, threads = args.size or own_width(camera), args.threads or usable_cores()
    return left_for_pictures(args.memory, camera, len(frames), width, samples(args, frames[0]), threads)


@contextlib.contextmanager
def room(args: argparse.Namespace, memory: int) -> Iterator[Callable[[tuple[int, ...], Any], NDArray[Any]]]:
    """Give what makes the arrays of the mosaic: in `memory` bytes, or in files beside the results after that."""
    import math

    import numpy as np

    from fullsphere.model.files import output_errors
    from fullsphere.model.resources import require_disk

    beside = next(iter(_pictures(args, 16)), None) or _Picture(args.depth, "range", (16, 16))
    left = memory
    with contextlib.ExitStack() as stack:

        def made(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
            nonlocal left
            needed = math.prod(shape) * np.dtype(dtype).itemsize
            if needed <= left:
                left -= needed
                return np.empty(shape, dtype)
            folder = beside.path.resolve().parent
            require_disk(needed, folder, f"{beside.path}: the mosaic", "make room, or give more --memory")
            with output_errors(beside.path):
                file = stack.enter_context(tempfile.TemporaryFile(dir=folder))
                return np.memmap(file, np.dtype(dtype), "w+", shape=shape)

        yield made


def write(args: argparse.Namespace, turn: ArmTurn, made: Omnistereo) -> dict[str, str]:
    """Write what was asked for; answers what each file holds."""
    width = made.codes.shape[1]
    written = {str(picture.path): _write_picture(args, picture, turn, made) for picture in _pictures(args, width)}
    for picture in _range_picture(args, width):
        written[str(picture.path)] = _write_range(args, picture, turn, made)
    if args.report is not None:
        from fullsphere.cli.omnistereo_page import page_of_turn
        from fullsphere.cli.page import write_page

        write_page(args.report, page_of_turn(next(iter(written)), turn, made), args.overwrite)
        written[str(args.report)] = "the report"
    return written


def _pictures(args: argparse.Namespace, width: int) -> list[_Picture]:
    whole, eye = (width, width), (width, width // 2)
    sizes = {"output": whole, "left": eye, "right": eye, "over_under": whole, "anaglyph": eye}
    return [_Picture(getattr(args, name), name, size) for name, size in sizes.items() if getattr(args, name)]


def _range_picture(args: argparse.Namespace, width: int) -> list[_Picture]:
    matched = min(width, _RANGE_WIDTH)
    return [_Picture(args.depth, "range", (matched, matched // 2))] if args.depth else []


def _channels(path: Path) -> int:
    return 3 if path.suffix.lower() in _WITHOUT_ALPHA else 4


def _write_picture(args: argparse.Namespace, picture: _Picture, turn: ArmTurn, made: Omnistereo) -> str:
    """One of the pictures of a mosaic, rows after rows."""
    import numpy as np

    from fullsphere.model.images import gpano, open_panorama, over_under

    noted, icc_profile = _metadata(turn.frames[0], made)
    spherical = {"output": {}, "over_under": over_under()}.get(picture.name)
    attributes = noted | (gpano(picture.size) if spherical is None else spherical)
    dtype, channels = _held(picture.path, made.codes.dtype), _channels(picture.path)
    if dtype.kind == "f":
        icc_profile = None
    (width, height), overwrite = picture.size, args.overwrite
    with open_panorama(
        picture.path, picture.size, channels, dtype, attributes, overwrite, icc_profile, args.compression
    ) as writer:
        for top in range(0, height, _BAND):
            codes, seen = _rows(made, picture.name, slice(top, min(top + _BAND, height)))
            colour = _as_held(codes, made, dtype)
            full = 1 if dtype.kind == "f" else np.iinfo(dtype).max
            alpha = np.where(seen, full, 0).astype(dtype)
            writer.write_rows(top, np.dstack([colour, alpha]) if channels == 4 else colour)
    return f"{_WORDS[picture.name]}, {width} x {height} pixels of {dtype}"


def _rows(made: Omnistereo, name: str, rows: slice) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Codes (h, W, 3) of rows of a picture, and where they show something (h, W)."""
    import numpy as np

    from fullsphere.mosaic.eyes import eye_rows
    from fullsphere.mosaic.red_cyan import red_cyan

    if name == "output":
        return made.codes[rows], made.seen[rows]
    if name == "left":
        return eye_rows(made.codes, "left", rows), eye_rows(made.seen, "left", rows)
    if name == "right":
        return eye_rows(made.codes, "right", rows), eye_rows(made.seen, "right", rows)
    if name == "anaglyph":
        (left, left_seen), (right, right_seen) = _rows(made, "left", rows), _rows(made, "right", rows)
        return red_cyan(left, right), left_seen & right_seen
    half = len(made.codes) // 2
    parts = [
        _rows(made, eye, slice(max(rows.start - first, 0), min(rows.stop - first, half)))
        for eye, first in (("left", 0), ("right", half))
        if rows.start < first + half and rows.stop > first
    ]
    return np.concatenate([codes for codes, _ in parts]), np.concatenate([seen for _, seen in parts])


def _as_held(codes: NDArray[Any], made: Omnistereo, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Codes or light of the mosaic as samples of a file."""
    import numpy as np

    from fullsphere.model.images import encoded_from_linear
    from fullsphere.mosaic.frame_colour import srgb_light

    if codes.dtype == dtype:
        return srgb_light(codes, made.profile) if dtype.kind == "f" else codes
    if codes.dtype.kind == "f":
        return encoded_from_linear(np.ascontiguousarray(codes), dtype, made.profile)
    return ((codes.astype(np.uint32) + 128) // 257).astype(np.uint8)


def _write_range(args: argparse.Namespace, picture: _Picture, turn: ArmTurn, made: Omnistereo) -> str:
    """Range of the scene as the left eye sees it, with alpha 0 where it is not known."""
    import numpy as np

    from fullsphere.model.images import gpano, open_panorama
    from fullsphere.mosaic.omnistereo import range_from

    found = range_from(made, picture.size[0])
    known = np.isfinite(found)
    rows = np.dstack([np.where(known, found * args.arm, 0), known]).astype(np.float32)
    attributes = _metadata(turn.frames[0], made)[0] | gpano(picture.size)
    with open_panorama(picture.path, picture.size, 2, np.float32, attributes, args.overwrite) as writer:
        writer.write_rows(0, rows)
    share = 100 * float(known.mean())
    return f"range from the turning axis, {picture.size[0]} x {picture.size[1]} floats, {share:.0f} % of them known"


def _metadata(frame: Frame, made: Omnistereo) -> tuple[dict[str, Any], bytes | None]:
    """What the camera noted of the first frame, and the colour profile that all are in."""
    from fullsphere.model.images import carried, open_picture

    with open_picture(Path(frame.image)) as file:
        noted = dict(file.metadata)
    return carried(noted, None, 4)[0], made.profile.icc or None


def _held(path: Path, dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type of samples that a file gets: that of the mosaic, as far as the format holds it."""
    import numpy as np

    ending = path.suffix.lower()
    if ending in _LINEAR:
        return np.dtype(np.float32)
    if ending in _WITHOUT_ALPHA:
        return np.dtype(np.uint8)
    return np.dtype(np.uint16) if dtype.kind == "f" else dtype


_WORDS = {
    "output": "360 x 360 mosaic",
    "left": "left eye",
    "right": "right eye",
    "over_under": "left eye above right eye",
    "anaglyph": "red-cyan anaglyph",
}
