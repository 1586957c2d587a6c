"""Which lens suits the measurements: every kind fitted, and judged by views it never saw (section 4 of the paper)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from fullsphere.model.calibration.calibrate import Calibration, Progress
from fullsphere.model.calibration.points import View
from fullsphere.model.lens import Lens


class Row(NamedTuple):
    """One lens in the table of a selection; errors are sqrt(mean(du^2 + dv^2)), NaN where the lens was not fitted.

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
        In words; for a lens that was not fitted, why.
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
        return self.held_out_rms_px == self.held_out_rms_px


@dataclasses.dataclass(frozen=True, eq=False)
class Selection:
    """The lenses compared.

    Attributes
    ----------
    rows
        Every lens, the best on held-out points first, those that could not be fitted last.
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
    """Fit every lens, judge each by points it never saw, and choose; `options` are those of `calibrate`."""
    raise NotImplementedError
