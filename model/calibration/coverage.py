"""Where in the field of view points were seen, and what is therefore extrapolated."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Coverage:
    """How the observed points fill the field of view.

    Attributes
    ----------
    observed_theta_deg
        Smallest and largest angle from the axis at which a point was seen.
    half_fov_deg
        Half field of view of the camera.
    near_deg
        The angle within which a direction counts as covered.
    covered
        Share of the field's solid angle with a point within `near_deg`.
    extrapolated
        Share of the field's solid angle beyond the largest observed angle.
    gap_deg, gap_theta_deg, gap_phi_deg
        Angle from the loneliest direction inside the field to its nearest point, and that direction.
    views
        Number of views.
    flags
        What a reader should know, in whole sentences; empty where nothing is missing.
    """

    observed_theta_deg: tuple[float, float]
    half_fov_deg: float
    near_deg: float
    covered: float
    extrapolated: float
    gap_deg: float
    gap_theta_deg: float
    gap_phi_deg: float
    views: int
    flags: tuple[str, ...]
