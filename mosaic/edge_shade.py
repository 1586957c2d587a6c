"""What the edge of a lens takes beside its vignetting: in the last degrees light falls steeper than any smooth law."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray

KNOTS = np.linspace(0.9, 1, 6)
"""Of s = (theta/half_fov)^2: between them the shade is linear, up to the first there is none."""

_LEAST_VALUES = 300  # fewer may all be of one thing that is near
_LEAST_EV = 0.05  # less than this is no shade but what the vignetting's law leaves
_MOST_EV = 4.0  # what is darker shows nothing
_STEPS, _SURE_EV = 20, 0.03  # of weights that make the fit one of medians, and where they level off
_SMOOTH = 0.002  # of the values' number: what second differences of the knots weigh


def shade_at(s: FloatArray, shade_ev: tuple[float, ...]) -> FloatArray:
    """EV, none above 0, that the edge takes at s (...); `shade_ev` is that at all knots but the first, or empty."""
    return np.interp(s, KNOTS, (0.0, *shade_ev)) if shade_ev else np.zeros(np.shape(s))


def edge_shade(
    scene: NDArray[np.float32], s: NDArray[np.float32], camera: NDArray[np.intp], cameras: int
) -> tuple[tuple[float, ...], ...]:
    """Measure the shade of each camera where other frames see inside their edges what it sees at its own.

    Parameters
    ----------
    scene
        (n, d, 3) log2 of the light of the scene in d directions as each of n frames tells it when its exposure, tint
        and vignetting are taken out; NaN where it is not known.
    s
        (n, d) (theta/half_fov)^2 of the directions in the frames.
    camera
        (n,) which camera took each frame, of so many `cameras`.
    """
    inside = np.isfinite(scene) & (s < KNOTS[0])[..., None]
    count = inside.sum(0)
    mean = np.where(inside, scene, 0).sum(0) / np.maximum(count, 1)
    off = np.where(count > 0, scene - mean, np.nan)
    shades = []
    for k in range(cameras):
        own = (camera == k)[:, None] & (s >= KNOTS[0])
        values, at = off[own], np.repeat(s[own], off.shape[2]).astype(np.float64)
        known = np.isfinite(values.ravel())
        shades.append(_fitted(values.ravel()[known].astype(np.float64), at[known]))
    return tuple(shades)


def _fitted(values: FloatArray, at: FloatArray) -> tuple[float, ...]:
    """The shade at the knots that leaves the least sum of absolute residuals; it only grows towards the rim."""
    if len(values) < _LEAST_VALUES:
        return ()
    hats = np.array([np.interp(at, KNOTS, unit) for unit in np.eye(len(KNOTS))[1:]]).T
    bends = np.diff(np.eye(len(KNOTS)), 2, axis=0)[:, 1:]  # the first knot is at 0
    smooth = _SMOOTH * len(values) * bends.T @ bends
    weight = np.ones(len(values))
    for _ in range(_STEPS):
        shade = np.linalg.solve(hats.T @ (hats * weight[:, None]) + smooth, hats.T @ (values * weight))
        weight = _SURE_EV / np.maximum(np.abs(values - hats @ shade), _SURE_EV)
    falling = np.clip(np.minimum.accumulate(np.minimum(shade, 0)), -_MOST_EV, 0)
    return tuple(falling.tolist()) if falling[-1] < -_LEAST_EV else ()
