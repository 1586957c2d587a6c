"""How far apart the matches of a solved mosaic are: by frame, by angle off axis, and in which direction."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.match_errors import MatchArrays, distances_px, opened_camera
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
        (m,) between its two rays on the sphere, in pixels; those of held matches beyond the gate are left out, as in
        `Mosaic.quality`.
    pixels
        (m, 2) where it was seen in frame j.
    arrow_px
        (m, 2) from there to where frame i and the orientations put it; NaN where the camera sees nothing.
    theta
        (m,) angle off axis in frame j, radians.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    held: NDArray[np.bool_]
    distance_px: FloatArray
    pixels: FloatArray
    arrow_px: FloatArray
    theta: FloatArray

    def where(self, chosen: NDArray[np.bool_]) -> Residuals:
        """Those that are chosen (m,)."""
        kept: dict[str, Any] = {name: values[chosen] for name, values in self._asdict().items()}
        return Residuals(**kept)


class FrameResiduals(NamedTuple):
    """What the matches say of one frame; medians are None without matches."""

    links: int
    matches: int
    median_px: float | None
    held_matches: int
    held_median_px: float | None


class ThetaBin(NamedTuple):
    """Held-out distances of matches seen at like angles: the middle of the bin, quartiles, and how many."""

    theta_deg: float
    lower_px: float
    median_px: float
    upper_px: float
    matches: int


def residuals(mosaic: Mosaic) -> Residuals:
    """The matches of a mosaic between registered frames."""
    links = [link for link in mosaic.links if mosaic.frames[link.i].registered and mosaic.frames[link.j].registered]
    rotations = np.array([np.eye(3) if f.camera_from_world is None else f.camera_from_world for f in mosaic.frames])
    rig = Rig.of(mosaic.frames)
    used, held = MatchArrays.of(links), MatchArrays.held_back(links)
    every = MatchArrays(*(np.concatenate(pair) for pair in zip(used, held, strict=True)))
    distance = distances_px(every, rotations, mosaic.cameras, rig)
    arrows, theta = np.full((len(every.i), 2), np.nan), np.full(len(every.i), np.nan)
    for a, camera_i in enumerate(mosaic.cameras):
        for b, camera_j in enumerate(mosaic.cameras):
            own = np.flatnonzero((rig.camera_of[every.i] == a) & (rig.camera_of[every.j] == b))
            turns = rotations[every.j[own]] @ np.swapaxes(rotations[every.i[own]], -1, -2)
            there = (turns @ camera_i.unproject(every.pixels_i[own])[..., None])[..., 0]
            arrows[own] = opened_camera(camera_j).project(there) - every.pixels_j[own]
            theta[own] = np.arccos(np.clip(camera_j.unproject(every.pixels_j[own])[:, 2], -1, 1))
    unseen = np.arange(len(every.i)) >= len(used.i)
    gate = HELD_OUT_GATE * max((side for camera in mosaic.cameras for side in camera.size), default=1)
    found = Residuals(every.i, every.j, unseen, distance, every.pixels_j, arrows, theta)
    with np.errstate(invalid="ignore"):
        return found.where(np.isfinite(distance) & (~unseen | (distance < gate)))


def by_frame(mosaic: Mosaic, found: Residuals) -> list[FrameResiduals]:
    """For each frame of the mosaic what its matches with all others say."""
    result = []
    for k in range(len(mosaic.frames)):
        own = found.where((found.i == k) | (found.j == k))
        links = sum(k in (link.i, link.j) for link in mosaic.links)
        used, held = own.distance_px[~own.held], own.distance_px[own.held]
        result.append(FrameResiduals(links, used.size, _median(used), held.size, _median(held)))
    return result


def against_theta(found: Residuals) -> list[ThetaBin]:
    """Held-out distances by the angle off axis; without held matches, those of the fit."""
    own = found.where(found.held) if found.held.any() else found
    place = np.floor(np.rad2deg(own.theta) / _BIN_DEG)
    bins = []
    for at in np.unique(place[np.isfinite(place)]):
        values = own.distance_px[place == at]
        lower, median, upper = np.percentile(values, [25, 50, 75])
        bins.append(ThetaBin((at + 0.5) * _BIN_DEG, float(lower), float(median), float(upper), values.size))
    return bins


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if values.size else None
