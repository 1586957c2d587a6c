"""Why a frame found no place among the others, in plain words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.matching import MIN_INLIERS, Matches, fit_rotation, match_features
from fullsphere.mosaic.mirrored import flipped
from fullsphere.mosaic.parallax import parallaxes
from fullsphere.mosaic.project import Frame, Link
from fullsphere.mosaic.unusable import what_is_wrong

_TOLERANCE_PX = 6.0  # as wide as a rotation bears it: the camera may be a little off
_CLEARLY = 2 * MIN_INLIERS  # matches that chance does not bring together
_LOOKED_AT = 16  # placed frames that one that was left out is held against


class _Best(NamedTuple):
    """The placed frame that one left out has most in common with, and how many matches agree."""

    frame: int
    agreeing: int


def why_left_out(
    k: int,
    frames: Sequence[Frame],
    evidence: Evidence,
    cameras: Sequence[Camera],
    links: Sequence[Link],
    group: Collection[int],
    allowed: NDArray[np.uint8] | None = None,
) -> str:
    """The reason why frame `k` is not among those of `group`, and what to do about it.

    Parameters
    ----------
    k
        Index of the frame; it was searched for keypoints.
    frames
        All frames.
    evidence
        Keypoints and matches.
    cameras
        Of the solution.
    links
        All that hold under these cameras, those outside the group included.
    group
        Indices of the frames that were registered.
    allowed
        Mask (h, w) of where keypoints were looked for; None for everywhere.
    """
    placed = sorted(int(g) for g in group)
    features = evidence.features[k]
    wrong = what_is_wrong(frames[k].load(), allowed)
    if wrong:
        return wrong
    if len(features) < _CLEARLY:
        return f"shows too little texture: {len(features)} features found"
    mirrored = _if_mirrored(k, frames[k].size[0], evidence, cameras, placed)
    if mirrored is not None:
        name = frames[mirrored.frame].id
        return f"is mirrored: flipped from left to right it agrees with {name} ({mirrored.agreeing} matches); flip it"
    companions = _companions(k, links, set(placed))
    if companions:
        names = _listed([frames[c].id for c in companions])
        return f"hangs together with {names} only: nothing links them to the frames that were registered"
    moved = _if_moved(k, evidence, cameras, placed)
    if moved is not None:
        name = frames[moved.frame].id
        return f"was taken from another place: {moved.agreeing} matches with {name} show parallax, no rotation holds"
    apart = "does not overlap the other frames, or shows another place"
    best = _most_matches(k, evidence, placed)
    if best is None or not best.agreeing:
        return f"{apart}: it has no matches with any of them"
    return f"{apart}: no rotation agrees with its matches (the most, {best.agreeing}, with {frames[best.frame].id})"


def _if_mirrored(
    k: int, width: int, evidence: Evidence, cameras: Sequence[Camera], placed: Sequence[int]
) -> _Best | None:
    """The placed frame with which the flipped picture agrees best, if it does so better than the picture as it is."""
    mirror = flipped(evidence.features[k], width)
    step = -(-len(placed) // _LOOKED_AT)
    best = _Best(-1, 0)
    for other in placed[::step]:
        changed = Evidence({**evidence.features, k: mirror}, {}, evidence.camera_of)
        agreeing = _agreeing(changed, cameras, (k, other), match_features(mirror, evidence.features[other]))
        best = max(best, _Best(other, agreeing), key=lambda b: b.agreeing)
    if best.agreeing < _CLEARLY:
        return None
    as_it_is = match_features(evidence.features[k], evidence.features[best.frame])
    return best if best.agreeing > 2 * _agreeing(evidence, cameras, (k, best.frame), as_it_is) else None


def _agreeing(evidence: Evidence, cameras: Sequence[Camera], pair: Pair, matches: Matches) -> int:
    """How many matches agree with one rotation."""
    rays, pixel = [], []
    for frame, which in zip(pair, (matches.first, matches.second), strict=True):
        camera = cameras[evidence.camera_of.get(frame, 0)]
        ray = camera.unproject(evidence.features[frame].pixels[which])
        rays.append(ray)
        pixel.append(1 / camera.pixels_per_radian(ray))
    seen = np.isfinite(rays[0][:, 0]) & np.isfinite(rays[1][:, 0])
    tolerance = _TOLERANCE_PX * np.hypot(*pixel)[seen]
    fit = fit_rotation(rays[0][seen], rays[1][seen], tolerance, seed=0)
    return 0 if fit is None else int(fit.inliers.sum())


def _companions(k: int, links: Sequence[Link], placed: Collection[int]) -> list[int]:
    """The frames outside the group that links hold this one together with."""
    reached, queue = {k}, [k]
    for frame in queue:
        for link in links:
            for one, other in ((link.i, link.j), (link.j, link.i)):
                if one == frame and other not in reached and other not in placed:
                    reached.add(other)
                    queue.append(other)
    return sorted(reached - {k})


def _if_moved(k: int, evidence: Evidence, cameras: Sequence[Camera], placed: Sequence[int]) -> _Best | None:
    """The placed frame with which most matches agree after a step of the camera."""
    pairs = [pair for pair in _pairs_with(k, evidence, placed) if len(evidence.matches[pair].first) >= 2 * _CLEARLY]
    found = parallaxes(evidence, cameras, pairs)
    steps = {pair: one for pair, one in found.items() if one.verdict == "parallax" and one.matches >= 2 * _CLEARLY}
    if not steps:
        return None
    pair = max(steps, key=lambda p: steps[p].matches)
    return _Best(pair[0] if pair[1] == k else pair[1], steps[pair].matches)


def _most_matches(k: int, evidence: Evidence, placed: Sequence[int]) -> _Best | None:
    pairs = _pairs_with(k, evidence, placed)
    if not pairs:
        return None
    pair = max(pairs, key=lambda p: len(evidence.matches[p].first))
    return _Best(pair[0] if pair[1] == k else pair[1], len(evidence.matches[pair].first))


def _pairs_with(k: int, evidence: Evidence, placed: Sequence[int]) -> list[Pair]:
    pairs = [(min(k, other), max(k, other)) for other in placed]
    return [pair for pair in pairs if pair in evidence.matches]


def _listed(names: Sequence[str]) -> str:
    """A, B and C; with more than four of them the first three and how many more."""
    if len(names) > 4:
        return f"{', '.join(names[:3])} and {len(names) - 3} others"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
