"""All frames of a turning arm placed: pairs of neighbours, then all pairs that the angles by them propose."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import mount_of
from fullsphere.mosaic.circular_fit import CircularFit, fit_circle
from fullsphere.mosaic.turn_chain import averaged, neighbours_in, pairs_by_angle, placed
from fullsphere.mosaic.turn_frames import LEAST_FRAMES
from fullsphere.mosaic.turn_views import FoundPair, View, pair_of

ROUGH, FINE = 40.0, 12.0
"""Times its noise that a match may be off, before the mount is known and then."""

_TRIED = 8  # pairs by which it is told which way up the camera is held
_CLEARLY = 1.3  # times as many matches, for another way than upright
_PARTNERS = 24  # frames that one is compared with whose neighbours do not know it
_HARDLY = math.radians(2)  # all frames together

Progress = Callable[..., Iterable[Any]]
"""Wraps an iterable to show how far it is: progress(items, title=..., total=...)."""


class Pairs:
    """The pairs looked at so far."""

    def __init__(self, views: Mapping[int, View], executor: Executor | None, progress: Progress | None) -> None:
        self._views, self._executor = views, executor
        self._progress = progress or (lambda items, **_: items)
        self.found: dict[tuple[int, int], FoundPair] = {}

    def look(
        self, pairs: Iterable[tuple[int, int]], mount: FloatArray, tolerance: float, title: str = "matching"
    ) -> list[FoundPair]:
        """Compare pairs; what is found of them is kept, and answered.  Without a title no progress is shown."""
        listed = list(pairs)
        results = ordered_map(
            self._executor, lambda pair: pair_of(self._views, *pair, mount, tolerance), listed, ahead=16
        )
        shown = self._progress(results, title=title, total=len(listed)) if title else results
        new = [one for one in shown if one is not None]
        self.found.update({one.ends: one for one in new})
        return new

    def all(self) -> list[FoundPair]:
        """In order."""
        return [self.found[ends] for ends in sorted(self.found)]


class Placed(NamedTuple):
    """What pairs tell: exact angles (n,) and mount, how far the arm had gone (n,), which frames hang together (n,)."""

    fit: CircularFit
    progress: FloatArray
    together: NDArray[np.bool_]
    found: list[FoundPair]


def quality_of(
    found: Sequence[FoundPair], fit: CircularFit, views: Mapping[int, View], share: float
) -> dict[str, float]:
    """Figures of a fit, by name."""
    noise_px = float(np.median(np.concatenate([one.features.sigma_px for one in views.values()])))
    return {
        "pairs": len(found),
        "matches": sum(len(one.matched.held) for one in found),
        "residual_px": fit.spread * noise_px,
        "held_out_px": fit.held_spread * noise_px,
        "parallax_share": share,
    }


def solve(pairs: Pairs, count: int, quarter_turns: int, straight: bool) -> Placed:
    """Place all frames: neighbours first, then all pairs that their angles propose.

    Parameters
    ----------
    pairs
        Where frames are compared.
    count
        Of frames, about in the order of turning.
    quarter_turns
        How many quarter turns clockwise bring their pictures upright.
    straight
        The camera is held straight.

    Raises
    ------
    GeometryError
        If frames do not turn or do not hang together, or the camera looks inward.
    """
    following = [(k, k + 1) for k in range(count - 1)]
    mount = base_mount(pairs.look, following, quarter_turns)
    pairs.look(following, mount, ROUGH, "matching neighbours")
    progress, together = _joined(pairs, mount, count)
    if np.ptp(progress[together]) < _HARDLY:
        raise GeometryError("the frames hardly turn against each other; give the frames of a full turn of the arm")
    chain = _fit(pairs.all(), progress, mount, straight, together)
    pairs.found.clear()
    fit, found = chain, list[FoundPair]()
    for _ in range(2):
        proposed = [ends for ends in pairs_by_angle(fit.angles, np.flatnonzero(together)) if ends not in pairs.found]
        if found and len(proposed) < count // 10:
            break
        pairs.look(proposed, chain.mount, FINE)
        _, still_together = placed(pairs.all(), count)
        together &= still_together
        angles, found = averaged(_within(pairs.all(), together), fit.angles)
        fit = _fit(found, angles, chain.mount, straight, together)
    return Placed(fit, progress, together, found)


def base_mount(
    look: Callable[..., list[FoundPair]], following: Sequence[tuple[int, int]], quarter_turns: int
) -> FloatArray:
    """Which way up the camera is held: upright by what the frames say, or on its side.

    Raises
    ------
    GeometryError
        If it looks to the axis.
    """
    some = following[:: max(1, len(following) // _TRIED)]
    upright, aside = (mount_of(0, 0, math.pi / 2 * (quarter_turns + k)) for k in (0, 1))
    agree = [
        sum(len(one.matched.held) for one in look(some, mount, ROUGH, ""))
        for mount in (upright, aside, mount_of(math.pi, 0, 0) @ upright)
    ]
    if agree[2] > _CLEARLY * max(agree[:2]):
        raise GeometryError("the camera looks to the axis of turning; mount it so that it looks outward along the arm")
    return aside if agree[1] > _CLEARLY * agree[0] else upright


def _joined(pairs: Pairs, mount: FloatArray, count: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Angles (n,) not wrapped, and which frames (n,) hang together, others having been tried to be joined to them.

    Raises
    ------
    GeometryError
        If no more than half of them do.
    """
    if not pairs.found:
        raise GeometryError(
            "no two frames that follow each other have enough in common; are these frames of a turning arm, in order, "
            "and is the camera theirs?"
        )
    _, together = placed(pairs.all(), count)
    breaks = [k for k in range(count - 1) if (k, k + 1) not in pairs.found]
    around = {(a, b) for k in breaks for a in range(k - 1, k + 1) for b in range(k + 1, k + 3) if b > a + 1}
    pairs.look(sorted((a, b) for a, b in around if a >= 0 and b < count), mount, ROUGH)
    progress, together = placed(pairs.all(), count)
    tried: set[int] = set()
    while not together.all():
        alone = [int(k) for k in np.flatnonzero(~together) if int(k) not in tried]
        if not alone:
            break
        tried.add(alone[0])
        partners = neighbours_in(progress, np.flatnonzero(together), _PARTNERS)
        pairs.look([(min(k, alone[0]), max(k, alone[0])) for k in partners], mount, ROUGH)
        progress, together = placed(pairs.all(), count)
    if together.sum() < max(LEAST_FRAMES, count / 2):
        lost = int((~together).sum())
        raise GeometryError(
            f"{lost} of the {count} frames have nothing in common with the others; are these frames of a turning arm, "
            "and is the camera theirs?"
        )
    return progress, together


def _within(found: Sequence[FoundPair], together: NDArray[np.bool_]) -> list[FoundPair]:
    return [one for one in found if together[list(one.ends)].all()]


def _fit(
    found: Sequence[FoundPair], angles: FloatArray, mount: FloatArray, straight: bool, together: NDArray[np.bool_]
) -> CircularFit:
    """`fit_circle` of the frames that hang together; the others keep their angles."""
    indices = np.flatnonzero(together)
    place = np.full(len(together), -1)
    place[indices] = np.arange(len(indices))
    own = [
        one.matched._replace(i=int(place[one.ends[0]]), j=int(place[one.ends[1]])) for one in _within(found, together)
    ]
    fit = fit_circle(own, angles[indices], mount, mount_known=straight)
    whole, sigmas = angles.copy(), np.zeros(len(angles))
    whole[indices], sigmas[indices] = fit.angles, fit.sigmas
    return fit._replace(angles=whole, sigmas=sigmas)
