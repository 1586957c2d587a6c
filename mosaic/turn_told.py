"""Turn angles that a person or a motor told: checked by some pairs of frames, which tell how the camera is held too."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.arm import ArmTurn, mount_angles
from fullsphere.mosaic.circular_fit import fit_circle
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.turn_diagnosis import about_mount, names, refuse_part, refuse_without_stereo
from fullsphere.mosaic.turn_frames import LEAST_FRAMES
from fullsphere.mosaic.turn_solve import FINE, ROUGH, Pairs, base_mount, quality_of
from fullsphere.mosaic.turn_views import FoundPair, View

_ANCHORS, _ANCHORS_OF_STRAIGHT = 24, 8  # frames, spread over the turn, with partners
_SPANS = (math.radians(12), math.radians(40))
_CONTRARY = 0.03  # share of the turn between two frames by which they may turn otherwise, all taken together
_LEAST_OFF = math.radians(1.0)  # by which a pair may, whatever it turns
_GROSS, _LEAST_GROSS = 0.25, math.radians(5)  # the same of a pair that is another one than told
_MOST_GROSS = 0.05  # share of pairs
_FEW = 0.2  # share of pairs
_NOT_STRAIGHT = math.radians(0.2)
_UNEXACT = math.radians(0.03)  # told where angles are off by more

See = Callable[[Sequence[int]], dict[int, View]]


def told_turn(
    frames: Sequence[Frame],
    camera: Camera,
    angles: FloatArray,
    see: See,
    executor: Executor | None = None,
    straight: bool = False,
    said: Sequence[str] = (),
) -> ArmTurn:
    """The turn of frames at angles (n,) that were told.

    Parameters
    ----------
    frames, camera
        As `find_turn` takes them.
    angles
        Radians, of any range.
    see
        Finds the keypoints of frames, in the order of the indices that it is given.
    executor
        Where pairs are compared.
    straight
        The camera is held straight: angles are checked only.
    said
        Sentences that the diagnosis begins with.

    Raises
    ------
    GeometryError
        If the angles are less than a full turn, two are the same, or the frames contradict them.
    """
    within = np.mod(angles, 2 * np.pi)
    order = np.argsort(within, kind="stable")
    within, frames = within[order], [frames[k] for k in order]
    ids = [frame.id for frame in frames]
    same = np.flatnonzero(np.diff(within) < 1e-9)
    if len(same):
        raise GeometryError(f"{ids[same[0]]} and {ids[same[0] + 1]} have the same turn angle; leave one out")
    refuse_part(within, ids)
    proposed = _spread_pairs(within, _ANCHORS_OF_STRAIGHT if straight else _ANCHORS)
    needed = sorted({k for pair in proposed for k in pair})
    views = dict(zip(needed, see([int(order[k]) for k in needed]).values(), strict=True))
    pairs = Pairs(views, executor, None)
    base = base_mount(pairs.look, proposed, frames[0].quarter_turns)
    pairs.found.clear()
    rough = pairs.look(proposed, base, ROUGH)
    mount = _mount_by(rough, base) if rough else base
    found = pairs.look(proposed, mount, FINE)
    unexact = _check(found, len(proposed), within, ids)
    matched = [one.matched for one in found]
    if straight:
        unexact += _not_straight(mount_angles(base.T @ mount))
        mount = base
    fit = fit_circle(matched, within, mount, angles_known=True, mount_known=straight)
    share = refuse_without_stereo(found, fit)
    return ArmTurn(
        camera,
        tuple(frames),
        within,
        fit.mount,
        np.zeros(len(frames)),
        fit.mount_sigmas,
        quality_of(found, fit, views, share),
        (*said, *unexact, *about_mount(mount_angles(fit.mount), fit.mount_sigmas, camera.half_fov)),
    )


def _spread_pairs(within: FloatArray, anchors: int) -> list[tuple[int, int]]:
    """Pairs of frames at sorted angles (n,): some spread over the turn, each with those about `_SPANS` further."""
    n = len(within)
    around = np.concatenate([within, within + 2 * np.pi])
    pairs = set()
    for k in range(0, n, max(1, n // anchors)):
        for span in _SPANS:
            j = max(int(np.abs(around - within[k] - span).argmin()), k + 1) % n
            pairs.add((min(j, k), max(j, k)))
    return sorted(pairs)


def _mount_by(found: Sequence[FoundPair], base: FloatArray) -> FloatArray:
    """The mount (3, 3) by pairs, each of which turns as it tells itself, whatever was told."""
    apart = [one.matched._replace(i=2 * k, j=2 * k + 1) for k, one in enumerate(found)]
    return fit_circle(apart, np.array([[0, one.turn] for one in found]).ravel(), base).mount


def _not_straight(told: FloatArray) -> list[str]:
    """What is to be said of a camera that was told to be straight, and whose yaw, pitch and roll are these (3,)."""
    if np.abs(told[1:]).max() < _NOT_STRAIGHT:
        return []
    pitch, roll = np.degrees(told[1:])
    return [
        f"the camera is not straight on its arm (pitch {pitch:.2f}, roll {roll:.2f} degrees); --mount auto corrects it"
    ]


def _check(found: Sequence[FoundPair], proposed: int, within: FloatArray, ids: Sequence[str]) -> list[str]:
    """What is to be said of angles told (n,), by the turns of pairs.

    Raises
    ------
    GeometryError
        If most pairs contradict them.
    """
    if len(found) < max(LEAST_FRAMES // 2, proposed / 2):
        raise GeometryError(
            f"only {len(found)} of {proposed} pairs of frames that are told to be near each other have things in "
            "common; are the angles of these frames, in this order? Try --angles auto"
        )
    i, j = np.array([one.ends for one in found]).T
    told = (within[j] - within[i] + np.pi) % (2 * np.pi) - np.pi
    turned = np.array([one.turn for one in found])
    share = float(np.median(turned / told))
    if share < 0 and _contrary(-turned, told).mean() < 0.5:
        raise GeometryError(
            "the frames turn the other way than the angles told; give the other direction, or angles of the other sign"
        )
    wrong, gross = _contrary(turned, told), _contrary(turned, told, _GROSS, _LEAST_GROSS)
    if abs(share - 1) > _CONTRARY and _contrary(turned / share, told, _GROSS, _LEAST_GROSS).mean() < _FEW:
        than = "less than" if share < 1 else "more than"
        raise GeometryError(
            f"the frames turn by {share:.3f} of the angles told: {than} a full turn, about "
            f"{360 * share:.0f} degrees; {'give the rest of the turn, or ' if share < 1 else ''}try --angles auto"
        )
    if wrong.mean() > 0.5 or gross.mean() > _MOST_GROSS:
        k = int(np.flatnonzero(gross if gross.any() else wrong)[0])
        raise GeometryError(
            f"the frames contradict the angles told: from {ids[i[k]]} to {ids[j[k]]} the arm turned "
            f"{math.degrees(turned[k]):.2f} degrees, not {math.degrees(told[k]):.2f}; try --angles auto"
        )
    if wrong.any():
        some = names([f"{ids[i[k]]} to {ids[j[k]]}" for k in np.flatnonzero(wrong)])
        return [f"the frames contradict some of the angles told ({some}); --angles auto would find them"]
    off = 1.4826 * float(np.median(np.abs(turned - told - np.median(turned - told))))
    if off > _UNEXACT + 2 * float(np.median([one.sigma for one in found])):
        return [
            f"the angles told are off by about {math.degrees(off):.2f} degrees from frame to frame; --angles auto "
            "would find them"
        ]
    return []


def _contrary(
    turned: FloatArray, told: FloatArray, share: float = _CONTRARY, least: float = _LEAST_OFF
) -> NDArray[np.bool_]:
    """Which of the turns (m,) of pairs are not what was told (m,)."""
    contrary: NDArray[np.bool_] = np.abs(turned - told) > np.maximum(least, share * np.abs(told))
    return contrary
