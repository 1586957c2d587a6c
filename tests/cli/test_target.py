"""What is printed has true scale: the shapes in the files are the artwork's, in millimetres."""

from __future__ import annotations

import json
import re
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from fullsphere.cli.main import main
from fullsphere.cli.sheet_layout import CAPTION_MM, MARGIN_MM, OVERLAP_MM, PAPERS, Pair, Sheet, lay_out, paper_size
from fullsphere.cli.target import describe
from fullsphere.model.calibration.board import Artwork
from fullsphere.model.calibration.target_file import load_target, parse_target

SVG = "{http://www.w3.org/2000/svg}"


def corners(words: str) -> np.ndarray:
    """The points (n, 2) of a path written with single letters and numbers."""
    return np.array(re.findall(r"-?\d+(?:\.\d+)?", words), float).reshape(-1, 2)


def shapes_of_svg(path: Path) -> tuple[Pair, list[np.ndarray]]:
    """Size of the sheet, and the outlines of the pattern on it; mm, y down."""
    root = ElementTree.parse(path).getroot()
    size = [float(root.attrib[side].removesuffix("mm")) for side in ("width", "height")]
    view = np.array(root.attrib["viewBox"].split(), float)
    mm = np.array(size) / view[2:]
    (pattern,) = (group for group in root.iter(f"{SVG}g") if group.get("id") == "pattern")
    (outline,) = pattern.findall(f"{SVG}path")
    return (size[0], size[1]), [corners(part) * mm for part in outline.attrib["d"].split("z") if part.strip()]


def shapes_of_pdf(path: Path) -> tuple[list[Pair], list[list[np.ndarray]]]:
    """Sizes of the pages, and the closed outlines on each that are filled in black; mm, y down."""
    content = path.read_bytes()
    boxes = [tuple(float(x) for x in box.split()) for box in re.findall(rb"/MediaBox \[([^\]]*)\]", content)]
    sizes = [(box[2] * 25.4 / 72, box[3] * 25.4 / 72) for box in boxes]
    pages: list[list[np.ndarray]] = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL):
        try:
            text = zlib.decompress(stream).decode("latin-1")
        except zlib.error:
            continue
        filled = re.findall(r"0 g\s+((?:[-\d. ]+ [ml]\n|h\n)+)\s*f\n", text)
        if filled:
            height = sizes[len(pages)][1]
            parts = [part for body in filled for part in body.split("h\n") if part.strip()]
            pages.append([[0, height] + corners(part) * [25.4 / 72, -25.4 / 72] for part in parts])
    return sizes, pages


def assert_shows(shapes: list[np.ndarray], artwork: Artwork, sheet: Sheet) -> None:
    """Each rectangle of the artwork that touches the sheet's part is drawn at its place, and nothing else."""
    shift = np.subtract(sheet.lower, sheet.corner)
    drawn = {tuple(np.round([*(s.min(0) + shift), *(s.max(0) + shift)], 2)) for s in shapes}
    wanted = {
        tuple(np.round([*p.min(0), *p.max(0)], 2))
        for p in artwork.polygons
        if (p.min(0) < sheet.upper).all() and (p.max(0) > sheet.lower).all()
    }
    assert len(drawn) == len(wanted) == len(shapes)
    np.testing.assert_allclose(sorted(drawn), sorted(wanted), atol=0.011)


