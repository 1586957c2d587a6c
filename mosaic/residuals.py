"""How far apart the matches of a solved mosaic are: by frame, by angle off axis, and in which direction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.match_errors import MatchArrays, distances_px, match_errors, opened_camera
from fullsphere.mosaic.outcome import HELD_OUT_GATE
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.rig import Rig

_BIN_DEG = 5.0


class Residuals(NamedTuple):
    """Matches of a mosaic, one after the other.

    Attributes
    ----------
    i, j
        (m,) the frames, places in `Mosaic.frames`.
    held
        (m,) whether no fit saw the match.
    distance_px
        (m,) between its two rays on the sphere, in pixels, as `held_out_median_px` of `Mosaic.quality` counts it; held
        matches beyond the gate are left out, as there.  NaN where a camera sees nothing.
    error_px
        (m,) what `residual_median_px` counts: the error of one keypoint, less than the distance, which has those of
        both.  NaN for held matches.
    pixels_i, pixels_j
        (m, 2) where it was seen in either frame.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    held: NDArray[np.bool_]
    distance_px: FloatArray
    error_px: FloatArray
    pixels_i: FloatArray
    pixels_j: FloatArray

    def where(self, chosen: NDArray[np.bool_]) -> Residuals:
        """Those that are chosen (m,)."""
        return Residuals(*_where(self, chosen))


class Sights(NamedTuple):
    """Every match twice: as it lies in frame j, and as it lies in frame i.

    Attributes
    ----------
    frame
        (s,) the frame, place in `Mosaic.frames`.
    held, distance_px
        (s,) as in `Residuals`.
    pixels
        (s, 2) where the match was seen in that frame.
    arrow_px
        (s, 2) from there to where the other frame and the orientations put it; NaN where the camera sees nothing.
    theta
        (s,) angle off axis there, radians.
    """

    frame: NDArray[np.intp]
    held: NDArray[np.bool_]
    distance_px: FloatArray
    pixels: FloatArray
    arrow_px: FloatArray
    theta: FloatArray

    def where(self, chosen: NDArray[np.bool_]) -> Sights:
        """Those that are chosen (s,)."""
        return Sights(*_where(self, chosen))


def _where(values: Iterable[NDArray[Any]], chosen: NDArray[np.bool_]) -> Iterator[NDArray[Any]]:
    return (value[chosen] for value in values)


class FrameResiduals(NamedTuple):
    """What the matches say of one frame: medians of `error_px` and, of held ones, `distance_px`; None without any."""

    links: int
    matches: int
    median_px: float | None
    held_matches: int
    held_median_px: float | None


class ThetaBin(NamedTuple):
    """Distances of matches seen at like angles: the middle of the bin, quartiles, and how many ends of matches."""

    theta_deg: float
    lower_px: float
    median_px: float
    upper_px: float
    matches: int


def residuals(mosaic: Mosaic) -> Residuals:
    """The matches of a mosaic between registered frames."""
    links = [link for link in mosaic.links if mosaic.frames[link.i].registered and mosaic.frames[link.j].registered]
    rotations, rig = _rotations(mosaic), Rig.of(mosaic.frames)
    used, held = MatchArrays.of(links), MatchArrays.held_back(links)
    every = MatchArrays(*(np.concatenate(pair) for pair in zip(used, held, strict=True)))
    distance = distances_px(every, rotations, mosaic.cameras, rig)
    errors = np.linalg.norm(match_errors(used, rotations, mosaic.cameras, rig).residual, axis=1)
    unseen = np.arange(len(every.i)) >= len(used.i)
    gate = HELD_OUT_GATE * max((side for camera in mosaic.cameras for side in camera.size), default=1)
    padded = np.concatenate([errors, np.full(len(held.i), np.nan)])
    found = Residuals(every.i, every.j, unseen, distance, padded, every.pixels_i, every.pixels_j)
    with np.errstate(invalid="ignore"):
        return found.where(np.where(unseen, distance < gate, np.isfinite(padded)))


