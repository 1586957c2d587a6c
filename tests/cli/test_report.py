"""The report: complete, self-contained, escaped, the same bytes each time, and written whole or not at all."""

from __future__ import annotations

import dataclasses
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from calibrations import HOSTILE, made_calibration

from fullsphere.cli.page import Page, figures_folder, write_page
from fullsphere.cli.report import check_report, report_page, write_report
from fullsphere.cli.verdict import findings, warnings
from fullsphere.model.calibration.assess import Assessment, assess
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.select import Row, Selection
from fullsphere.model.errors import OutputError

FIGURES = {
    "projection-functions", "curve-sigma", "lens-fit", "reprojection", "error-by-point", "error-by-theta", "chi-square",
    "trend-theta", "trend-phi", "ray-sigma", "coverage",
}  # fmt: skip


class Read(HTMLParser):
    """A page's elements, attributes and text."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return made_calibration(rejected=4)


@pytest.fixture(scope="module")
def assessment(calibration: Calibration) -> Assessment:
    return assess(calibration)


@pytest.fixture(scope="module")
def page(calibration: Calibration, assessment: Assessment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, calibration, assessment, inputs=[Path("a") / "<i>corners.csv"])
    return path


def test_the_page_needs_nothing_but_itself(page: Path) -> None:
    found = Read(page)
    assert not {"script", "link", "iframe", "object", "embed"} & set(found.tags)
    for name, value in found.attributes:
        assert not name.startswith("on")
        if name in ("src", "href", "srcset", "action"):
            assert value.startswith("data:image/svg+xml;base64,")
    style = page.read_text().split("<style>")[1].split("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style
    assert "prefers-color-scheme: dark" in style
    assert ("name", "viewport") in found.attributes
    assert page.stat().st_size < 3_000_000


def test_names_and_texts_are_escaped(page: Path) -> None:
    raw, found = page.read_text(), Read(page)
    for text in (HOSTILE, "dark & <b>blurred</b>.png", "no target was <i>found</i>", "<i>corners.csv"):
        assert text not in raw
        assert text in found.text
    assert found.tags.count("i") == 0


def test_every_figure_is_on_the_page_with_words_and_beside_it_as_files(page: Path) -> None:
    found = Read(page)
    assert found.tags.count("img") == found.tags.count("figcaption") == len(FIGURES)
    assert all(len(value) > 40 for name, value in found.attributes if name == "alt")
    files = {path.name: path.read_bytes()[:5] for path in figures_folder(page).iterdir()}
    assert files == {f"{name}.png": b"\x89PNG\r" for name in FIGURES} | {f"{name}.pdf": b"%PDF-" for name in FIGURES}


def test_the_same_values_give_the_same_bytes(
    page: Path, calibration: Calibration, assessment: Assessment, tmp_path: Path
) -> None:
    again = tmp_path / "report.html"
    write_report(again, calibration, assessment, inputs=[Path("b") / "<i>corners.csv"])
    for first in (page, *figures_folder(page).iterdir()):
        assert (tmp_path / first.relative_to(page.parent)).read_bytes() == first.read_bytes(), first.name


def test_the_page_says_what_the_calibration_says(page: Path, calibration: Calibration) -> None:
    text = Read(page).text
    for stated in (
        f"{calibration.rms_px:.4f} px", f"{calibration.rms_with_rejected_px:.4f} px with the 4 rejected",
        "796 in 2 views; 1 view left out", "points to 90.0° of 92.0° claimed", "extrapolated",
        *calibration.camera.parameter_names,
    ):  # fmt: skip
        assert stated in text


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    small = Page("title", (), (), ())
    target = tmp_path / "report.html"
    write_page(target, small, overwrite=False)
    assert not figures_folder(target).exists()
    with pytest.raises(OutputError, match="exists already"):
        write_page(target, small, overwrite=False)
    folder = figures_folder(tmp_path / "other.html")
    folder.mkdir()
    (folder / "mine.txt").write_text("kept")
    with pytest.raises(OutputError, match=r"other-figures.*exists already"):
        check_report(tmp_path / "other.html", overwrite=False)


def test_a_failure_among_the_figures_leaves_all_files_as_they_were(
    calibration: Calibration, assessment: Assessment, tmp_path: Path
) -> None:
    target = tmp_path / "report.html"
    folder = figures_folder(target)
    (folder / "coverage.pdf").mkdir(parents=True)  # in the way of the last figure
    target.write_text("old")
    (folder / "lens-fit.png").write_text("old")
    (folder / "mine.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    page = report_page(calibration, assessment)
    few = dataclasses.replace(page, sections=(page.sections[1], page.sections[4]))  # lens-fit; ray-sigma, coverage
    with pytest.raises(OutputError, match=r"coverage\.pdf"):
        write_page(target, few, overwrite=True)
    assert sorted(tmp_path.rglob("*")) == before
    assert (target.read_text(), (folder / "lens-fit.png").read_text()) == ("old", "old")
    (folder / "coverage.pdf").rmdir()
    write_page(target, few, overwrite=True)
    assert target.read_text().startswith("<!DOCTYPE html>")
    assert (folder / "mine.txt").read_text() == "mine"


def test_a_selection_is_shown_with_those_that_could_not_be_fitted(
    calibration: Calibration, assessment: Assessment
) -> None:
    nan = math.nan
    rows = (
        Row("kannala-brandt", 5, 0.2, 0.21, 0.01, 0.2, 0.0, 0.0, 0.02, 80.0, "the best"),
        Row("bakstein-pajdla", 4, 0.3, 0.31, 0.01, 0.2, 0.1, 0.02, -0.4, 70.0, "behind"),
        Row("perspective", 1, nan, nan, nan, nan, nan, nan, nan, nan, "ends at 90 degrees"),
    )
    both = {row.lens: calibration for row in rows if row.fitted}
    selection = Selection(rows, "kannala-brandt", calibration, both, "every fifth view", "kannala-brandt is right.")
    page = report_page(calibration, assessment, selection)
    section = page.sections[1]
    assert section.paragraphs[0] == "kannala-brandt is right."
    assert [row[0] for row in section.tables[0].rows] == [row.lens for row in rows]
    assert section.tables[0].rows[2] == ("perspective", "1", "", "", "", "", "ends at 90 degrees")
    assert "-0.400 at 70°" in section.tables[0].rows[1]
    assert any("kannala-brandt suits these points better than bakstein-pajdla" in line for line in page.warnings)


def marks(calibration: Calibration, assessment: Assessment) -> dict[str, str]:
    return {finding.name: finding.mark for finding in findings(calibration, assessment)}


def test_the_verdict_follows_the_facts(calibration: Calibration, assessment: Assessment) -> None:
    near = dataclasses.replace(calibration, observed_theta_deg=(0.0, 40.0))
    assert marks(calibration, assessment)["Field of view, half"] == "look"
    assert marks(near, assessment)["Field of view, half"] == "poor"
    certain = dataclasses.replace(calibration, covariance_factor=1e-6 * calibration.covariance_factor)
    vague = dataclasses.replace(calibration, covariance_factor=1e3 * calibration.covariance_factor)
    assert marks(certain, assessment)["Curve's sigma at the rim"] == "good"
    assert marks(vague, assessment)["Curve's sigma at the rim"] == "poor"
    unverified = dataclasses.replace(assessment, verification=None, verification_missing="too few points")
    assert marks(calibration, unverified)["Fit to one half, judged by the other"] == "look"
    trend = assessment.trends[0]
    wave = dataclasses.replace(trend, p_value=1e-9, largest_px=2 * calibration.sigma_px)
    chance = dataclasses.replace(trend, p_value=0.5, largest_px=2 * calibration.sigma_px)
    small = dataclasses.replace(trend, p_value=1e-9, largest_px=0.1 * calibration.sigma_px)
    for trends, mark in (((wave, small), "poor"), ((chance, small), "good"), ((chance,), "good")):
        judged = dataclasses.replace(assessment, trends=trends)
        assert marks(calibration, judged)["Worst systematic error"] == mark


def test_each_warning_is_said_once(calibration: Calibration, assessment: Assessment) -> None:
    seen = dataclasses.replace(assessment.coverage, flags=("A gap.",))
    doubled = dataclasses.replace(assessment, coverage=seen, flags=("A gap.", "A wave."))
    said = warnings(calibration, doubled, None)
    assert said[:2] == ("A gap.", "A wave.")
    assert len(set(said)) == len(said)
    assert re.search("left out", said[-1])
