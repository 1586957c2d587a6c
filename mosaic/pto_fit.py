"""Between the lenses of Hugin and ours: exact where a formula is the same, else fitted, with the error in pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError
from fullsphere.model.lens import Brown, FloatArray, KannalaBrandt, Lens
from fullsphere.model.radial import first_root
from fullsphere.mosaic.loading import Crop
from fullsphere.mosaic.pto_lens import CIRCULAR, TYPES, PanoToolsLens

_NODES = 200
_GRID = 41  # pixels a side at which two cameras are compared
_WORTH_A_CIRCLE_PX = 0.5  # of the error: Hugin leaves out what is beyond the image circle for the circular types only
_WIDEST = math.radians(80)  # half field of view of what is written as an ordinary lens
_DECIMALS = 12  # of a, b and c: what is less is rounding
_OUTERMOST = 0.999  # of the angle where a radius stops growing: a lens that is fitted goes on a little


class FittedCamera(NamedTuple):
    """A camera, and how far at most it is off the lens it stands for within the picture, in pixels."""

    camera: Camera
    error_px: float


class FittedLens(NamedTuple):
    """A lens of Hugin, and how far at most it is off the camera that it stands for, in pixels of the picture."""

    lens: PanoToolsLens
    error_px: float


def camera_of(lens: PanoToolsLens, crop: Crop | None = None) -> FittedCamera:
    """The camera of a picture taken with a lens of Hugin.

    Parameters
    ----------
    lens
        Of the whole picture.
    crop
        Its part that is used, which the camera is that of: a circle in it for the circular types, else all of it.  It
        may reach past the picture, as the box of a circle does that the picture cuts.

    Raises
    ------
    CameraError
        If no camera follows the lens.
    """
    left, top, width, height = clipped(crop, lens.size) if crop else (0, 0, *lens.size)
    centre = (lens.axis_px[0] - left, lens.axis_px[1] - top)
    half_fov = float(np.nan_to_num(lens.angle(_reach(lens, crop)), nan=lens.theta_max * _OUTERMOST))
    best: FittedCamera | None = None
    for candidate in _lenses(lens, half_fov):
        camera = Camera(candidate, (width, height), centre, half_fov=min(half_fov, candidate.theta_max))
        fitted = FittedCamera(camera, difference_px(camera, lens, (left, top)))
        if best is None or fitted.error_px < best.error_px:
            best = fitted
    if best is None:
        raise CameraError("no lens of ours follows its a, b and c over the picture")
    return best


def lens_of(camera: Camera, size: tuple[int, int], left: int = 0, top: int = 0) -> FittedLens:
    """The lens of Hugin that follows a camera best.

    Parameters
    ----------
    camera
        Of a part of the picture, or all of it.
    size
        Width and height of the whole picture.
    left, top
        Where the camera's part begins.

    Raises
    ------
    CameraError
        If the polynomial of libpano follows the camera nowhere near.
    """
    found = []
    dark_corners = circle_shows(camera)
    for order, lens in enumerate(_bent_lenses(camera, size, left, top)):
        error = difference_px(camera, lens, (left, top))
        handicap = _WORTH_A_CIRCLE_PX if dark_corners and lens.kind not in CIRCULAR else 0.0
        found.append((round(error, 4) + handicap, order, FittedLens(lens, error)))
    if not found:
        raise CameraError(f"camera: libpano's polynomial does not follow a {camera.lens.projection} lens so far out")
    return min(found, key=lambda item: item[:2])[2]


def circle_shows(camera: Camera) -> bool:
    """Whether a corner of the picture lies outside the image circle."""
    return bool(np.isnan(camera.unproject(_corners(camera.size))).any())


def difference_px(camera: Camera, lens: PanoToolsLens, corner: tuple[int, int]) -> float:
    """The largest distance of a pixel from where the lens images the camera's ray of it; infinite where it does not."""
    width, height = camera.size
    grid = np.stack(np.meshgrid(np.linspace(0, width - 1, _GRID), np.linspace(0, height - 1, _GRID)), -1)
    grid = np.concatenate([grid.reshape(-1, 2), _rim(camera)])
    rays = camera.unproject(grid)
    seen = np.isfinite(rays[:, 0])
    gaps = np.linalg.norm(lens.project(rays[seen]) - grid[seen] - corner, axis=1)
    return float(np.where(np.isnan(gaps), math.inf, gaps).max(initial=0.0))


def clipped(crop: Crop, size: tuple[int, int]) -> Crop:
    """The part of a crop (left, top, width, height) that lies in the picture."""
    left, top = max(crop[0], 0), max(crop[1], 0)
    right, bottom = min(crop[0] + crop[2], size[0]), min(crop[1] + crop[3], size[1])
    return left, top, right - left, bottom - top