def sights(mosaic: Mosaic, found: Residuals) -> Sights:
    """The matches as they lie in the pictures."""
    rotations, rig = _rotations(mosaic), Rig.of(mosaic.frames)
    opened = [opened_camera(camera) for camera in mosaic.cameras]
    ends = []
    for one, other, here, there in (
        (found.j, found.i, found.pixels_j, found.pixels_i),
        (found.i, found.j, found.pixels_i, found.pixels_j),
    ):
        arrow, theta = np.full((len(one), 2), np.nan), np.full(len(one), np.nan)
        for a, camera in enumerate(opened):
            for b, other_camera in enumerate(opened):
                own = np.flatnonzero((rig.camera_of[one] == a) & (rig.camera_of[other] == b))
                turns = rotations[one[own]] @ np.swapaxes(rotations[other[own]], -1, -2)
                rays = (turns @ other_camera.unproject(there[own])[..., None])[..., 0]
                arrow[own] = camera.project(rays) - here[own]
                theta[own] = np.arccos(np.clip(camera.unproject(here[own])[:, 2], -1, 1))
        ends.append(Sights(one, found.held, found.distance_px, here, arrow, theta))
    return Sights(*(np.concatenate(pair) for pair in zip(*ends, strict=True)))


def by_frame(mosaic: Mosaic, found: Residuals) -> list[FrameResiduals]:
    """For each frame of the mosaic what its matches with all others say."""
    links = np.bincount([k for link in mosaic.links for k in (link.i, link.j)], minlength=len(mosaic.frames))
    ends = np.concatenate([found.i, found.j])
    held, error, distance = np.tile(found.held, 2), np.tile(found.error_px, 2), np.tile(found.distance_px, 2)
    result = []
    for count, own in zip(links.tolist(), _grouped(ends, len(mosaic.frames)), strict=True):
        fitted, unseen = error[own][~held[own]], distance[own][held[own]]
        result.append(FrameResiduals(count, fitted.size, _median(fitted), unseen.size, _median(unseen)))
    return result


def by_link(mosaic: Mosaic, found: Residuals, least: int) -> list[float | None]:
    """For each link of a mosaic the median distance of its held matches, or of the fit's if held are below `least`."""
    count = len(mosaic.frames)
    numbers = {(link.i, link.j): number for number, link in enumerate(mosaic.links)}
    keys, inverse = np.unique(found.i * count + found.j, return_inverse=True)
    medians: list[float | None] = [None] * len(mosaic.links)
    for key, own in zip(keys.tolist(), _grouped(inverse, len(keys)), strict=True):
        held = found.held[own]
        values = found.distance_px[own][held if held.sum() >= least else ~held]
        medians[numbers[divmod(key, count)]] = _median(values[np.isfinite(values)])
    return medians


def against_theta(seen: Sights) -> list[ThetaBin]:
    """Held-out distances by the angle off axis, every match at both its ends; without held ones, those of the fit."""
    own = seen.where(seen.held) if seen.held.any() else seen.where(np.isfinite(seen.distance_px))
    place = np.floor(np.rad2deg(own.theta) / _BIN_DEG)
    bins = []
    for at in np.unique(place[np.isfinite(place)]).tolist():
        values = own.distance_px[place == at]
        lower, median, upper = np.percentile(values, [25, 50, 75])
        bins.append(ThetaBin((at + 0.5) * _BIN_DEG, float(lower), float(median), float(upper), values.size))
    return bins


def _rotations(mosaic: Mosaic) -> FloatArray:
    return np.array([np.eye(3) if f.camera_from_world is None else f.camera_from_world for f in mosaic.frames])


def _grouped(keys: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """For each key 0, 1, ... the places where it stands."""
    order = np.argsort(keys, kind="stable")
    return np.split(order, np.searchsorted(keys[order], np.arange(1, count)))


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if values.size else None
