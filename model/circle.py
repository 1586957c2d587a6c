"""Where the image circle of a circular fisheye frame lies.

The paper takes the centre of the visible circle as the image centre; its radius sets the scale of the lens.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, angle_of_radius

SEARCH_SIDE_PX = 1000
"""Pictures are searched at this size: the rim is found to a fraction of a pixel all the same."""

_DIRECTIONS = 1440
_TOLERANCE = 0.006  # of the radius: how far a rim point may lie off the circle


class ImageCircle(NamedTuple):
    """Centre (u, v) and radius in pixels of the lit disc of a frame."""

    centre: tuple[float, float]
    radius: float

    def covers(self, size: tuple[int, int], aspect: float = 1.0) -> NDArray[np.bool_]:
        """Which pixels (h, w) of a picture of (width, height) lie on the disc; `aspect` is that of the camera."""
        v, u = np.ogrid[: size[1], : size[0]]
        covered: NDArray[np.bool_] = (u - self.centre[0]) ** 2 + ((v - self.centre[1]) / aspect) ** 2 <= self.radius**2
        return covered

    def scaled(self, factor: float) -> ImageCircle:
        """The circle in the picture grown by `factor`."""
        u, v = self.centre
        return ImageCircle(((u + 0.5) * factor - 0.5, (v + 0.5) * factor - 0.5), self.radius * factor)


def within_circle(camera: Camera, circle: ImageCircle | None) -> Camera:
    """The camera with its field of view ended at the image circle, where it reached further.

    A calibration does not see where the lens ends: this is what a picture says of it.
    """
    if circle is None or circle.radius >= camera.image_radius:
        return camera
    half_fov = float(angle_of_radius(camera.lens, circle.radius, camera.half_fov))
    return dataclasses.replace(camera, half_fov=half_fov)


def brightest(pictures: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """The largest value of each pixel over pictures (h, w, c) of one size, and over their channels: (h, w).

    Over several frames a dark thing at the rim of one is outshone by another: the lit disc shows best.
    """
    highest: NDArray[np.uint8] = pictures[0][..., 0].copy()
    for picture in pictures:
        for channel in np.moveaxis(picture, -1, 0):  # NumPy's maximum over so short an axis takes twenty times as long
            np.maximum(highest, channel, out=highest)
    return highest


def find_circle(brightness: NDArray[np.uint8]) -> ImageCircle | None:
    """The image circle in a picture (h, w) of 8-bit brightness, or None where there is none to be seen.

    The disc may be cut by the picture's border.  None is answered when the corners are lit (an ordinary or a
    full-frame fisheye picture), and when what is lit is not round.
    """
    height, width = brightness.shape
    factor = min(1.0, SEARCH_SIDE_PX / max(height, width))
    small = cv2.resize(brightness, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA).astype(np.float32)
    threshold = _lit_threshold(small)
    if threshold is None:
        return None
    small = cv2.GaussianBlur(small, (0, 0), 0.8)
    lit = small > threshold
    rows, columns = np.flatnonzero(lit.mean(1) > 0.02), np.flatnonzero(lit.mean(0) > 0.02)
    if rows.size == 0 or columns.size == 0:
        return None
    middle = np.array([columns[0] + columns[-1], rows[0] + rows[-1]]) / 2
    found = _fit_circle(_rim_points(small, middle, threshold, None))
    if found is not None:
        # Light scattered in the barrel shines a little past the rim: the edge proper is at half of what is inside it.
        found = _fit_circle(_rim_points(small, np.array(found[:2]), threshold, found[2])) or found
    if found is None:
        return None
    u, v, radius = found
    fx, fy = small.shape[1] / width, small.shape[0] / height
    return ImageCircle(((u + 0.5) / fx - 0.5, (v + 0.5) / fy - 0.5), radius / (0.5 * (fx + fy)))


def corner_levels(brightness: NDArray[np.uint8] | NDArray[np.float32]) -> tuple[float, float]:
    """How bright the two darker corners of a picture (h, w) are at most, and how bright what is lit."""
    side = max(3, min(brightness.shape) // 25)
    across = (brightness[:side], brightness[-side:])
    corners = [corner for rows in across for corner in (rows[:, :side], rows[:, -side:])]
    levels = sorted(float(np.percentile(corner, 90)) for corner in corners)
    return levels[1], float(np.percentile(brightness, 98))  # a small disc is lit too


def _lit_threshold(small: NDArray[np.float32]) -> float | None:
    """The brightness that separates the disc from the dark around it; None when fewer than two corners are dark."""
    dark, lit = corner_levels(small)
    if dark > 0.25 * lit or lit < 8:
        return None
    return dark + max(4.0, 0.08 * (lit - dark))


def _rim_points(small: NDArray[np.float32], middle: FloatArray, threshold: float, radius: float | None) -> FloatArray:
    """For each direction from `middle`, the outermost crossing of the threshold: (n, 2).

    With a `radius` known roughly, the threshold of a direction is raised to half of the brightness just inside it.
    """
    height, width = small.shape
    angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    direction = np.stack([np.cos(angle), np.sin(angle)], -1)
    with np.errstate(divide="ignore"):
        to_border = np.where(direction > 0, ([width - 1, height - 1] - middle) / direction, -middle / direction).min(-1)
    steps = np.arange(0, np.ceil(to_border.max()) + 1, 0.5)
    at = np.empty((_DIRECTIONS, len(steps), 2), np.float32)
    for axis in range(2):
        at[..., axis] = middle[axis] + steps * direction[:, axis, None]
    profile = cv2.remap(small, at, None, cv2.INTER_LINEAR, borderValue=-1.0)
    level = np.full(_DIRECTIONS, threshold)
    if radius is not None:
        inside = profile[:, (steps > 0.92 * radius) & (steps < 0.97 * radius)]
        level = np.maximum(level, 0.5 * np.median(inside, axis=1))
    above = profile > level[:, None]
    last = len(steps) - 1 - above[:, ::-1].argmax(1)
    # Not where nothing is lit, and where the disc is cut by the border.
    ways = np.flatnonzero(above.any(1) & (steps[last] <= to_border - 1.5))
    last = last[ways]
    lit, dark = profile[ways, last], profile[ways, last + 1]
    fraction = (lit - level[ways]) / np.maximum(lit - dark, 1e-6)
    return np.asarray(middle + (steps[last] + 0.5 * fraction)[:, None] * direction[ways])


def _fit_circle(points: FloatArray) -> tuple[float, float, float] | None:
    """The circle that most rim points lie on, refined by least squares; None if they are too few or too one-sided."""
    if len(points) < _DIRECTIONS // 8:
        return None
    rng = np.random.default_rng(0)
    best = np.zeros(len(points), bool)
    for _ in range(300):
        circle = _algebraic_circle(points[rng.choice(len(points), 3, replace=False)])
        near = _near(points, circle)
        if near.sum() > best.sum():
            best = near
    for _ in range(10):
        if best.sum() < _DIRECTIONS // 8:
            return None
        circle = _algebraic_circle(points[best])
        best = _near(points, circle)
    u, v, radius = circle
    sector = np.floor(np.arctan2(points[best, 1] - v, points[best, 0] - u) / (np.pi / 6)).astype(int)
    if best.mean() < 0.4 or np.unique(sector).size < 5:
        return None
    return u, v, radius


def _algebraic_circle(points: FloatArray) -> tuple[float, float, float]:
    """The least-squares circle u^2 + v^2 = 2 u0 u + 2 v0 v + k through points (n, 2) (Kasa 1976)."""
    origin = points.mean(0)
    p = points - origin
    (u, v, k), *_ = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), (p**2).sum(1), rcond=None)
    return float(u + origin[0]), float(v + origin[1]), float(np.sqrt(max(k + u * u + v * v, 0.0)))


def _near(points: FloatArray, circle: tuple[float, float, float]) -> NDArray[np.bool_]:
    u, v, radius = circle
    if not 10 < radius < 1e5:
        return np.zeros(len(points), bool)
    near: NDArray[np.bool_] = np.abs(np.hypot(points[:, 0] - u, points[:, 1] - v) - radius) < _TOLERANCE * radius
    return near
