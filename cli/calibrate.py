"""`fullsphere calibrate`: photos of a known target, or known 3D points and their pixels -> camera.json and a report."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console
from fullsphere.cli.calibrating import (
    Found,
    Measured,
    add_lens_arguments,
    calibrated,
    check_lens,
    measure_photos,
    target_file,
)

if TYPE_CHECKING:
    from fullsphere.model.calibration.calibrate import Calibration
    from fullsphere.model.calibration.select import Selection

EPILOG = """\
The points file has a header line and a line for each point seen in a picture:
  image,x_mm,y_mm,z_mm,u_px,v_px
with one rigid target's coordinates in millimetres and pixels counted from the centre of the first pixel.

examples:
  fullsphere calibrate IMG_*.jpg --target chessboard:6x8:30mm -o camera.json --report report.html
  fullsphere calibrate IMG_*.jpg --target tube.json --lens auto -o camera.json
  fullsphere calibrate --points corners.csv --image-size 1280x800 -o camera.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("photos", nargs="*", type=Path, metavar="PHOTO", help="pictures of the target")
    add_lens_arguments(parser)
    parser.add_argument(
        "--points",
        type=Path,
        metavar="FILE.csv",
        help="instead of photos: known 3D points and where the pictures show them",
    )
    parser.add_argument(
        "--image-size", type=image_size, metavar="WxH", help="with --points: width and height of the pictures in pixels"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CAMERA.json", help="camera to write")
    parser.add_argument(
        "--report", type=Path, metavar="REPORT.html", help="also write a page that says how good the calibration is"
    )
    parser.add_argument(
        "--field-of-view",
        type=field_of_view,
        metavar="DEGREES",
        help="whole angle that the lens sees (default: to the largest circle in the picture, or the outermost point)",
    )


def image_size(text: str) -> tuple[int, int]:
    """(width, height) from a text like 1280x800."""
    found = re.fullmatch(r"(\d{1,7})[xX](\d{1,7})", text)
    if not found or min(int(found[1]), int(found[2])) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1280x800")
    return int(found[1]), int(found[2])


def field_of_view(text: str) -> float:
    """Degrees from a text like 183."""
    try:
        degrees = float(text)
    except ValueError:
        degrees = -1.0
    if not 0 < degrees <= 360:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle of more than 0 and up to 360 degrees")
    return degrees


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.model.calibration.record import save_calibration
    from fullsphere.model.files import check_output

    _check_given(args)
    check_lens(args)
    inputs = _inputs(args)
    check_output(args.output, args.overwrite, inputs)
    if args.report:
        from fullsphere.cli.report import check_report

        check_report(args.report, args.overwrite, inputs)
    measured = _measured(args)
    found = calibrated(args, measured, math.radians(args.field_of_view / 2) if args.field_of_view else None)
    calibration = found.calibration
    if not args.field_of_view:
        calibration = calibration.within(measured.circle)
    save_calibration(args.output, calibration, inputs, args.overwrite)
    if args.report:
        _write_report(args, calibration, found.selection, inputs)
    console.report(args, _summary(args, calibration, measured, found), _lines(args, calibration, measured, found))
    left_out = bool(measured.left_out or calibration.left_out or calibration.rejected)
    return console.done(args, with_warnings=left_out)


def _check_given(args: argparse.Namespace) -> None:
    from fullsphere.model.errors import UsageError

    if bool(args.photos) == bool(args.points):
        raise UsageError(
            "give either photos with --target, or --points with --image-size; see 'fullsphere calibrate --help'"
        )
    if args.points and not args.image_size:
        raise UsageError("--points needs --image-size WIDTHxHEIGHT: a table does not tell the size of its pictures")
    if args.points and args.target:
        raise UsageError("--target is for photos; a table of points holds its target's coordinates itself")
    if args.photos and args.image_size:
        raise UsageError("--image-size is for --points; photos tell their size themselves")


def _inputs(args: argparse.Namespace) -> list[Path]:
    return [*args.photos, *([args.points] if args.points else []), *target_file(args)]


def _measured(args: argparse.Namespace) -> Measured:
    from fullsphere.model.calibration.points import read_points

    if args.points:
        return Measured(read_points(args.points), args.image_size)
    return measure_photos(args, args.photos)


def _write_report(
    args: argparse.Namespace, calibration: Calibration, selection: Selection | None, inputs: list[Path]
) -> None:
    from fullsphere.cli.report import write_report
    from fullsphere.model.calibration.assess import assess

    console.say(args, "assessing the calibration")
    write_report(args.report, calibration, assess(calibration), selection, args.overwrite, inputs)


def _summary(args: argparse.Namespace, calibration: Calibration, measured: Measured, found: Found) -> dict[str, Any]:
    camera = calibration.camera
    summary = {
        "camera": str(args.output),
        "lens": camera.lens.projection,
        "values": dict(zip(camera.parameter_names, camera.values.tolist(), strict=True)),
        "half_field_of_view_deg": math.degrees(camera.half_fov),
        "rms_px": calibration.rms_px,
        "rms_with_rejected_px": calibration.rms_with_rejected_px,
        "points": calibration.points,
        "rejected_points": calibration.rejected,
        "views": len(calibration.views),
        "left_out": {view.image: view.reason for view in (*measured.left_out, *calibration.left_out)},
        "observed_theta_deg": list(calibration.observed_theta_deg),
    }
    if measured.photos:
        summary["photos"], summary["found"] = measured.photos, measured.found
    if calibration.bow_mm is not None:
        summary["bow_mm"] = list(calibration.bow_mm)
    if found.selection is not None:
        summary["verdict"] = found.selection.verdict
        summary["lenses"] = {
            row.lens: {"held_out_rms_px": row.held_out_rms_px, "verdict": row.verdict} if row.fitted else row.verdict
            for row in found.selection.rows
        }
    return summary


def _lines(args: argparse.Namespace, calibration: Calibration, measured: Measured, found: Found) -> list[str]:
    import numpy as np

    from fullsphere.model.calibration.calibrate import curve_of

    camera, curve = calibration.camera, curve_of(calibration)
    lowest, highest = calibration.observed_theta_deg
    lines = _lens_table(found.selection) if found.selection is not None else []
    lines += [
        f"{args.output}: {camera.lens.projection} lens, rms {calibration.rms_px:.4f} px over "
        f"{calibration.points} points in {console.counted(len(calibration.views), 'view')}"
        + (
            f" ({calibration.rms_with_rejected_px:.4f} px with {calibration.rejected} rejected points)"
            if calibration.rejected
            else ""
        ),
        f"centre ({camera.centre[0]:.2f}, {camera.centre[1]:.2f}) px, aspect {camera.aspect:.5f}, "
        f"field of view {2 * math.degrees(camera.half_fov):.1f} degrees; "
        f"points seen from {lowest:.1f} to {highest:.1f} degrees off axis",
    ]
    if calibration.bow_mm is not None:
        lines.append("bow of the board {:+.3f} mm along x, {:+.3f} mm along y".format(*calibration.bow_mm))
    lines.append("theta (deg)   r (px)    sigma (px)")
    for theta in np.unique([*range(0, int(curve.theta_deg[-1]) + 1, 10), int(curve.theta_deg[-1])]):
        beyond = "  extrapolated" if theta > highest else ""
        lines.append(f"{theta:9d} {curve.r_px[theta]:10.3f} {curve.sigma_px[theta]:10.4f}{beyond}")
    return lines


def _lens_table(selection: Selection) -> list[str]:
    lines = [f"lens                    values   fit rms   held out    ({selection.held_out})"]
    for row in selection.rows:
        figures = (
            f"{row.parameters:6d} {row.fit_rms_px:9.4f} {row.held_out_rms_px:10.4f} +- {row.held_out_error_px:.4f}"
            if row.fitted
            else f"{row.parameters:6d}{'':30}"
        )
        lines.append(f"{row.lens:22} {figures}   {row.verdict}")
    return [*lines, selection.verdict, ""]
