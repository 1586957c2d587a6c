"""Which lens suits the measurements: every kind fitted, and judged by points it never saw (section 4 of the paper)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.calibrate import Calibration, Progress, calibrate
from fullsphere.model.calibration.held_out import Judged, held_out_residuals, judged_points
from fullsphere.model.calibration.points import View
from fullsphere.model.calibration.trends import radial_trend
from fullsphere.model.errors import CameraError, GeometryError, UsageError
from fullsphere.model.lens import LENSES, BaksteinPajdla, FloatArray, Lens

_CLEARLY = 3.0  # standard errors of a paired difference that are no chance
_MUCH = 0.03  # of the best lens's error: less is not worth another lens
_PAPER = BaksteinPajdla.projection


class Row(NamedTuple):
    """One lens in the table of a selection; errors are sqrt(mean(du^2 + dv^2)), NaN where the lens was not judged.

    Attributes
    ----------
    lens
        Its name.
    parameters
        Number of its own values (centre and aspect come on top for every lens).
    fit_rms_px
        Of the fit to all views, over the points used.
    held_out_rms_px, held_out_error_px
        On views (or points) that the fit never saw, and the standard error.
    held_out_median_px
        Median distance on the same points: what few bad ones cannot move.
    behind_px, behind_error_px
        How much larger the held-out rms is than the best lens's, and the standard error of that difference, paired
        view by view: what is hard about a view is hard for every lens, so this is much sharper than the error of
        either.
    misfit_px, misfit_theta_deg
        The largest systematic radial residual of the fit (with its sign), and the angle where it stands.
    verdict
        In words; for a lens that was not judged, why.
    """

    lens: str
    parameters: int
    fit_rms_px: float
    held_out_rms_px: float
    held_out_error_px: float
    held_out_median_px: float
    behind_px: float
    behind_error_px: float
    misfit_px: float
    misfit_theta_deg: float
    verdict: str

    @property
    def fitted(self) -> bool:
        """Whether the lens could be fitted and judged."""
        return math.isfinite(self.held_out_rms_px)


@dataclasses.dataclass(frozen=True, eq=False)
class Selection:
    """The lenses compared.

    Attributes
    ----------
    rows
        Every lens, the best on held-out points first, those that could not be judged last.
    chosen
        Name of the simplest lens within one standard error of the best.
    calibration
        The chosen lens fitted to all views.
    calibrations
        Every lens that was fitted, by name.
    held_out
        How points were held out, in words.
    verdict
        Which lens is right, and whether the Bakstein-Pajdla lens is.
    """

    rows: tuple[Row, ...]
    chosen: str
    calibration: Calibration
    calibrations: Mapping[str, Calibration]
    held_out: str
    verdict: str


def select(
    views: Sequence[View],
    image_size: tuple[int, int],
    lenses: Sequence[str | type[Lens]] | None = None,
    *,
    folds: int = 5,
    progress: Progress = iter,
    **options: Any,
) -> Selection:
    """Fit every lens, judge each by points it never saw, and choose the simplest that is as good as the best.

    Parameters
    ----------
    views, image_size
        As for `calibrate`.
    lenses
        Those to compare; all by default.
    folds
        Into how many parts the views are dealt; each part is predicted by a fit to the others.  Fewer views are left
        out one by one; one view is predicted half by half.  See `held_out`.
    progress
        Wraps the lenses, which are fitted first and then judged.
    options
        Passed to `calibrate`.

    Raises
    ------
    GeometryError
        If no lens can be fitted and judged; the message gives each one's reason.
    UsageError
        If there is no such lens, none is given, or fewer than two folds.
    """
    if folds < 2:
        raise UsageError(f"selection: {folds} folds; at least 2 are needed, so that something is left to fit")
    kinds = _kinds(lenses)
    fitted: dict[str, Calibration] = {}
    reasons: dict[str, str] = {}
    given = tuple(views)
    for name, kind in progress(kinds.items()):
        try:
            fitted[name] = calibrate(given, image_size, kind, **options)
        except (GeometryError, CameraError) as error:
            reasons[name] = str(error)
    if not fitted:
        raise GeometryError(_nothing(reasons))
    judged = judged_points(given, tuple(fitted.values()), folds)
    squared: dict[str, FloatArray] = {}
    for name, calibration in fitted.items():
        try:
            squared[name] = np.sum(held_out_residuals(judged, calibration) ** 2, -1)
        except GeometryError as error:
            reasons[name] = f"fitted to a part of the points it does not predict the others ({error})"
    if not squared:
        raise GeometryError(_nothing(reasons))
    rows = _rows(kinds, fitted, judged, squared)
    chosen = _simplest(rows)
    listed = [row._replace(verdict=_row_verdict(row, rows[0], chosen)) for row in rows]
    listed += [_without(kinds[name], fitted.get(name), reasons[name]) for name in kinds if name in reasons]
    return Selection(
        tuple(listed), chosen.lens, fitted[chosen.lens], fitted, judged.described, _verdict(rows, chosen, reasons)
    )


def _kinds(lenses: Sequence[str | type[Lens]] | None) -> dict[str, type[Lens]]:
    kinds: dict[str, type[Lens]] = {}
    for lens in LENSES if lenses is None else lenses:
        if isinstance(lens, str) and lens not in LENSES:
            raise UsageError(f"there is no lens {lens!r}; the lenses are {', '.join(LENSES)}")
        kind = LENSES[lens] if isinstance(lens, str) else lens
        kinds[kind.projection] = kind
    if not kinds:
        raise UsageError("selection: no lens was given to choose from")
    return kinds


def _nothing(reasons: dict[str, str]) -> str:
    if len(set(reasons.values())) == 1:
        return next(iter(reasons.values()))
    return "selection: no lens fits these points. " + "; ".join(f"{name}: {why}" for name, why in reasons.items())


def _rows(
    kinds: dict[str, type[Lens]], fitted: dict[str, Calibration], judged: Judged, squared: dict[str, FloatArray]
) -> list[Row]:
    """The lenses judged, the best first; without verdicts."""
    best = min(squared, key=lambda name: float(np.mean(squared[name])))
    least = math.sqrt(float(np.mean(squared[best])))
    rows = []
    for name, errors in squared.items():
        rms, trend = math.sqrt(float(np.mean(errors))), radial_trend(fitted[name])
        rows.append(
            Row(
                name,
                len(kinds[name].parameters),
                fitted[name].rms_px,
                rms,
                _error_of_mean(errors, judged.unit) / max(2 * rms, 1e-300),
                math.sqrt(float(np.median(errors))),
                rms - least,
                _error_of_mean(errors - squared[best], judged.unit) / max(rms + least, 1e-300),
                trend.largest_px,
                trend.at_deg,
                "",
            )
        )
    return sorted(rows, key=lambda row: row.held_out_rms_px)


def _error_of_mean(values: FloatArray, unit: NDArray[np.intp]) -> float:
    """Standard error of the mean of values (N,), of which those of one unit belong together.

    With sums s and counts n of U units and mean m, the ratio estimate's variance U/(U - 1) sum (s - m n)^2 / N^2.
    """
    sums, counts = np.bincount(unit, values), np.bincount(unit)
    units = int(np.count_nonzero(counts))
    left = sums - np.mean(values) * counts
    return math.sqrt(units / max(units - 1, 1) * float(np.sum(left**2))) / len(values)


def _simplest(rows: list[Row]) -> Row:
    """The lens of fewest values within one standard error of the best; the better of several such."""
    return min((row for row in rows if row.behind_px <= row.behind_error_px), key=lambda row: row.parameters)


def _difference(row: Row) -> str:
    return f"{row.behind_px:.4f} +- {row.behind_error_px:.4f} px"


def _is_clearly_behind(row: Row, best: Row) -> bool:
    return row.behind_px > max(_CLEARLY * row.behind_error_px, _MUCH * best.held_out_rms_px)


def _is_wrong(row: Row, best: Row) -> bool:
    """Whether the lens cannot follow the points: one that follows them, and predicts others badly, is too free."""
    return _is_clearly_behind(row, best) and row.fit_rms_px > (1 + _MUCH) * best.fit_rms_px


def _misfit(row: Row) -> str:
    return f"its radial residual is systematic, {row.misfit_px:+.2g} px at {row.misfit_theta_deg:.0f} degrees"


def _row_verdict(row: Row, best: Row, chosen: Row) -> str:
    if row.lens == best.lens:
        return "the best, and chosen" if chosen.lens == best.lens else "the best, but a simpler lens is as good"
    if row.lens == chosen.lens:
        return f"chosen: the simplest that is as good as the best (behind by {_difference(row)})"
    if row.behind_px <= row.behind_error_px:
        return f"as good as the best (behind by {_difference(row)})"
    if _is_wrong(row, best):
        return f"wrong for this lens: behind by {_difference(row)}; {_misfit(row)}"
    if _is_clearly_behind(row, best):
        return f"too free for so few points: it fits as well as the best, but predicts worse, by {_difference(row)}"
    slightly = "slightly " if row.behind_px <= _MUCH * best.held_out_rms_px else ""
    return f"{slightly}behind, by {_difference(row)}"


def _without(kind: type[Lens], calibration: Calibration | None, reason: str) -> Row:
    nan = math.nan
    rms = nan if calibration is None else calibration.rms_px
    return Row(kind.projection, len(kind.parameters), rms, nan, nan, nan, nan, nan, nan, nan, reason)


def _verdict(rows: list[Row], chosen: Row, reasons: dict[str, str]) -> str:
    best = rows[0]
    text = f"Use the {chosen.lens} lens: {chosen.held_out_rms_px:.4f} px rms on points that its fit never saw"
    text += "." if chosen.lens == best.lens else f", as good as the best ({best.lens}, {best.held_out_rms_px:.4f} px)."
    if _PAPER in reasons:
        return f"{text} The {_PAPER} lens could not be compared: {reasons[_PAPER]}."
    paper = next((row for row in rows if row.lens == _PAPER), None)
    if paper is None or paper.lens == chosen.lens:
        return text
    if _is_wrong(paper, best):
        return (
            f"{text} The {_PAPER} lens is not the right model here: its error on such points, "
            f"{paper.held_out_rms_px:.4f} px, is {_difference(paper)} above that of the {best.lens} lens, and "
            f"{_misfit(paper)}."
        )
    if paper.behind_px <= paper.behind_error_px:
        return f"{text} The {_PAPER} lens is as good as any ({paper.held_out_rms_px:.4f} px)."
    if _is_clearly_behind(paper, best):
        return (
            f"{text} The {_PAPER} lens fits as well, but predicts worse ({paper.held_out_rms_px:.4f} px): it is too "
            "free for so few points; more views would tell."
        )
    if paper.behind_px <= _MUCH * best.held_out_rms_px:
        return (
            f"{text} The {_PAPER} lens ({paper.held_out_rms_px:.4f} px) is behind by {_difference(paper)}, "
            f"{100 * paper.behind_px / best.held_out_rms_px:.1f} %: too little to matter."
        )
    return (
        f"{text} The {_PAPER} lens ({paper.held_out_rms_px:.4f} px) is behind by {_difference(paper)}: too "
        "uncertain to rule it out; more views would tell."
    )
