"""A lens of any kind comes near to a curve that is no formula of ours."""

from __future__ import annotations

import math

import numpy as np

from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.lens import BaksteinPajdla


def test_the_papers_lens_follows_the_published_curve_of_its_converter() -> None:
    """Nikon FC-E8: r / r(90) = 0.681 theta - 0.028253 theta^2, as measured by others on another camera."""
    theta = np.radians(np.linspace(0.5, 90.0, 180))
    radius = 1000.0 * (0.681 * theta - 0.028253 * theta**2)
    lens = fitted_lenses(BaksteinPajdla, theta, radius)[0]
    error = lens.radius(theta) - radius
    assert math.sqrt(float(np.mean(error**2))) <= 0.5e-3 * radius[-1]
