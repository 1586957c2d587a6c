"""`fullsphere calibrate`: known 3D points and their pixels -> camera.json."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console

if TYPE_CHECKING:
    from fullsphere.model.calibration.calibrate import Calibration

EPILOG = """\
The points file has a header line and a line for each point seen in a picture:
  image,x_mm,y_mm,z_mm,u_px,v_px
with one rigid target's coordinates in millimetres and pixels counted from the centre of the first pixel.

example:
  fullsphere calibrate --points corners.csv --image-size 1280x800 -o camera.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--points",
        type=Path,
        required=True,
        metavar="FILE.csv",
        help="known 3D points and where the pictures show them",
    )
    parser.add_argument(
        "--image-size", type=image_size, required=True, metavar="WxH", help="width and height of the pictures in pixels"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CAMERA.json", help="camera to write")
    parser.add_argument(
        "--field-of-view",
        type=field_of_view,
        metavar="DEGREES",
        help="whole angle that the lens sees (default: to the largest circle in the picture, or the outermost point)",
    )
    parser.add_argument("--lens", default="bakstein-pajdla", metavar="NAME", help="kind of lens (default: %(default)s)")


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
    from fullsphere.model.calibration.calibrate import calibrate
    from fullsphere.model.calibration.points import read_points
    from fullsphere.model.calibration.record import save_calibration
    from fullsphere.model.files import check_output

    check_output(args.output, args.overwrite, [args.points])
    half_fov = math.radians(args.field_of_view / 2) if args.field_of_view else None
    calibration = calibrate(read_points(args.points), args.image_size, args.lens, half_fov=half_fov)
    save_calibration(args.output, calibration, [args.points], args.overwrite)
    console.report(args, _summary(args, calibration), _lines(args, calibration))
    return console.done(args, with_warnings=False)


def _summary(args: argparse.Namespace, calibration: Calibration) -> dict[str, Any]:
    camera = calibration.camera
    return {
        "camera": str(args.output),
        "lens": camera.lens.projection,
        "values": dict(zip(camera.parameter_names, camera.values.tolist(), strict=True)),
        "half_field_of_view_deg": math.degrees(camera.half_fov),
        "rms_px": calibration.rms_px,
        "points": sum(len(r) for r in calibration.residuals_px),
        "views": len(calibration.images),
        "observed_theta_deg": list(calibration.observed_theta_deg),
    }


def _lines(args: argparse.Namespace, calibration: Calibration) -> list[str]:
    import numpy as np

    from fullsphere.model.calibration.calibrate import curve_of

    camera, curve = calibration.camera, curve_of(calibration)
    lowest, highest = calibration.observed_theta_deg
    lines = [
        f"{args.output}: {camera.lens.projection} lens, rms {calibration.rms_px:.4f} px over "
        f"{sum(len(r) for r in calibration.residuals_px)} points in {len(calibration.images)} views",
        f"centre ({camera.centre[0]:.2f}, {camera.centre[1]:.2f}) px, aspect {camera.aspect:.5f}, "
        f"field of view {2 * math.degrees(camera.half_fov):.1f} degrees; "
        f"points seen from {lowest:.1f} to {highest:.1f} degrees off axis",
        "theta (deg)   r (px)    sigma (px)",
    ]
    for theta in np.unique([*range(0, int(curve.theta_deg[-1]) + 1, 10), int(curve.theta_deg[-1])]):
        beyond = "  extrapolated" if theta > highest else ""
        lines.append(f"{theta:9d} {curve.r_px[theta]:10.3f} {curve.sigma_px[theta]:10.4f}{beyond}")
    return lines
