"""`fullsphere inspect`: what a file holds, or how two cameras differ."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli import console
from fullsphere.cli.wording import camera_lines
from fullsphere.model.errors import InputError, UsageError

if TYPE_CHECKING:
    from fullsphere.cli.descriptions import CameraFile
    from fullsphere.cli.page import Page
    from fullsphere.model.calibration.difference import Difference

EPILOG = """\
One file is described: a camera.json, mosaic.json, target.json or a picture.  Two cameras of pictures of one size are
compared, after the common rotation that brings them nearest.

examples:
  fullsphere inspect camera.json
  fullsphere inspect mosaic.json --report mosaic.html
  fullsphere inspect spring.json autumn.json --figure difference.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="a file to describe, or two camera.json to compare"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html", help="also write a page about the camera, the cameras or the mosaic"
    )
    parser.add_argument(
        "--figure", type=Path, metavar="FILE", help="also write the map of the difference: .png, .pdf or .svg"
    )


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.cli.page import check_page
    from fullsphere.model.files import check_output

    if len(args.files) > 2:
        raise UsageError(f"{len(args.files)} files: give one to have it described, or two cameras to compare them")
    if args.figure:
        from fullsphere.cli.figures import file_format

        if len(args.files) == 1:
            raise UsageError("--figure is the map of a difference: name two cameras (a page of one camera: --report)")
        file_format(args.figure)
        check_output(args.figure, args.overwrite, args.files)
    if args.report:
        check_page(args.report, args.overwrite, args.files)
        if args.figure and args.figure.absolute() == args.report.absolute():
            raise UsageError(f"{args.report}: --figure and --report name the same file")
    return _described(args) if len(args.files) == 1 else _compared(args)


def _described(args: argparse.Namespace) -> int:
    from fullsphere.cli.descriptions import describe, read_camera_file

    path = args.files[0]
    found = describe(path)
    if args.report:
        if found.kind not in ("camera", "mosaic"):
            raise UsageError(f"{path}: is a {found.kind}; --report is for cameras and mosaics only")
        from fullsphere.cli.page import write_page

        page = _page_of_one(read_camera_file(path)) if found.kind == "camera" else _page_of_mosaic(path)
        write_page(args.report, page, args.overwrite)
    console.report(args, found.summary, found.lines)
    return console.done(args, with_warnings=False)


def _page_of_mosaic(path: Path) -> Page:
    from fullsphere.cli.mosaic_page import page_of_mosaic
    from fullsphere.mosaic.store import load_mosaic

    return page_of_mosaic(path.name, load_mosaic(path))


def _compared(args: argparse.Namespace) -> int:
    from fullsphere.cli.descriptions import read_camera_file
    from fullsphere.model.calibration.difference import difference

    first, second = (read_camera_file(path) for path in args.files)
    if first.camera.size != second.camera.size:
        one, other = (f"{file.camera.size[0]} x {file.camera.size[1]}" for file in (first, second))
        raise InputError(
            f"{second.path}: is for pictures of {other} pixels, {first.path} for {one}; "
            "compare cameras of one picture size"
        )
    found = difference(first.camera, second.camera)
    if args.figure:
        from fullsphere.cli.figures import write_figure
        from fullsphere.cli.plots_picture import difference_map

        write_figure(args.figure, difference_map(first.camera, found), args.overwrite)
    if args.report:
        from fullsphere.cli.page import write_page

        write_page(args.report, _page_of_two(first, second, found), args.overwrite)
    console.report(args, _summary(first, second, found), _lines(first, second, found))
    return console.done(args, with_warnings=False)


def _summary(first: CameraFile, second: CameraFile, found: Difference) -> dict[str, Any]:
    import numpy as np

    return {
        "first": str(first.path),
        "second": str(second.path),
        "rotation_deg": found.rotation_deg,
        "first_from_second": found.first_from_second.tolist(),
        "rms_deg": math.degrees(found.rms_rad),
        "largest_deg": math.degrees(found.largest_rad),
        "largest_theta_deg": found.largest_theta_deg,
        "rms_px": found.rms_px,
        "largest_px": found.largest_px,
        "theta_deg": found.theta_deg.tolist(),
        "profile_deg": np.degrees(found.profile_rad).tolist(),
    }