@pytest.mark.parametrize(
    ("text", "paper"),
    [
        ("chessboard:6x8:30mm", None),
        ("charuco:9x6:30mm:22mm:DICT_4X4_50", "A4"),
        ("aprilgrid:2x3:60mm:0.3", "A4"),
        ("half-cylinder:100mm:120mm:30mm", "letter"),
    ],
)
def test_true_scale(text: str, paper: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = tmp_path / "board"
    assert main(["target", text, "-o", str(name), "--json", *(["--paper", paper] if paper else [])]) == 0
    said = json.loads(capsys.readouterr().out)
    target = parse_target(text)
    np.testing.assert_array_equal(load_target(Path(said["target"])).points, target.points)
    artwork = target.boards[0].artwork()
    sheets = lay_out(artwork.lower, artwork.upper, paper_size(paper) if paper else None)
    assert len(said["svg"]) == len(sheets) == said["sheets"]
    sizes, pages = shapes_of_pdf(Path(said["pdf"]))
    for sheet, svg, size, shapes in zip(sheets, said["svg"], sizes, pages, strict=True):
        np.testing.assert_allclose(size, sheet.size, atol=0.01)
        assert_shows(shapes, artwork, sheet)
        size, shapes = shapes_of_svg(Path(svg))
        np.testing.assert_allclose(size, sheet.size, atol=0.01)
        assert_shows(shapes, artwork, sheet)


def test_discs_are_round_and_in_place(tmp_path: Path) -> None:
    assert main(["target", "acircles:4x11:20mm:12mm", "-o", str(tmp_path / "discs")]) == 0
    artwork = parse_target("acircles:4x11:20mm:12mm").boards[0].artwork()
    (sheet,) = lay_out(artwork.lower, artwork.upper, None)
    _, outlines = shapes_of_svg(tmp_path / "discs.svg")
    assert len(outlines) == 44
    on_paper = [outline + np.subtract(sheet.lower, sheet.corner) for outline in outlines]
    np.testing.assert_allclose([(o.min(0) + o.max(0)) / 2 for o in on_paper], artwork.discs[:, :2], atol=1e-3)
    np.testing.assert_allclose([o.max(0) - o.min(0) for o in on_paper], 12.0, atol=1e-2)


def test_same_target_same_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        assert main(["target", "charuco:9x6:30mm:22mm", "--paper", "A4", "-o", str(tmp_path / folder / "b.pdf")]) == 0
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == ["b-1.svg", "b-2.svg", "b.json", "b.pdf"]
    for name in names:
        content = (tmp_path / "one" / name).read_bytes()
        assert content == (tmp_path / "two" / name).read_bytes()
        assert not re.search(rb"CreationDate|dc:date|20\d\d-\d\d-\d\d", content)


def test_a_target_file_is_printed_board_by_board(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "box.json"
    box = {"kind": "charuco", "squares_x": 4, "squares_y": 4, "square_mm": 30, "marker_mm": 20}
    boards = [box | {"first_id": first} for first in (0, 8, 16)]
    source.write_text(json.dumps({"format": "fullsphere-target/1", "boards": boards}))
    assert main(["target", str(source), "-o", str(tmp_path / "print"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sheets"] == 3
    before = source.read_bytes()
    assert main(["target", str(source), "-o", str(tmp_path / "box"), "--overwrite"]) == 5  # it is the input
    assert source.read_bytes() == before
    assert not (tmp_path / "box.pdf").exists()


def test_nothing_is_replaced_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "b.svg").write_text("mine")
    command = ["target", "chessboard:6x8:30mm", "-o", str(tmp_path / "b")]
    assert main(command) == 5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.svg"]
    assert main([*command, "--overwrite"]) == 0
    assert (tmp_path / "b.svg").read_text() != "mine"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["chessboard:6x8:30"], "30mm"),
        (["halma:6x8"], "chessboard:COLUMNSxROWS"),
        (["chessboard:6x8:30mm", "--paper", "A7"], "A0, letter"),
        (["chessboard:6x8:30mm", "--paper", "50x900mm"], "at least"),
        (["chessboard:6x8:30mm", "--paper", "0x0mm"], "at least"),
        (["chessboard:60x80:1m", "--paper", "A4"], "larger --paper"),
        (["chessboard:60x80:1m"], "--paper A0"),
    ],
)
def test_wrong_words_are_usage_errors(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["target", *words, "-o", str(tmp_path / "b")]) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_a_name_is_needed(name: str) -> None:
    assert main(["target", "chessboard:6x8:30mm", "-o", name]) == 2


def test_help_is_light() -> None:
    import subprocess
    import sys

    code = (
        "import sys; from fullsphere.cli.main import main; assert main(['target', '--help']) == 0;"
        "assert not {'numpy', 'cv2', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


@pytest.mark.parametrize("paper", [*PAPERS.values(), (500.0, 160.0), (100.0, 150.0)])
@pytest.mark.parametrize("pattern", [(100.0, 80.0), (360.0, 270.0), (955.0, 400.0), (90.0, 1500.0)])
def test_sheets_cover_the_pattern_and_stay_on_their_paper(paper: Pair, pattern: Pair) -> None:
    lower, upper = (-5.0, 7.0), (pattern[0] - 5.0, pattern[1] + 7.0)
    sheets = lay_out(lower, upper, paper)
    rows, columns = sheets[0].grid
    assert [sheet.place for sheet in sheets] == [(row, column) for row in range(rows) for column in range(columns)]
    np.testing.assert_allclose(sheets[0].lower, lower)
    np.testing.assert_allclose(sheets[-1].upper, upper)
    for sheet in sheets:
        part = np.subtract(sheet.upper, sheet.lower)
        assert sorted(sheet.size) == sorted(paper)
        room = np.array(sheet.size) - MARGIN_MM - np.array([CAPTION_MM, 0] if sheet.beside else [0, CAPTION_MM])
        assert (np.array(sheet.corner) >= MARGIN_MM - 1e-9).all()
        assert (sheet.corner + part <= room + 1e-6).all()
        row, column = sheet.place
        if column:
            assert sheets[row * columns + column - 1].upper[0] - sheet.lower[0] == pytest.approx(OVERLAP_MM)
        if row:
            assert sheets[(row - 1) * columns + column].upper[1] - sheet.lower[1] == pytest.approx(OVERLAP_MM)


def test_paper_is_turned_to_save_sheets() -> None:
    assert len(lay_out((0.0, 0.0), (360.0, 250.0), PAPERS["A3"])) == 1  # on its side
    (sheet,) = lay_out((0.0, 0.0), (360.0, 270.0), PAPERS["A3"])  # too high for text below
    assert sheet.beside


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("chessboard:6x8:117mm", ["6 x 8 inner corners", "117 mm"]),
        ("charuco:11x8:30mm:22mm", ["11 x 8 squares", "22 mm", "DICT_5X5_1000"]),
        ("aprilgrid:6x5:88mm:0.3", ["6 x 5 tags", "88 mm", "0.3"]),
        ("acircles:4x11:20mm", ["asymmetric", "4 x 11", "20 mm"]),
        ("cylinder:150mm:420mm:36mm", ["26 x 11", "36.2491 mm", "radius 150 mm"]),
    ],
)
def test_sheets_say_what_they_are(text: str, parts: list[str]) -> None:
    said = describe(parse_target(text).boards[0])
    assert all(part in said for part in parts)


def test_a_tube_has_a_flap_beyond_its_seam(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["target", "cylinder:50mm:90mm:26mm", "-o", str(tmp_path / "tube")]) == 0
    size, shapes = shapes_of_svg(tmp_path / "tube.svg")
    around = 2 * np.pi * 50
    assert size[0] == pytest.approx(around + 12 + 2 * MARGIN_MM, abs=0.01)
    outline = np.concatenate(shapes)
    assert outline[:, 0].min() == pytest.approx(MARGIN_MM, abs=0.01)
    assert outline[:, 0].max() == pytest.approx(MARGIN_MM + around, abs=0.01)
