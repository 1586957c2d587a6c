"""Whether a given camera fits the frames: the same matches under it and under a camera that may adapt to them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray, KannalaBrandt
from fullsphere.mosaic.adjust import Adjustment, adjust
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.orientation import connected_groups, first_orientations
from fullsphere.mosaic.parallax import parallaxes
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.solution import Solution, solve_links, thinned

_WIDE = 0.03  # of the picture's radius: how far a wrong lens may pull a match from where it should be
_PAIRS, _SAMPLE = 24, 150  # pairs and matches of each that are enough to judge a lens
_GOOD_PX = 0.4  # median residual with which nobody asks whether the lens is right
_AGREEING = 0.75  # share of the matches of a link that agree, wrong ones being what they are, if the lens is right
_FALL = 0.6  # share of the residual that must be left with another lens for this one to be called wrong
_LEAST_FALL_PX = 0.4
_LEFT = 0.02  # share of the excess variance that a wrong lens, once mended, may leave behind
_SHARPER = 1.5  # times the spread off the planes of a camera's step that a wrong lens makes
_RAYLEIGH = math.sqrt(2 * math.log(2))  # median length of a vector of two unit normals
_SPREAD_PX = 1000.0  # wider than any residual: least squares
_CLOSE_PX = 2.0
_FAR_PX = 5.0  # residual that tells of a descent that went astray
_SCALES = (1.0, 0.8, 1.25)  # of the lens, to begin with where it is far off
_FREE = (*(p.key for p in KannalaBrandt.parameters), "centre_u_px", "centre_v_px")
_BAND = math.radians(10)
_IN_BAND = 20  # matches that make a band of angles count


class WrongLens(NamedTuple):
    """Median residuals in pixels with the camera as given and as it would fit, and where the first is largest."""

    given_px: float
    fitted_px: float
    worst_px: float
    worst_deg: float


def wrong_lens(
    evidence: Evidence,
    cameras: Sequence[Camera],
    rig: Rig,
    executor: Executor | None = None,
    solution: Solution | None = None,
) -> WrongLens | None:
    """How badly cameras that were given fit the frames, or None where they fit as well as any.

    Residuals with the cameras as given are held against those with lens and centre adjusted to the very same matches:
    a wrong curve or centre is mended by that, parallax only in part.

    Parameters
    ----------
    evidence
        Keypoints and matches.
    cameras
        As they were given.
    rig
        Which camera took which frame.
    executor
        Where pairs are worked on side by side.
    solution
        What was found with these cameras, if anything: where nearly all matches agree closely, no more is asked.
    """
    if solution is not None and _fits(solution, evidence):
        return None
    pairs = evidence.strongest_pairs(2)
    pairs = pairs[:: -(-len(pairs) // _PAIRS) or 1]
    radius = min(camera.image_radius for camera in cameras)
    links = [thinned(link, _SAMPLE) for link in evidence.links(cameras, _WIDE * radius, executor, pairs)]
    if not links:
        return None
    for compare in (_whole, _robustly):
        try:
            found = compare(links, cameras, rig)
        except GeometryError:  # so far off that rays leave the lens, or too little to judge by
            continue
        if found is None or (compare is _whole and _is_parallax(evidence, cameras, found, executor, pairs)):
            return None  # there is nothing to blame on the lens
        return WrongLens(found.given_px, found.fitted_px, *_worst(found.links, found.given, rig))
    return None


class _Comparison(NamedTuple):
    """Links adjusted with the cameras as given and with such as fit, and the median residuals in pixels."""

    links: Sequence[Link]
    given: Adjustment
    fitted: Adjustment
    given_px: float
    fitted_px: float


def _fits(solution: Solution, evidence: Evidence) -> bool:
    links = solution.links
    agreeing = sum(len(link.pixels_i) + len(link.held_i) for link in links)
    matched = sum(len(evidence.matches[link.i, link.j].first) for link in links)
    return agreeing > _AGREEING * matched and _median(solution.adjustment) < _GOOD_PX


def _whole(links: Sequence[Link], cameras: Sequence[Camera], rig: Rig) -> _Comparison | None:
    """All links at once: a turn that does not close is spread over its frames instead of blamed on one pair."""
    count = len(rig.camera_of)
    group = connected_groups(links, count)[0]
    links = [link for link in links if link.i in group]
    rotations = first_orientations(links, group, count)
    given = adjust(links, rotations, group, cameras, (), _SPREAD_PX, 1e-3, rig)
    if _median(given) < _GOOD_PX:
        return None
    fitted = adjust(links, given.rotations, group, _pliable(cameras), _FREE, _SPREAD_PX, 1e-3, rig)
    fitted = adjust(links, fitted.rotations, group, fitted.cameras, _FREE, _CLOSE_PX, 1e-3, rig)
    return _compared(links, given, fitted)


def _robustly(links: Sequence[Link], cameras: Sequence[Camera], rig: Rig) -> _Comparison | None:
    """Only links that agree with each other, where all of them together are beyond any lens."""
    given = solve_links(links, rig, cameras, (), (8.0, _CLOSE_PX), 1e-3)
    fitted = [
        _solved(links, rig, [dataclasses.replace(c, lens=c.lens.scaled(scale)) for c in _pliable(cameras)])
        for scale in _SCALES
    ]
    best = min((one for one in fitted if one is not None), key=_median, default=None)
    return None if best is None else _compared(given.links, given.adjustment, best)


def _solved(links: Sequence[Link], rig: Rig, cameras: Sequence[Camera]) -> Adjustment | None:
    try:
        return solve_links(links, rig, cameras, _FREE, (32.0, 8.0, _CLOSE_PX), 1e-3).adjustment
    except GeometryError:
        return None


def _compared(links: Sequence[Link], given: Adjustment, fitted: Adjustment) -> _Comparison | None:
    """The comparison, or None where another lens is not much better.

    Raises
    ------
    GeometryError
        If neither comes near.
    """
    given_px, fitted_px = _median(given), _median(fitted)
    if fitted_px > max(_FAR_PX, _FALL * given_px):
        raise GeometryError("no lens was found near the one given that these frames agree with")
    if given_px < _GOOD_PX or fitted_px > _FALL * given_px or given_px - fitted_px < _LEAST_FALL_PX:
        return None
    return _Comparison(links, given, fitted, given_px, fitted_px)


def _is_parallax(
    evidence: Evidence,
    cameras: Sequence[Camera],
    found: _Comparison,
    executor: Executor | None,
    pairs: Sequence[Pair],
) -> bool:
    """Whether the lens only takes on itself what near things do to a camera that turns beside its entrance pupil.

    A wrong curve, mended, leaves no more than the keypoints' noise.  Parallax leaves what things at other distances
    have of it; and a step of the camera explains it as well under the lens that was given as under the other.
    """
    before, after = (
        float(np.median([one.sigma_px for one in parallaxes(evidence, which, pairs, executor).values()] or [math.inf]))
        for which in (cameras, found.fitted.cameras)
    )
    noise = _RAYLEIGH * after
    left = max(found.fitted_px**2 - noise**2, 0.0) / max(found.given_px**2 - noise**2, 1e-12)
    return left > _LEFT and before < _SHARPER * after


def _pliable(cameras: Sequence[Camera]) -> list[Camera]:
    """The cameras with polynomials of the same curves, which can become those of any lens."""
    pliable = []
    for camera in cameras:
        theta = np.linspace(0, camera.half_fov, 100)
        nearest, *_ = fitted_lenses(KannalaBrandt, theta, camera.lens.radius(theta))
        pliable.append(dataclasses.replace(camera, lens=nearest))
    return pliable


def _median(adjustment: Adjustment) -> float:
    return float(np.median(np.concatenate(adjustment.residuals_px)))


def _worst(links: Sequence[Link], adjustment: Adjustment, rig: Rig) -> tuple[float, float]:
    """The largest median residual in pixels of any band of angles from the axis, and the band's middle in degrees."""
    cameras = adjustment.cameras
    theta = np.concatenate([_larger_angle(link, cameras, rig) for link in links])
    residual = np.concatenate(adjustment.residuals_px)
    band = (theta // _BAND).astype(int)
    medians = {int(b): float(np.median(residual[band == b])) for b in np.unique(band) if np.sum(band == b) >= _IN_BAND}
    worst = max(medians, key=lambda b: medians[b], default=0)
    return medians.get(worst, float(np.median(residual))), math.degrees((worst + 0.5) * _BAND)


def _larger_angle(link: Link, cameras: Sequence[Camera], rig: Rig) -> FloatArray:
    """Angle (m,) from the axis of whichever keypoint of a match is further out."""
    z = [
        cameras[rig.camera_of[frame]].unproject(pixels)[:, 2]
        for frame, pixels in ((link.i, link.pixels_i), (link.j, link.pixels_j))
    ]
    return np.asarray(np.arccos(np.clip(np.fmin(*z), -1, 1)))
