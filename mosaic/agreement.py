"""How frames agree where they overlap, before and after their light was evened out, and who sees what."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.sphere_pyramid import latitudes

_LEAST = 50  # pixels of the working sphere that two frames must share to be compared
_DARK = 0.01  # linear light: less tells nothing of exposure


class PairLight(NamedTuple):
    """Two registered frames: how many EV brighter the first is where both see, as recorded and evened out."""

    i: int
    j: int
    recorded_ev: float
    evened_ev: float


class Agreement(NamedTuple):
    """What a look at all frames on the working sphere tells.

    Attributes
    ----------
    light
        (H, W, 3) what the frames show together, by how well they see.
    difference
        (H, W) the largest difference between any two frames, in square roots of light, which the eye sees about evenly;
        0 where fewer than two see.
    frames
        (H, W) how many frames see it.
    pairs
        Their light, of those that overlap.
    """

    light: NDArray[np.float32]
    difference: NDArray[np.float32]
    frames: NDArray[np.int16]
    pairs: tuple[PairLight, ...]


def agreement(mosaic: Mosaic, seen: Sequence[Overview]) -> Agreement:
    """Compare the registered frames of a mosaic as they are `seen` on the working sphere."""
    shape = seen[0].quality.shape
    total, weight = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
    lowest, highest = np.full((*shape, 3), np.inf, np.float32), np.zeros((*shape, 3), np.float32)
    count = np.zeros(shape, np.int16)
    for one in seen:
        much = one.quality**4
        total += one.light * much[..., None]
        weight += much
        root = np.sqrt(one.light)
        own = one.seen
        lowest[own], highest[own] = np.minimum(lowest[own], root[own]), np.maximum(highest[own], root[own])
        count += own
    difference = np.where(count > 1, (highest - np.where(np.isfinite(lowest), lowest, 0)).max(-1), 0)
    light = (total / np.maximum(weight, 1e-12)[..., None]).astype(np.float32)
    frames = mosaic.registered
    pairs = []
    for i, j in itertools.combinations(range(len(seen)), 2):
        ratio = _ratio_ev(seen[i], seen[j])
        if ratio is not None:
            recorded = ratio + frames[i].exposure_ev - frames[j].exposure_ev
            pairs.append(PairLight(i, j, recorded, ratio))
    return Agreement(light, difference.astype(np.float32), count, tuple(pairs))


def _ratio_ev(a: Overview, b: Overview) -> float | None:
    """The median of how much brighter one is, each direction counting alike; None if they share too little."""
    light_a, light_b = a.light.mean(-1), b.light.mean(-1)
    both = a.seen & b.seen & (light_a > _DARK) & (light_b > _DARK)
    if both.sum() < _LEAST:
        return None
    solid = np.cos(latitudes(len(both)))[np.nonzero(both)[0]]
    ratio = np.log2(light_a[both] / light_b[both])
    order = np.argsort(ratio, kind="stable")
    upto = np.cumsum(solid[order])
    return float(ratio[order][np.searchsorted(upto, upto[-1] / 2)])
