"""`fullsphere target`: prints a calibration target at true scale, and writes the target.json that describes it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fullsphere.cli import console

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fullsphere.cli.sheet_layout import Pair
    from fullsphere.model.calibration.board import Artwork, Board
    from fullsphere.model.calibration.targets import Target

EPILOG = """\
TARGET is a target.json, or one of
  chessboard:COLUMNSxROWS:SQUARE                   counted in inner corners
  charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY]  counted in squares
  aprilgrid:COLUMNSxROWS:TAG:GAP[:BORDER]          Kalibr's; GAP in sides of a tag, BORDER 2 or 1 modules
  circles:COLUMNSxROWS:SPACING[:DIAMETER]
  acircles:COLUMNSxROWS:SPACING[:DIAMETER]         every second row shifted; SPACING of the rows
  cylinder:RADIUS:LENGTH:SQUARE[:MARKER[:DICTIONARY]]       a ChArUco strip for the inside of a tube
  half-cylinder:RADIUS:LENGTH:SQUARE[:MARKER[:DICTIONARY]]  the same for half a tube
Lengths have a unit: mm, cm, m or in.

examples:
  fullsphere target chessboard:6x8:30mm -o board
  fullsphere target cylinder:150mm:420mm:36mm --paper A4 -o tube
"""

_FLAP_MM = 12.0  # of paper beyond the seam of a tube, to glue


class _Outputs(NamedTuple):
    pdf: Path
    svg: list[Path]
    json: Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("target", metavar="TARGET", help="what to print; see below")
    parser.add_argument(
        "-o", "--output", required=True, metavar="NAME", help="writes NAME.pdf, NAME.svg and NAME.json (target.json)"
    )
    parser.add_argument(
        "--paper",
        metavar="SIZE",
        help="A4, A3, A2, A1, A0, letter or WxHmm; several sheets where it is smaller than the pattern "
        "(default: one sheet as large as needed)",
    )


def run(args: argparse.Namespace) -> int:
    """Carry out the command."""
    from fullsphere.cli.sheet_layout import paper_size
    from fullsphere.cli.sheets import as_pdf, as_svg
    from fullsphere.model.calibration.target_file import parse_target, save_target
    from fullsphere.model.files import check_output

    target = parse_target(args.target)
    figures = _figures(target, paper_size(args.paper) if args.paper else None)
    outputs = _outputs(args.output, len(figures))
    for path in (outputs.pdf, *outputs.svg, outputs.json):
        check_output(path, args.overwrite, [Path(args.target)])
    _write(outputs.pdf, as_pdf(figures, describe(target.boards[0])), args.overwrite)
    for path, figure in zip(outputs.svg, figures, strict=True):
        _write(path, as_svg(figure), args.overwrite)
    save_target(outputs.json, target, args.overwrite)
    summary = {
        "boards": [describe(board) for board in target.boards],
        "marks": len(target.points),
        "pdf": str(outputs.pdf),
        "svg": [str(path) for path in outputs.svg],
        "sheets": len(figures),
        "target": str(outputs.json),
    }
    lines = [
        f"{outputs.pdf}: {len(figures)} sheet{'s' * (len(figures) > 1)}, {len(target.points)} marks; print at 100 %, "
        "without fitting to the page, and measure the line on the sheet",
        *(describe(board) for board in target.boards),
        f"{outputs.json}: the target, for programs",
    ]
    console.report(args, summary, lines)
    return console.done(args, with_warnings=False)


def describe(board: Board) -> str:
    """A board's kind and numbers in one line."""
    from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid

    if isinstance(board, CharucoBoard):
        words = (
            f"ChArUco board, {board.squares_x} x {board.squares_y} squares of {board.square_mm:.6g} mm, "
            f"markers of {board.marker_mm:.6g} mm from {board.first_id}, {board.dictionary}"
        )
    elif isinstance(board, Chessboard):
        words = f"chessboard, {board.columns} x {board.rows} inner corners, squares of {board.square_mm:.6g} mm"
    elif isinstance(board, CirclesGrid):
        kind = "asymmetric" if board.asymmetric else "symmetric"
        words = (
            f"{kind} grid of {board.columns} x {board.rows} circles of {board.diameter_mm:.6g} mm, "
            f"spacing {board.spacing_mm:.6g} mm"
        )
    elif isinstance(board, AprilGrid):
        words = (
            f"AprilTag grid 36h11, {board.columns} x {board.rows} tags of {board.tag_mm:.6g} mm from {board.first_id}, "
            f"gap {board.spacing:.6g} of a tag, border of {board.border_modules} modules"
        )
    else:
        words = type(board).__name__
    return words if board.placement.is_flat else f"{words}, inside a tube of radius {board.placement.radius_mm:.6g} mm"


def _figures(target: Target, paper: Pair | None) -> list[Figure]:
    """All sheets of all boards of a target."""
    from importlib.metadata import version

    from fullsphere.cli.sheet_layout import lay_out
    from fullsphere.cli.sheets import draw

    figures = []
    for number, board in enumerate(target.boards, 1):
        artwork = board.artwork()
        flap_from = _seam(board, artwork)
        upper = artwork.upper if flap_from is None else (flap_from + _FLAP_MM, artwork.upper[1])
        sheets = lay_out(artwork.lower, upper, paper)
        which = f"board {number} of {len(target.boards)}, " if len(target.boards) > 1 else ""
        for count, sheet in enumerate(sheets, 1):
            lines = [f"fullsphere {version('fullsphere')}: {describe(board)}", f"{which}sheet {count} of {len(sheets)}"]
            if len(sheets) > 1:
                (row, column), (rows, columns) = sheet.place, sheet.grid
                lines[1] += f": row {row + 1} of {rows}, column {column + 1} of {columns}"
                lines.append("cut along the left and upper line; glue onto the sheets before, up to their dashed marks")
            if flap_from is not None:
                lines.append("tube, pattern inside: the left end meets the long dashed line; glue on the flap beyond")
            figures.append(draw(sheet, artwork, lines, flap_from))
    return figures


def _seam(board: Board, artwork: Artwork) -> float | None:
    """Where on its paper the strip of a whole tube meets its own beginning; None for other boards."""
    from fullsphere.model.calibration.boards import CharucoBoard

    return artwork.upper[0] if isinstance(board, CharucoBoard) and board.is_closed else None


def _outputs(name: str, sheets: int) -> _Outputs:
    """The files to write, from a name with or without one of their endings."""
    from fullsphere.model.errors import UsageError

    path = Path(name)
    if not path.name:
        raise UsageError(f"--output {name!r}: is no name for files")
    stem = path.stem if path.suffix.lower() in (".pdf", ".svg", ".json") else path.name
    numbers = [""] if sheets == 1 else [f"-{number}" for number in range(1, sheets + 1)]
    svg = [path.with_name(f"{stem}{number}.svg") for number in numbers]
    return _Outputs(path.with_name(f"{stem}.pdf"), svg, path.with_name(f"{stem}.json"))


def _write(path: Path, content: bytes, overwrite: bool) -> None:
    from fullsphere.model.files import output_errors, replacing

    with replacing(path, overwrite) as temporary, output_errors(path):
        temporary.write_bytes(content)
