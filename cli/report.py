"""The calibration report: what was found, how good it is, and what is not known, on one page."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from fullsphere.cli.page import Page, check_page, write_page
from fullsphere.cli.report_sections import (
    candidates_section,
    directions_section,
    inputs_section,
    lens_section,
    noise_section,
    systematic_section,
    views_section,
)
from fullsphere.cli.verdict import findings, warnings
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.candidates import misfits_of_calibrations, misfits_of_fitted_lenses

if TYPE_CHECKING:
    from fullsphere.model.calibration.assess import Assessment
    from fullsphere.model.calibration.select import Selection


check_report = check_page


def write_report(
    path: Path,
    calibration: Calibration,
    assessment: Assessment,
    selection: Selection | None = None,
    overwrite: bool = False,
    inputs: Iterable[Path] = (),
) -> None:
    """Write the report of a calibration as one HTML page, and its figures as PNG and PDF into a folder beside it.

    The page needs nothing but itself: figures and style are in it, and no script.  The same values give the same bytes.

    Parameters
    ----------
    path
        The page; figures go into the folder `<stem>-figures` beside it.
    calibration
        What is reported.
    assessment
        Its assessment.
    selection
        The comparison of lenses that led to it; without one, other lenses are fitted to the measured radii only.
    overwrite
        Whether files that exist may be replaced.
    inputs
        Files it was made from, to be named.

    Raises
    ------
    OutputError
        If a file cannot be written, or exists and `overwrite` is false; then none is.
    """
    write_page(path, report_page(calibration, assessment, selection, inputs), overwrite)


def report_page(
    calibration: Calibration, assessment: Assessment, selection: Selection | None = None, inputs: Iterable[Path] = ()
) -> Page:
    """The content of the report; the arguments are those of `write_report`."""
    camera = calibration.camera
    if selection is None:
        misfits = misfits_of_fitted_lenses(calibration)
    else:
        misfits = misfits_of_calibrations(selection.calibrations)
    sections = (
        lens_section(calibration),
        candidates_section(calibration, misfits, selection),
        noise_section(calibration, assessment),
        systematic_section(assessment),
        directions_section(calibration, assessment),
        views_section(calibration, assessment),
        *inputs_section(inputs),
    )
    title = f"Calibration of a {camera.lens.projection} lens, {camera.size[0]} × {camera.size[1]} pixels"
    return Page(title, findings(calibration, assessment), warnings(calibration, assessment, selection), sections)
