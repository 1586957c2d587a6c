"""What is wrong with a turn, and what to try: refused in one line, or told beside the result."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.circular_fit import CircularFit
from fullsphere.mosaic.circular_motion import plane_of
from fullsphere.mosaic.turn_views import FoundPair

_HOLE, _HOLE_STEPS = math.radians(15), 3.0  # between frames, or even steps: more is no full turn
_MISSING = 1.8  # median gaps
_UNEVEN = 5.0  # standard deviations of gaps
_WHOLE, _WHOLE_SIGMAS = 0.15, 3.0  # median gaps by which a wide one may be off a whole number of them, or deviations
_STANDS_OUT = 1.5  # times as far above the median as any gap that is usual
_STILL, _STILL_AT_MOST = 0.02, 0.25  # even steps, whatever the noise of angles
_NEARLY = 0.2  # median gaps: so near the first frame a last one tells nothing new
_IN_ORDER = 0.8  # share of steps that go forward, in frames of which some may be too many
_SIGMAS = 3.0
_CLEAR = 4.0  # standard deviations of a match by which it shows parallax
_LEAST_CLEAR = 0.1  # share of matches that have to, of frames _FAR_APART and more
_FAR_APART = math.radians(20)
_LOOSE_YAW = math.radians(0.3)
_SHOWN = 3  # names


def names(ids: Sequence[str]) -> str:
    """Some of the names, with how many there are more."""
    more = len(ids) - _SHOWN
    return ", ".join(ids[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def refuse_part(within: FloatArray, ids: Sequence[str]) -> None:
    """GeometryError if frames at sorted angles (n,) leave too much of the full turn open."""
    gaps = np.diff(within, append=within[0] + 2 * np.pi)
    k = int(gaps.argmax())
    if gaps[k] <= max(_HOLE, _HOLE_STEPS * 2 * np.pi / len(gaps)):
        return
    after, before = ids[k], ids[(k + 1) % len(ids)]
    raise GeometryError(
        f"the frames are less than a full turn: they cover {360 - math.degrees(gaps[k]):.0f} degrees, and nothing is "
        f"there for the {math.degrees(gaps[k]):.0f} degrees between {after} and {before}; give the rest of the turn"
    )


def missing_frames(within: FloatArray, ids: Sequence[str]) -> list[str]:
    """Where a frame seems to be missing among frames at sorted angles (n,).

    There the gap is a whole number of usual ones, and clearly wider than all others; where the speed of the arm is
    uneven, some gap is always the widest.
    """
    gaps = np.diff(within, append=within[0] + 2 * np.pi)
    usual = float(np.median(gaps))
    uneven = max(1.4826 * float(np.median(np.abs(gaps - usual))), float(np.quantile(gaps, 0.85) - usual) / 1.036)
    wide = (gaps > _MISSING * usual) & (gaps > usual + _UNEVEN * uneven)
    off_whole = np.abs(gaps - usual * np.round(gaps / usual))
    if not wide.any() or gaps[wide].min() - usual < _STANDS_OUT * (gaps[~wide].max() - usual):
        return []
    places = np.flatnonzero(wide & (off_whole < max(_WHOLE * usual, _WHOLE_SIGMAS * uneven)))
    if not len(places) or len(places) > max(3, len(gaps) // 20):
        return []
    k = int(places[gaps[places].argmax()])
    others = len(places) - 1
    more = f", and in {others} more place{'s' if others > 1 else ''}" if others else ""
    between = f"{ids[k]} and {ids[(k + 1) % len(ids)]}"
    missing = round(gaps[k] / usual) - 1
    seem = "a frame seems" if missing == 1 else f"{missing} frames seem"
    return [
        f"{seem} to be missing between {between}{more}: they are {math.degrees(gaps[k]):.2f} degrees apart, "
        f"others {math.degrees(usual):.2f}; near things may be less sharp there"
    ]


def standing_still(angles: FloatArray, sigmas: FloatArray, kept: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of the frames `kept` (m,) show the arm where an earlier one (m,) does: no turn that could be told."""
    order = kept[np.argsort(np.mod(angles[kept], 2 * np.pi), kind="stable")]
    around = np.diff(np.mod(angles[order], 2 * np.pi), append=np.mod(angles[order[0]], 2 * np.pi) + 2 * np.pi)
    order = np.roll(order, -1 - int(around.argmax()))  # no place where the arm stood is cut in two
    gone = np.concatenate([[0], np.cumsum(np.mod(np.diff(angles[order]), 2 * np.pi))])
    even = 2 * np.pi / len(kept)
    still = np.zeros(len(angles), bool)
    begin, first = 0, int(order[0])
    for place in range(1, len(order)):
        k = int(order[place])
        noise = _SIGMAS * math.hypot(sigmas[order[begin]], sigmas[k])
        if gone[place] - gone[begin] < min(max(noise, _STILL * even), _STILL_AT_MOST * even):
            still[max(first, k)], first = True, min(first, k)
        else:
            begin, first = place, k
    return still[kept]


