"""The verdict on a calibration at a glance: the lines at the top of its report, and the warnings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fullsphere.cli.page import Finding, Mark

if TYPE_CHECKING:
    from fullsphere.model.calibration.assess import Assessment
    from fullsphere.model.calibration.calibrate import Calibration
    from fullsphere.model.calibration.select import Selection

_UNLIKELY = 0.01
"""Probability below which chance is no explanation."""


def findings(calibration: Calibration, assessment: Assessment) -> tuple[Finding, ...]:
    """The verdict, a line for each question; the marks say what is as it should be and what is not."""
    return (
        _rms(calibration),
        _points(calibration),
        _field(calibration),
        _covered(assessment),
        _halves(assessment),
        _chi_square(assessment),
        _trend(calibration, assessment),
        _rim(calibration),
    )


def warnings(calibration: Calibration, assessment: Assessment, selection: Selection | None) -> tuple[str, ...]:
    """What a reader should know before using the camera, in whole sentences, each once."""
    said = [*assessment.flags, *assessment.coverage.flags]
    chosen = calibration.camera.lens.projection
    if selection is not None and selection.chosen != chosen:
        said.append(f"Of the lenses compared, {selection.chosen} suits these points better than {chosen}.")
    said += [f"{view.image} was left out: {view.reason}" for view in calibration.left_out]
    return tuple(dict.fromkeys(said))


def _graded(value: float, good: float, look: float) -> Mark:
    """A mark for a value that should be small."""
    return "good" if value <= good else "look" if value <= look else "poor"


def _rms(calibration: Calibration) -> Finding:
    text = f"{calibration.rms_px:.4f} px"
    if calibration.rejected:
        text += f"; {calibration.rms_with_rejected_px:.4f} px with the {calibration.rejected} rejected"
    return Finding("RMS reprojection error", text)


def _points(calibration: Calibration) -> Finding:
    views, left_out = len(calibration.views), len(calibration.left_out)
    text = f"{calibration.points} in {views} view{'' if views == 1 else 's'}"
    if left_out:
        text += f"; {left_out} view{'' if left_out == 1 else 's'} left out"
    rejected = calibration.rejected / (calibration.points + calibration.rejected)
    mark = _graded(rejected, 0.02, 0.1)
    return Finding("Points used", text, "look" if left_out and mark == "good" else mark)


def _field(calibration: Calibration) -> Finding:
    seen, claimed = calibration.observed_theta_deg[1], math.degrees(calibration.camera.half_fov)
    return Finding(
        "Field of view, half",
        f"points to {seen:.1f}° of {claimed:.1f}° claimed",
        _graded(claimed - seen, 1.0, 8.0),
    )


def _covered(assessment: Assessment) -> Finding:
    covered = assessment.coverage.covered
    return Finding("Field with points near by", f"{100 * covered:.1f} %", _graded(1 - covered, 0.1, 0.4))


def _halves(assessment: Assessment) -> Finding:
    check, name = assessment.verification, "Fit to one half, judged by the other"
    if check is None:
        return Finding(name, "not possible with so few points", "look")
    text = f"{check.fit_rms_px:.4f} px and {check.verify_rms_px:.4f} px"
    return Finding(name, text, _graded(check.verify_rms_px / check.expected_verify_rms_px, 1.1, 1.4))


def _chi_square(assessment: Assessment) -> Finding:
    name = "Chi-square test of the errors"
    if assessment.verification is None:
        return Finding(name, "not possible with so few points", "look")
    p = assessment.verification.chi_square.p_value
    shown = "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
    like = "like noise" if p >= _UNLIKELY else "not noise of one size"
    return Finding(name, f"{like} (p {shown})", "good" if p >= _UNLIKELY else "look")


def _trend(calibration: Calibration, assessment: Assessment) -> Finding:
    real = [t for t in assessment.trends if t.p_value < _UNLIKELY]
    if not real:
        return Finding("Worst systematic error", "none that chance does not explain", "good")
    worst = max(real, key=lambda t: abs(t.largest_px))
    angle = "θ" if worst.against == "theta" else "φ"
    text = f"{abs(worst.largest_px):.3f} px {worst.part} at {angle} = {worst.at_deg:.0f}°"
    return Finding("Worst systematic error", text, _graded(abs(worst.largest_px) / calibration.sigma_px, 0.3, 1.0))


def _rim(calibration: Calibration) -> Finding:
    from fullsphere.model.calibration.calibrate import curve_of

    curve = curve_of(calibration)
    theta, sigma = float(curve.theta_deg[-1]), float(curve.sigma_px[-1])
    slope = float(calibration.camera.lens.slope(math.radians(theta)))
    text = f"{sigma:.3f} px ({math.degrees(sigma / slope):.3f}°) at {theta:.0f}°"
    return Finding("Curve's sigma at the rim", text, _graded(sigma / calibration.sigma_px, 1.0, 5.0))