def _reach(lens: PanoToolsLens, crop: Crop | None) -> float:
    """How far in pixels from the axis the picture is used."""
    axis = np.array(lens.axis_px)
    if crop is None or lens.kind not in CIRCULAR:
        left, top, width, height = clipped(crop, lens.size) if crop else (0, 0, *lens.size)
        corners = _corners((width, height)) + np.array([left, top])
        return float(np.linalg.norm(corners - axis, axis=1).max())
    middle = np.array([crop[0] + (crop[2] - 1) / 2, crop[1] + (crop[3] - 1) / 2])
    return float(min(crop[2:]) / 2 + np.linalg.norm(middle - axis))


def _corners(size: tuple[int, int]) -> FloatArray:
    width, height = size
    return np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)


def _rim(camera: Camera) -> FloatArray:
    """Pixels (n, 2) just inside the image circle, those within the picture."""
    phi = np.linspace(0, 2 * math.pi, 72, endpoint=False)
    theta = camera.half_fov * _OUTERMOST
    rays = np.stack([math.sin(theta) * np.cos(phi), math.sin(theta) * np.sin(phi), np.full(72, math.cos(theta))], -1)
    pixels = camera.project(rays)
    return np.asarray(pixels[((pixels >= 0) & (pixels <= np.array(camera.size) - 1)).all(1)])


def _nodes(half_fov: float) -> FloatArray:
    """Angles from the axis to the rim, denser towards both as errors of polynomials are."""
    return half_fov * (0.5 - 0.5 * np.cos(np.linspace(0, math.pi, _NODES)))


def _lenses(lens: PanoToolsLens, half_fov: float) -> Iterator[Lens]:
    """Lenses of ours to try, those with the same formula first."""
    focal, inner, side = lens.focal_px, 1 - lens.a - lens.b - lens.c, lens.half_side
    if lens.a == lens.b == lens.c == 0:
        yield lens.ideal
        return
    if lens.a == lens.c == 0 and lens.kind in (0, 2, 3):
        cubic = lens.b * focal**2 / side**2 / inner
        kind = Brown if lens.kind == 0 else KannalaBrandt
        yield kind(focal * inner, cubic, 0.0, 0.0, *([0.0] if lens.kind else []))
        return
    theta = _nodes(half_fov)
    radius = lens.radius(theta)
    x = np.tan(theta) if lens.kind == 0 else theta
    for terms in range(4 if lens.kind == 0 else 5, 1, -1):  # fewer where more bend the curve back
        powers = 2 * np.arange(terms) + 1
        first, *higher = np.linalg.lstsq(x[:, None] ** powers, radius, rcond=None)[0].tolist()
        try:
            values = [k / first for k in higher] + [0.0] * (4 - len(higher))
            fitted: Lens = Brown(first, *values[:3]) if lens.kind == 0 else KannalaBrandt(first, *values)
        except (CameraError, ZeroDivisionError):
            continue
        if fitted.theta_max >= half_fov:
            yield fitted


def _bent_lenses(camera: Camera, size: tuple[int, int], left: int, top: int) -> Iterator[PanoToolsLens]:
    """r = p1 h + p2 h^2 + p3 h^3 + p4 h^4 for each type's h(theta), and fewer terms where R has no unit then."""
    shift = {"d": camera.centre[0] + left - (size[0] - 1) / 2, "e": camera.centre[1] + top - (size[1] - 1) / 2}
    side = min(size) / 2
    kinds = (2, 20, 0, 21, 10, 8) if circle_shows(camera) else (0, 3, 21, 10, 20, 8)
    reach = _used_angle(camera)
    theta = _nodes(reach)
    radius = camera.lens.radius(theta) * (1 + camera.aspect) / 2
    for kind in kinds:
        if reach >= (_WIDEST if kind == 0 else TYPES[kind](1.0).theta_max):
            continue
        h = TYPES[kind](1.0).radius(theta)
        for terms in (4, 3, 2, 1):
            p = np.zeros(4)
            p[:terms] = np.linalg.lstsq(h[:, None] ** np.arange(1, terms + 1), radius, rcond=None)[0]
            focal = side / first_root([*(-p / side)])  # where the polynomial reaches half of the shorter side
            try:
                bend = [float(p[k] * side**k / focal ** (k + 1)) for k in (1, 2, 3)]
                c, b, a = (round(value, _DECIMALS) for value in bend)
                lens = PanoToolsLens.of_focal(size, kind, focal, a=a, b=b, c=c, **shift)
            except (CameraError, OverflowError, ZeroDivisionError):
                continue
            if lens.theta_max >= reach:
                yield lens
                break


def _used_angle(camera: Camera) -> float:
    """The largest angle in radians from the axis that is seen within the picture."""
    rays = camera.unproject(_corners(camera.size))
    seen = float(np.arccos(np.clip(rays[:, 2], -1, 1)).max())
    return seen if math.isfinite(seen) else camera.half_fov