def _lines(first: CameraFile, second: CameraFile, found: Difference) -> list[str]:
    return [
        f"{first.path} and {second.path}: directions of the same pixels differ by {_angles(found)}",
        f"in the picture: rms {found.rms_px:.4f} px, at most {found.largest_px:.4f} px",
        f"taken out before: a common rotation of {_rotation(found)}",
        "theta (deg)   rms difference (deg)",
        *(
            f"{theta:9.1f} {math.degrees(angle):14.5f}"
            for theta, angle in zip(found.theta_deg, found.profile_rad, strict=True)
        ),
    ]


def _angles(found: Difference) -> str:
    return (
        f"rms {math.degrees(found.rms_rad):.5f} degrees, at most {math.degrees(found.largest_rad):.5f} degrees "
        f"({found.largest_theta_deg:.1f} degrees off axis)"
    )


def _rotation(found: Difference) -> str:
    """The rotation as an angle and as the turn about each axis of the camera."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(found.first_from_second).as_rotvec(degrees=True)
    return f"{found.rotation_deg:.4f} degrees (about x {turn[0]:+.4f}, y {turn[1]:+.4f}, z {turn[2]:+.4f})"


def _page_of_one(file: CameraFile) -> Page:
    import numpy as np

    from fullsphere.cli.descriptions import observed_range, record_lines, shown_rows
    from fullsphere.cli.page import Finding, Page, Section, Table
    from fullsphere.cli.plots_lens import curve_sigma, projection_functions

    drawings = [projection_functions(file.camera)]
    seen = observed_range(file.record)
    if seen is not None and all(row.sigma_px is not None for row in file.curve):
        theta, _, sigma, _ = (np.array(column) for column in zip(*file.curve, strict=True))
        drawings.append(curve_sigma(theta, sigma, seen))
    rows = tuple(
        (
            f"{row.theta_deg:g}",
            f"{row.r_px:.3f}",
            "" if row.sigma_px is None else f"{row.sigma_px:.4f}",
            "extrapolated" if row.extrapolated else "",
        )
        for row in shown_rows(file.curve)
    )
    table = Table(("θ (degrees)", "r (px)", "sigma (px)", ""), rows, texts=(3,))
    return Page(
        f"{file.path.name}: a {file.camera.lens.projection} lens",
        (
            Finding("Picture", f"{file.camera.size[0]} × {file.camera.size[1]} px"),
            Finding("Field of view", f"{2 * math.degrees(file.camera.half_fov):.1f}°"),
        ),
        (),
        (
            Section("The camera", (*camera_lines(file.camera), *record_lines(file.record))),
            Section("The curve", (), (table,), tuple(drawings)),
        ),
    )


def _page_of_two(first: CameraFile, second: CameraFile, found: Difference) -> Page:
    from fullsphere.cli.descriptions import record_lines
    from fullsphere.cli.page import Finding, Page, Section, Table
    from fullsphere.cli.plots_picture import difference_map

    profile = tuple(
        (f"{theta:.1f}", f"{math.degrees(angle):.5f}")
        for theta, angle in zip(found.theta_deg, found.profile_rad, strict=True)
    )
    return Page(
        f"{first.path.name} and {second.path.name} compared",
        (
            Finding("Directions differ by (rms)", f"{math.degrees(found.rms_rad):.5f}° ({found.rms_px:.4f} px)"),
            Finding("and at most by", f"{math.degrees(found.largest_rad):.5f}° ({found.largest_px:.4f} px)"),
            Finding("Common rotation, taken out", f"{found.rotation_deg:.4f}°"),
        ),
        (),
        (
            Section(
                "The difference",
                (f"Directions of the same pixels differ by {_angles(found)}; taken out: {_rotation(found)}.",),
                (Table(("θ (degrees)", "rms difference (degrees)"), profile),),
                (difference_map(first.camera, found),),
            ),
            *(
                Section(name, (str(file.path.name), *camera_lines(file.camera), *record_lines(file.record)))
                for name, file in (("The first", first), ("The second", second))
            ),
        ),
    )