def surplus(progress: FloatArray, angles: FloatArray, kept: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of the frames `kept` (m,), given in the order of turning, go on where a full turn is complete.

    Parameters
    ----------
    progress
        How far the arm had turned (n,) by the pairs of frames that follow each other, radians, either direction.
    angles
        Exact ones (n,), but for full turns.
    kept
        Indices (m,).
    """
    steps = np.diff(progress[kept])
    forward = 1.0 if np.median(steps) >= 0 else -1.0
    if (forward * steps > 0).mean() < _IN_ORDER:
        return np.zeros(len(kept), bool)
    gone = forward * (progress[kept] - progress[kept[0]])
    exact = forward * (angles[kept] - angles[kept[0]])
    gone = exact + 2 * np.pi * np.round((gone - exact) / (2 * np.pi))
    usual = float(np.median(np.abs(steps)))
    beyond: NDArray[np.bool_] = gone >= 2 * np.pi - _NEARLY * usual
    if not beyond.any() or beyond.all():
        return np.zeros(len(kept), bool)
    left = np.sort(np.mod(exact[~beyond], 2 * np.pi))
    covered = np.diff(left, append=left[0] + 2 * np.pi).max() < _MISSING * usual
    return beyond if covered else np.zeros(len(kept), bool)


def out_of_order(within: FloatArray, forward: float) -> NDArray[np.intp]:
    """Places (k,) of frames at angles (n,) that stand elsewhere in the turn than in the order given."""
    n = len(within)
    rank = np.empty(n, int)
    rank[np.argsort(forward * within, kind="stable")] = np.arange(n)
    shift = (rank - np.arange(n)) % n
    usual = int(np.bincount(shift).argmax())
    displaced = (shift - usual + n // 2) % n - n // 2
    return np.flatnonzero(np.abs(displaced) >= 2)


def refuse_without_stereo(found: Sequence[FoundPair], fit: CircularFit) -> float:
    """GeometryError if frames far apart show no parallax; otherwise the share of matches that do."""
    far = [one for one in found if abs(one.turn) > _FAR_APART]
    clear, count = 0, 0
    for one in far or found:
        i, j = one.ends
        rays = one.matched.rays
        turn = math.remainder(fit.angles[j] - fit.angles[i], 2 * math.pi)
        beyond = plane_of(rays, fit.mount, turn).beyond
        noise = max(fit.spread, 0.5) * np.hypot(rays.noise_first, rays.noise_second)
        clear += int((beyond > _CLEAR * noise).sum())
        count += len(beyond)
    share = clear / max(count, 1)
    if far and share < _LEAST_CLEAR:
        raise GeometryError(
            f"no stereo: only {100 * share:.1f}% of the matches of frames far apart show parallax, so the camera "
            "turned about its own centre, or all is far; make a panorama by 'fullsphere stitch', also as 360x360"
        )
    return share


def about_mount(told: FloatArray, sigmas: FloatArray, half_fov: float) -> list[str]:
    """What is to be said of yaw, pitch and roll (3,), radians."""
    said = []
    reach = half_fov - math.pi / 2
    tilt = float(np.hypot(told[0], told[1]))
    if tilt > reach:
        said.append(
            f"the camera's axis is {math.degrees(tilt):.2f} degrees off the arm (yaw {math.degrees(told[0]):.2f}, "
            f"pitch {math.degrees(told[1]):.2f}), and the lens sees {math.degrees(reach):.2f} beyond 90: parts of "
            "the mosaic stay empty; align the camera"
        )
    if sigmas[0] > _LOOSE_YAW:
        said.append(
            f"the camera's yaw is known to {math.degrees(sigmas[0]):.1f} degrees only, because most things are far; it "
            "was taken to be small"
        )
    return said
