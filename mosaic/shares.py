"""What each frame gives to a panorama, decided on the working sphere: which directions, and how much brightened.

A panorama is made in two scales.  At full resolution a frame's light L_k only comes in where the frame owns, with a
narrow edge w_k; what differs between frames at larger scales is evened out on the working sphere,

    F + e = sum_k w_k (L_k + e) exp(D_k) / sum_k w_k,

so that a tile of any surface needs no other tile.  With f_k the logarithm of what a frame shows there, P_k + e, less
that of the frame that owns the place, and B the blend of all f_k in many bands (Burt and Adelson 1983), D_k = B - f_k:
the blend of the pictures themselves, but frames that agree stay exactly as they are, however little they overlap.
Two scales after Brown and Lowe (IJCV 2007, section 7).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import largest_channel
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.blend import Bands, MultiBand, filled
from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.shift import Shift
from fullsphere.mosaic.sphere_pyramid import expand, latitudes, reduce

FLOOR = 0.02
"""Light e that is added before a logarithm is taken: differences in deeper shade are not brought out."""

_REACH = 3  # nodes around a place whose values are read there: two of the spline's, and one for rounding
_SEEN = 0.5  # of a pixel: less does not tell its light
_UNLIKE = 0.4  # natural logarithm: what differs by more from what is usual is another thing
_ANY = 1e-6  # what a frame counts for that sees and owns nothing
_MOST_BRIGHTER = 1.5  # natural logarithm: a frame is never changed by more, whatever another shows there


@dataclasses.dataclass(frozen=True, eq=False)
class Share:
    """A window of the working sphere: (h, w, 4) how much a frame owns, and the logarithms that brighten its channels.

    It starts at column `left` and row `top`; rows may lie past a pole, columns past the right edge.
    """

    left: int
    top: int
    values: NDArray[np.float32]


@dataclasses.dataclass(frozen=True, eq=False)
class Shares:
    """What all frames give.

    Attributes
    ----------
    sphere
        The working sphere.
    owners
        (H, W) which frame owns each of its pixels.
    of
        The share of each frame; None of one that gives nothing.
    owning, seeing
        (H, W, n) bits: the frames that may own something near a pixel, and those that may see something.
    shifts
        By how much each frame is read aside, so that it meets its neighbours; empty for not at all.
    """

    sphere: Equirectangular
    owners: NDArray[np.int16]
    of: tuple[Share | None, ...]
    owning: NDArray[np.uint64]
    seeing: NDArray[np.uint64]
    shifts: tuple[Shift | None, ...] = ()


def shares_of(
    overviews: Sequence[Overview],
    owners: NDArray[np.int16],
    sphere: Equirectangular,
    executor: Executor | None = None,
) -> Shares:
    """What each frame gives, if `owners` (H, W) says which frame owns what."""
    height, width = owners.shape
    kept = [k for k in range(len(overviews)) if (owners == k).any()]
    looks = dict(zip(kept, ordered_map(executor, lambda k: _look(overviews[k], owners == k), kept), strict=True))
    agreed, covered = _composite(list(looks.values()))
    blender = MultiBand(height // 2, width // 2)

    def prepared(k: int) -> tuple[NDArray[np.float32], Bands]:
        log, seen, mask = looks[k]
        differs, alike = log - agreed, _alike(log - agreed, seen & covered) | (seen & (mask > _SEEN))
        differs = filled(differs, alike)
        return differs, blender.taken_apart(differs, alike, mask)

    differences = {}
    for k, (differs, bands) in zip(kept, ordered_map(executor, prepared, kept, ahead=4), strict=True):
        differences[k] = differs
        blender.add(bands)
    blended = blender.blended()

    def made(k: int) -> Share:
        return _share(owners == k, expand(blended - differences[k]))

    shares = dict(zip(kept, ordered_map(executor, made, kept), strict=True))
    of = tuple(shares.get(k) for k in range(len(overviews)))
    return Shares(
        sphere, owners, of, _bits([owners == k for k in range(len(of))]), _bits([one.seen for one in overviews])
    )


def feathered(overviews: Sequence[Overview], sphere: Equirectangular) -> Shares:
    """Every frame mixed with all others wherever it sees, by how well it sees: soft, and what moved is double."""
    seen = [one.seen for one in overviews]
    owners = np.argmax([one.quality for one in overviews], axis=0).astype(np.int16)
    nothing = np.zeros((*owners.shape, 3), np.float32)
    of = tuple(_window(one.seen, one.quality, nothing) if one.seen.any() else None for one in overviews)
    bits = _bits(seen)
    return Shares(sphere, owners, of, bits, bits)


def whole_share(sphere: Equirectangular) -> Share:
    """The share of a frame that owns everything, as it is."""
    width, height = sphere.size
    values = np.zeros((height + 2 * _REACH, width + 2 * _REACH, 4), np.float32)
    values[..., 0] = 1
    return Share(0, -_REACH, values)


class _Look(NamedTuple):
    """A frame at half the size of the working sphere, at which neither noise nor its grid of pixels is left."""

    log: NDArray[np.float32]  # of its light, and the floor
    seen: NDArray[np.bool_]
    mask: NDArray[np.float32]  # how much of a pixel it owns


def _look(overview: Overview, owned: NDArray[np.bool_]) -> _Look:
    share = overview.seen.astype(np.float32)
    light, share = reduce(overview.light * share[..., None]), reduce(share)
    mean = np.maximum(light, 0) / np.maximum(share, np.float32(_SEEN))[..., None]
    return _Look(np.log(mean + np.float32(FLOOR)), share > _SEEN, reduce(owned.astype(np.float32)))


def _alike(differs: NDArray[np.float32], both: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a frame shows what the others do, if not as bright: what moved is no difference of brightness."""
    if not both.any():
        return both
    latitude = latitudes(len(both))[np.nonzero(both)[0]]
    even = np.random.default_rng(0).random(latitude.size) < np.cos(latitude)  # each direction as likely as any other
    usual = np.median(differs[both][even], axis=0) if even.any() else np.zeros(3)
    alike: NDArray[np.bool_] = both & (largest_channel(np.abs(differs - usual)) < _UNLIKE)
    return alike


