"""A flat board that is not quite flat: two values for how it is bowed.

A sheet on a thin board bends like a shallow dish or saddle.  With x and y in [-1, 1] over the marks the paper stands
off its plane by  z = x_bow (1 - x^2) + y_bow (1 - y^2)  (the deflection of mrcal's optimiser): each value is how far
the middle stands off the line between two opposite edges, towards +z of the target's frame.
"""

from __future__ import annotations

import numpy as np

from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray

_FLAT = 1e-6  # of the extent: coordinates that are zero but for rounding


def bow_shapes(points: FloatArray) -> FloatArray:
    """Deflection along z per value (n, 2), at marks (n, 3) on a board with constant z.

    Raises
    ------
    GeometryError
        If the marks do not lie in a plane z = constant, or in a line.
    """
    low, high = points.min(0), points.max(0)
    extent = high - low
    if extent[2] > _FLAT * extent.max() or min(extent[:2]) <= _FLAT * extent.max():
        raise GeometryError(
            "calibration: the bow of a board was asked for, but the points are not those of one flat board with "
            "constant z; leave the bow out for targets in space"
        )
    x, y = ((2 * points - low - high) / np.where(extent > 0, extent, 1.0))[:, :2].T
    return np.stack([1 - x**2, 1 - y**2], -1)
