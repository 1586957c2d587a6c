"""What `calibrate` and `stitch --calibrate` share: from photos of a target, or a table of points, to a calibration."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli import console, messages

if TYPE_CHECKING:
    from fullsphere.model.calibration.calibrate import Calibration
    from fullsphere.model.calibration.photos import Photo
    from fullsphere.model.calibration.points import LeftOut, View
    from fullsphere.model.calibration.select import Selection
    from fullsphere.model.circle import ImageCircle

AUTO, USUAL_LENS = "auto", "bakstein-pajdla"


class Measured(NamedTuple):
    """Views of a target with the size of their pictures, what had to be left out, and the image circle if seen."""

    views: tuple[View, ...]
    image_size: tuple[int, int]
    left_out: tuple[LeftOut, ...] = ()
    photos: int = 0
    found: int = 0
    circle: ImageCircle | None = None


class Found(NamedTuple):
    """A calibration, and the comparison of lenses that led to it if there was one."""

    calibration: Calibration
    selection: Selection | None


def add_lens_arguments(
    parser: Any, auto: str = "auto to compare all kinds", default: str | None = USUAL_LENS, usual: str = USUAL_LENS
) -> None:
    """Declare what says how to calibrate, whatever from; `auto` and `usual` say what those words and no word mean."""
    parser.add_argument(
        "--target", metavar="SPEC", help="the target in the photos: chessboard:6x8:30mm, target.json ..."
    )
    parser.add_argument(
        "--lens",
        default=default,
        metavar="NAME",
        help=f"kind of lens, or {auto} (default: {usual})",
    )
    parser.add_argument("--bow", action="store_true", help="the flat target may be bowed: solve for that too")


def check_lens(args: argparse.Namespace) -> None:
    """UsageError if there is no such lens, before anything long begins."""
    from fullsphere.model.errors import UsageError
    from fullsphere.model.lens import LENSES

    if args.lens not in (AUTO, *LENSES):
        raise UsageError(
            f"there is no lens {args.lens!r}; the lenses are {', '.join(LENSES)}, or {AUTO} to compare them"
        )


def is_table(paths: Sequence[Path]) -> bool:
    """Whether what is given to calibrate from is a table of points, not photos."""
    return len(paths) == 1 and paths[0].suffix.lower() == ".csv"


def target_file(args: argparse.Namespace) -> list[Path]:
    """The file that describes the target, if it is one."""
    return [Path(args.target)] if args.target and Path(args.target).is_file() else []


def measure_photos(args: argparse.Namespace, photos: Sequence[Path]) -> Measured:
    """Find the target in photos; those without it are warned of."""
    from fullsphere.model.calibration.photos import views_of_photos
    from fullsphere.model.calibration.target_file import parse_target
    from fullsphere.model.errors import UsageError

    if not args.target:
        raise UsageError("photos need --target to say what is in them, for example --target chessboard:6x8:30mm")
    target = parse_target(args.target)
    searching = functools.partial(console.progress(args), title="searching")
    seen = views_of_photos([_photo(path) for path in photos], target, searching)
    for photo in seen.left_out:
        messages.warn(f"{photo.image} is left out: {photo.reason}")
    console.say(args, f"{target.name} found in {seen.found} of {len(photos)} photos")
    return Measured(seen.views, seen.image_size, seen.left_out, len(photos), seen.found, seen.circle)


def _photo(path: Path) -> Photo:
    from fullsphere.model.calibration.photos import Photo

    return Photo(str(path), lambda: _as_8_bits(path))


def _as_8_bits(path: Path) -> Any:
    import numpy as np

    from fullsphere.model.images import read_picture

    pixels = read_picture(path).pixels
    if pixels.dtype == np.uint16:
        return np.asarray(np.rint(pixels / 257.0), np.uint8)
    if pixels.dtype != np.uint8:  # light: corners are found in any encoding of it
        brightest = float(np.nanmax(pixels)) or 1.0
        return np.asarray(np.rint(255 * np.clip(pixels / brightest, 0, 1) ** (1 / 2.2)), np.uint8)
    return pixels


def calibrated(args: argparse.Namespace, measured: Measured, half_fov: float | None = None) -> Found:
    """The camera of the measured views; views and points that were rejected are warned of."""
    from fullsphere.model.calibration.calibrate import calibrate

    options = {
        "half_fov": half_fov,
        "bow": args.bow,
        "centre": measured.circle.centre if measured.circle else None,
    }
    if args.lens == AUTO:
        from fullsphere.model.calibration.select import select

        comparing = functools.partial(console.progress(args), title="comparing lenses")
        selection = select(measured.views, measured.image_size, progress=comparing, **options)
        found = Found(selection.calibration, selection)
    else:
        found = Found(calibrate(measured.views, measured.image_size, args.lens, **options), None)
    for view in found.calibration.left_out:
        messages.warn(f"{view.image} is left out: {view.reason}")
    _warn_of_points(found.calibration)
    return found


def _warn_of_points(calibration: Calibration) -> None:
    """One line per view in which points were rejected: how many, and the worst."""
    import numpy as np

    for view, residuals, used in zip(calibration.views, calibration.residuals_px, calibration.used, strict=True):
        rejected = np.flatnonzero(~used)
        if rejected.size:
            distance = np.nan_to_num(np.hypot(*residuals[rejected].T), nan=np.inf)
            worst = int(np.argmax(distance))
            u, v = view.pixels[rejected[worst]]
            off = f"{distance[worst]:.1f} px" if np.isfinite(distance[worst]) else "outside the lens's field"
            messages.warn(
                f"{view.image}: {rejected.size} of {len(used)} points rejected, the worst at ({u:.0f}, {v:.0f}), {off}"
            )