def _composite(looks: Sequence[_Look]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """What the frames show together, each where it owns most of those that see, and where any does."""
    agreed, most = np.zeros_like(looks[0].log), np.zeros(looks[0].seen.shape, np.float32)
    for look in looks:
        wins = look.seen & (look.mask + np.float32(_ANY) > most)
        agreed[wins], most[wins] = look.log[wins], look.mask[wins] + np.float32(_ANY)
    return agreed, most > 0


def _share(owned: NDArray[np.bool_], brighter: NDArray[np.float32]) -> Share:
    soft = cv2.GaussianBlur(_beyond(owned, _REACH).astype(np.float32), (3, 3), 0.7)[_REACH:-_REACH, _REACH:-_REACH]
    return _window(owned, soft, np.clip(brighter, -_MOST_BRIGHTER, _MOST_BRIGHTER))


def _window(around: NDArray[np.bool_], much: NDArray[np.float32], brighter: NDArray[np.float32]) -> Share:
    """The window around some pixels of the working sphere, with all that is read from places near them."""
    width = around.shape[1]
    near = cv2.dilate(_beyond(around, _REACH).astype(np.uint8), np.ones((2 * _REACH + 1,) * 2, np.uint8))
    rows = np.flatnonzero(near.any(1))
    top, bottom = int(rows[0]), int(rows[-1]) + 1
    left, count = _widest_gap(near.any(0)[_REACH:-_REACH])
    columns = np.arange(left, left + count) % width
    values = np.dstack([much, brighter]).astype(np.float32)
    beyond = _beyond(values, _REACH)[top:bottom, _REACH:-_REACH]
    return Share(left, top - _REACH, np.ascontiguousarray(beyond[:, columns]))


def _beyond(values: NDArray[Any], reach: int) -> NDArray[Any]:
    """An array (H, W, ...) with `reach` more pixels on all sides, as the sphere goes on there."""
    height, width = values.shape[:2]
    rows = np.arange(-reach, height + reach)
    past = (rows < 0) | (rows >= height)
    rows = np.where(rows < 0, -1 - rows, np.where(rows >= height, 2 * height - 1 - rows, rows))
    columns = np.arange(-reach, width + reach) % width
    there = np.where(past[:, None], (columns + width // 2) % width, columns)
    beyond: NDArray[Any] = values[rows[:, None], there]
    return beyond


def _widest_gap(used: NDArray[np.bool_]) -> tuple[int, int]:
    """First column and number of columns, going round, outside which none is used; all where little is gained."""
    width = used.size
    at = np.flatnonzero(used)
    gaps = np.diff(np.append(at, at[0] + width))
    widest = int(gaps.argmax())
    if gaps[widest] <= 2 * _REACH + 2:
        return 0, width + 2 * _REACH  # so that every place has its neighbours to the right
    first = int(at[(widest + 1) % at.size])
    return first, int(width - gaps[widest] + 1)


def _bits(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint64]:
    height, width = masks[0].shape
    bits = np.zeros((height, width, -(-len(masks) // 64)), np.uint64)
    square = np.ones((2 * _REACH + 1,) * 2, np.uint8)
    for k, mask in enumerate(masks):
        if mask.any():
            near = cv2.dilate(_beyond(mask, _REACH).astype(np.uint8), square)[_REACH:-_REACH, _REACH:-_REACH]
            bits[..., k // 64] |= near.astype(np.uint64) << np.uint64(k % 64)
    return bits
