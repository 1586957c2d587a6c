"""What the frames have in common: matched keypoints, and the links that a camera makes of them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.candidates import FEW_FRAMES, Pair, candidate_pairs, first_look, missing_pairs
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.matching import NO_MATCHES, Matches, RotationFit, fit_rotation, held_back, match_features
from fullsphere.mosaic.options import Order
from fullsphere.mosaic.project import Link

__all__ = ["Evidence", "Pair", "Progress", "gather_evidence", "matched"]

_BY_CHANCE, _SHARE_BY_CHANCE = 5.9, 0.22  # matches that chance makes agree: Brown & Lowe, ICCV 2003, section 3.2

Progress = Callable[..., Iterable[Any]]
"""Wraps an iterable to show how far it is: progress(items, title=..., total=...)."""

_STRONG = 60  # matches, right or wrong, by which two frames are taken to see the same thing
_MORE_PARTNERS = (4, 12)  # tried in turn for each frame that is not yet joined to most others


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """All that is known without a camera: the keypoints of each frame by its index, the matches of each pair i < j.

    `camera_of` tells the index of the camera that took a frame; frames it does not name were taken by the first.
    `held` are the matches of each pair that are kept from every fit, to measure the result by.
    """

    features: Mapping[int, Features]
    matches: Mapping[Pair, Matches]
    camera_of: Mapping[int, int] = dataclasses.field(default_factory=dict)
    held: Mapping[Pair, Matches] = dataclasses.field(default_factory=dict)

    def strongest_pairs(self, partners: int) -> list[Pair]:
        """For each frame the pairs with the `partners` others that it has most matches with, in order."""
        chosen: set[Pair] = set()
        for frame in self.features:
            own = [pair for pair in self.matches if frame in pair]
            own.sort(key=lambda pair: (-len(self.matches[pair].first), pair))
            chosen.update(own[:partners])
        return sorted(chosen)

    def among(self, frames: Collection[int]) -> Evidence:
        """What these frames alone have in common."""
        return dataclasses.replace(
            self,
            features={k: one for k, one in self.features.items() if k in frames},
            matches={pair: one for pair, one in self.matches.items() if set(pair) <= set(frames)},
            held={pair: one for pair, one in self.held.items() if set(pair) <= set(frames)},
        )

    def links(
        self,
        cameras: Sequence[Camera],
        tolerance_px: float,
        executor: Executor | None = None,
        pairs: Sequence[Pair] | None = None,
    ) -> list[Link]:
        """Links of the pairs whose matches agree with a rotation under the cameras.

        The matches held back are in them all, right or wrong, where both cameras see the keypoints: what agrees is not
        for a fit to choose.

        Parameters
        ----------
        cameras
            Turn keypoints into rays; those outside the field of view do not count.
        tolerance_px
            How many pixels off a match may be.
        executor
            Where pairs are worked on side by side.
        pairs
            Those to look at, by default all.
        """
        camera = {k: cameras[self.camera_of.get(k, 0)] for k in self.features}
        rays = {k: camera[k].unproject(f.pixels) for k, f in self.features.items()}
        scale = {k: camera[k].pixels_per_radian(r) for k, r in rays.items()}

        def link(pair: Pair) -> Link | None:
            (i, j), (first, second) = pair, self.matches[pair]
            seen = np.isfinite(rays[i][first, 0]) & np.isfinite(rays[j][second, 0])
            first, second = first[seen], second[seen]
            tolerance = tolerance_px * np.hypot(1 / scale[i][first], 1 / scale[j][second])
            fit = fit_rotation(rays[i][first], rays[j][second], tolerance, seed=i * 100_003 + j)
            if fit is None or not _credible(fit, (camera[i], rays[i][first]), (camera[j], rays[j][second])):
                return None
            a, b = self.features[i].pixels[first[fit.inliers]], self.features[j].pixels[second[fit.inliers]]
            held = self.held.get(pair, NO_MATCHES)
            seen = np.isfinite(rays[i][held.first, 0]) & np.isfinite(rays[j][held.second, 0])
            held_i, held_j = self.features[i].pixels[held.first[seen]], self.features[j].pixels[held.second[seen]]
            return Link(i, j, a, b, fit.rotation, held_i, held_j)

        found = ordered_map(executor, link, list(self.matches) if pairs is None else pairs)
        return [one for one in found if one is not None]


def _credible(fit: RotationFit, one: tuple[Camera, FloatArray], other: tuple[Camera, FloatArray]) -> bool:
    """Whether enough agree of the matches whose keypoints both frames would show, were they turned so.

    Things that look alike, windows or a frame and its mirror image, make some matches agree with a wrong rotation, but
    few of those where the frames would overlap.  Brown & Lowe, ICCV 2003, section 3.2.
    """
    (camera_i, rays_i), (camera_j, rays_j) = one, other
    shown = _shows(camera_j, rays_i @ fit.rotation.T) & _shows(camera_i, rays_j @ fit.rotation)
    return int(fit.inliers.sum()) > _BY_CHANCE + _SHARE_BY_CHANCE * int(shown.sum())


def _shows(camera: Camera, rays: FloatArray) -> NDArray[np.bool_]:
    """Whether a camera's picture shows rays (n, 3)."""
    u, v = camera.project(rays).T
    width, height = camera.size
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    return inside


def gather_evidence(
    features: Mapping[int, Features],
    executor: Executor | None,
    progress: Progress,
    order: Order = "any",
    priors: Mapping[int, FloatArray] | None = None,
) -> Evidence:
    """Match the keypoints of frames that may see the same; one match in five is held back.

    All pairs of few frames; of many `candidate_pairs`, and more for frames that these do not join to the others.
    """
    frames = sorted(features)
    if len(frames) <= FEW_FRAMES:
        return matched(Evidence(features, {}), list(itertools.combinations(frames, 2)), executor, progress)
    shared = first_look(features, executor)
    evidence = matched(Evidence(features, {}), candidate_pairs(frames, shared, order, priors), executor, progress)
    for partners in _MORE_PARTNERS:
        strong = [pair for pair, found in evidence.matches.items() if len(found.first) >= _STRONG]
        missing = missing_pairs(frames, strong, evidence.matches.keys(), shared, partners)
        evidence = matched(evidence, missing, executor, progress)
    return evidence


def matched(
    evidence: Evidence,
    pairs: Sequence[Pair],
    executor: Executor | None = None,
    progress: Progress = lambda items, **_: items,
) -> Evidence:
    """The evidence with the pairs i < j matched too; those that are already are not matched again."""
    new = [pair for pair in pairs if pair not in evidence.matches]
    if not new:
        return evidence
    features = evidence.features
    found = ordered_map(executor, lambda pair: match_features(features[pair[0]], features[pair[1]]), new)
    every = dict(zip(new, progress(found, title="matching frames", total=len(new)), strict=True))
    hold = {pair: held_back(features[pair[0]].pixels[one.first]) for pair, one in every.items()}
    used = {pair: one.where(~hold[pair]) for pair, one in every.items()}
    held = {pair: one.where(hold[pair]) for pair, one in every.items()}
    return dataclasses.replace(
        evidence,
        matches=dict(sorted({**evidence.matches, **used}.items())),
        held=dict(sorted({**evidence.held, **held}.items())),
    )
