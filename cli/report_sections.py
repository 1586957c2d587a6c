"""The parts of the calibration report: each turns what is known of a calibration into words, tables and figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fullsphere.cli.page import Section, Table
from fullsphere.model.calibration.calibrate import Calibration, curve_of
from fullsphere.model.calibration.observed import observed

if TYPE_CHECKING:
    from fullsphere.cli.figures import Drawing
    from fullsphere.model.calibration.assess import Assessment
    from fullsphere.model.calibration.candidates import Misfit
    from fullsphere.model.calibration.select import Selection

_INTERCHANGEABLE = (
    "The values of the formula are nearly interchangeable: quite different ones give nearly the same curve, and their "
    "own sigmas say little. Compare curves, never values."
)
_STEP_DEG = 10  # between the rows of the curve's table


def lens_section(calibration: Calibration) -> Section:
    """What was found: the curve with its sigma, and the values of the formula."""
    from fullsphere.cli.plots_lens import curve_sigma, projection_functions

    camera, curve = calibration.camera, curve_of(calibration)
    sigma = np.linalg.norm(calibration.covariance_factor, axis=1)
    values = Table(
        ("value", "found", "one sigma, by itself"),
        tuple(
            (name, f"{value:.7g}", f"{error:.2g}")
            for name, value, error in zip(camera.parameter_names, camera.values, sigma, strict=True)
        ),
    )
    highest = calibration.observed_theta_deg[1]
    last = int(curve.theta_deg[-1])
    rows = [
        (
            f"{theta}",
            f"{curve.r_px[theta]:.3f}",
            f"{curve.sigma_px[theta]:.4f}",
            f"{math.degrees(curve.sigma_px[theta] / float(camera.lens.slope(math.radians(theta)))):.4f}",
            "extrapolated" if theta > highest else "",
        )
        for theta in np.unique([*range(0, last + 1, _STEP_DEG), last]).tolist()
    ]
    table = Table(("θ (degrees)", "r (px)", "sigma (px)", "sigma (degrees)", ""), tuple(rows), texts=(4,))
    return Section(
        "The lens",
        (
            "The curve r(θ) is the result: the distance from the centre at which a direction θ off the axis is imaged.",
            *((_INTERCHANGEABLE,) if len(camera.lens.parameters) > 1 else ()),
            *_bow(calibration),
        ),
        (table, values),
        (
            projection_functions(camera),
            curve_sigma(curve.theta_deg, curve.sigma_px, calibration.observed_theta_deg),
        ),
    )


def _bow(calibration: Calibration) -> tuple[str, ...]:
    if calibration.bow_mm is None:
        return ()
    x, y = calibration.bow_mm
    return (f"The board was found to be bowed by {x:.3f} mm along its x axis and {y:.3f} mm along its y axis.",)


def candidates_section(calibration: Calibration, misfits: Sequence[Misfit], selection: Selection | None) -> Section:
    """The calibrated lens among others: the comparison of a selection, or shapes fitted to the measured radii."""
    from fullsphere.cli.plots_lens import fit_of_lenses

    chosen = calibration.camera.lens.projection
    drawing = fit_of_lenses(misfits, chosen, calibration.observed_theta_deg[1])
    if selection is None:
        ranked = sorted(misfits, key=lambda misfit: misfit.rms_px)
        rows = tuple((m.lens + (" (this one)" if m.lens == chosen else ""), f"{m.rms_px:.4f}") for m in ranked)
        text = (
            "Every lens that reaches the outermost point, fitted to the measured radii with centre and poses as they "
            "were found with this lens. This tells shapes apart, but it is no contest: that is calibrating with each "
            "lens and judging by points it never saw."
        )
        return Section("Other lenses", (text,), (Table(("lens", "rms of the radius (px)"), rows),), (drawing,))
    table = Table(
        ("lens", "values", "rms of fit (px)", "rms held out (px)", "behind the best (px)", "largest misfit (px)", ""),
        tuple(
            (
                row.lens,
                str(row.parameters),
                *(
                    (
                        f"{row.fit_rms_px:.4f}",
                        f"{row.held_out_rms_px:.4f} ± {row.held_out_error_px:.4f}",
                        f"{row.behind_px:.4f} ± {row.behind_error_px:.4f}",
                        f"{row.misfit_px:+.3f} at {row.misfit_theta_deg:.0f}°",
                    )
                    if row.fitted
                    else ("", "", "", "")
                ),
                row.verdict,
            )
            for row in selection.rows
        ),
        texts=(0, 6),
    )
    return Section("Which lens", (selection.verdict, f"Held out: {selection.held_out}."), (table,), (drawing,))


def noise_section(calibration: Calibration, assessment: Assessment) -> Section:
    """What the fit leaves over, point by point, and whether it is noise."""
    from fullsphere.cli.plots_picture import reprojection
    from fullsphere.cli.plots_points import chi_square, error_by_point, error_by_theta

    lengths, used, view, theta = _by_sighting(calibration)
    drawings: list[Drawing] = [
        reprojection(calibration),
        error_by_point(lengths, used, view, calibration.rms_px),
        error_by_theta(lengths, used, theta, calibration.rms_px),
    ]
    check = assessment.verification
    if check is None:
        missing = f"There is no verification by halves: {assessment.verification_missing.rstrip('.')}."
        return Section("What is left over", (missing,), (), tuple(drawings))
    table = Table(
        ("", "points", "rms (px)", "expected of noise (px)"),
        (
            (
                "half that was fitted",
                f"{check.fit_points}",
                f"{check.fit_rms_px:.4f}",
                f"{check.expected_fit_rms_px:.4f}",
            ),
            (
                "half that was not seen",
                f"{check.verify_points}",
                f"{check.verify_rms_px:.4f}",
                f"{check.expected_verify_rms_px:.4f}",
            ),
        ),
    )
    text = (
        "As in the paper, the camera was fitted once more to a random half of the points, and judged by the other "
        "half. An error much larger on the half that was not seen means that the points are too few for the model."
    )
    return Section("What is left over", (text,), (table,), (*drawings, chi_square(check.chi_square)))


def _by_sighting(calibration: Calibration) -> tuple[Any, ...]:
    """Length of each residual, whether it was used, its view, and the angle from the axis (that of the picture)."""
    residuals = np.concatenate(calibration.residuals_px)
    used = np.concatenate(calibration.used).astype(bool)
    view = np.repeat(np.arange(len(calibration.views)), [len(v.pixels) for v in calibration.views])
    rays = calibration.camera.unproject(np.concatenate([v.pixels for v in calibration.views]))
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    theta[used] = observed(calibration).theta
    return np.hypot(residuals[:, 0], residuals[:, 1]), used, view, theta


def systematic_section(assessment: Assessment) -> Section:
    """The part of the residuals that does not average out."""
    from fullsphere.cli.plots_points import probability, trend

    trends = Table(
        ("part", "against", "largest mean (px)", "at (degrees)", "p"),
        tuple(
            (
                t.part,
                {"theta": "angle from the axis θ", "phi": "angle round the axis φ"}[t.against],
                f"{t.largest_px:+.3f}",
                f"{t.at_deg:.0f}",
                probability(t.p_value),
            )
            for t in assessment.trends
        ),
        texts=(0, 1),
    )
    waves = Table(
        ("wave round the axis", "size (px)", "error (px)", "p"),
        tuple(
            (
                f"{h.part}, {'once' if h.order == 1 else 'twice'} round",
                f"{h.amplitude_px:.4f}",
                f"{h.error_px:.4f}",
                probability(h.p_value),
            )
            for h in assessment.harmonics
        ),
    )
    by = {(t.part, t.against): t for t in assessment.trends}
    drawings = tuple(trend(by["radial", a], by["tangential", a]) for a in ("theta", "phi"))
    text = (
        "Noise averages out; what remains of the mean residual over many points is systematic. p is the probability "
        "that chance alone gives so much. With thousands of points even a hundredth of a pixel can be told from "
        "chance: what matters is its size."
    )
    return Section("Systematic errors", (text,), (trends, waves), drawings)


def directions_section(calibration: Calibration, assessment: Assessment) -> Section:
    """How certain directions are, and where points were seen."""
    from fullsphere.cli.plots_picture import coverage, ray_sigma

    seen = assessment.coverage
    lowest, highest = seen.observed_theta_deg
    text = (
        f"Points were seen from {lowest:.1f} to {highest:.1f} degrees from the axis; the field of view is stated as "
        f"{seen.half_fov_deg:.1f} degrees to every side. {100 * seen.covered:.1f} % of its solid angle have a point "
        f"within {seen.near_deg:.1f} degrees, and {100 * seen.extrapolated:.1f} % lie beyond the outermost point."
    )
    drawings = (ray_sigma(calibration.camera, assessment.ray_sigma), coverage(calibration, seen))
    return Section("Directions and coverage", (text,), (), drawings)


def views_section(calibration: Calibration, assessment: Assessment) -> Section:
    """Errors view by view, and the views left out."""
    table = Table(
        ("view", "points", "rejected", "rms (px)", "worst (px)", "at (px)"),
        tuple(
            (
                view.image,
                f"{view.used}",
                f"{view.rejected}",
                f"{view.rms_px:.4f}",
                f"{view.worst_px:.3f}",
                f"({view.worst_at_px[0]:.0f}, {view.worst_at_px[1]:.0f})",
            )
            for view in assessment.views
        ),
    )
    if not calibration.left_out:
        return Section("Views", ("No view was left out.",), (table,))
    left_out = Table(
        ("left out", "reason"), tuple((view.image, view.reason) for view in calibration.left_out), texts=(0, 1)
    )
    return Section("Views", (), (table, left_out))


def inputs_section(inputs: Iterable[Path]) -> tuple[Section, ...]:
    """The files the calibration was made from; no section where none is named."""
    names = ", ".join(path.name for path in inputs)
    return (Section("Made from", (names,)),) if names else ()
