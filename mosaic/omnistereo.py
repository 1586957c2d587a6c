"""Frames of a turning arm -> the 360 x 360 mosaic and its two eyes: the page of verbs.

    turn = find_turn(frames, camera, executor)
    made = omnistereo(turn, 4096, executor)
    left, right = made.eyes

A first, small mosaic is made as if all things were far; its eyes tell how near they are.  The second one is made with
that as its guide.  Geometry: docs/omnistereo.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.icc import Profile
from fullsphere.model.surface import Mosaic360
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import ArmTurn
from fullsphere.mosaic.assembly import COLUMNS, assemble
from fullsphere.mosaic.even_light import even_light
from fullsphere.mosaic.eyes import checked_width, eyes_of, mosaic_of
from fullsphere.mosaic.frame_colour import common_profile
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.stereo_range import filled_ranges, stereo_range
from fullsphere.mosaic.turn_pictures import TurnPictures
from fullsphere.mosaic.turn_reader import TurnReader

RING_BYTES = 1 << 30
"""Memory for what is kept of frames."""

_GUIDE_WIDTH = 1024  # of the first mosaic: between frames things move by few of its pixels
_WIDTHS = 64  # usual widths are multiples of it
_USUAL_GAPS = 3  # even steps that a frame is used for to either side, uneven ones among them
_ASIDE = math.radians(0.5)  # by near things
_LEAST_BEYOND = math.radians(0.3)  # 90 degrees a lens has to see
_LEAST_SQUARE = 0.1  # of rho^2 - 1: nothing stands nearer


@dataclasses.dataclass(frozen=True, eq=False)
class Omnistereo:
    """The mosaic of a turn.

    Attributes
    ----------
    codes
        (W, W, 3) the mosaic (`Mosaic360`): codes of `profile`, or linear light where it is float.
    seen
        (W, W) where any frame shows something.
    profile
        The colour space of the codes, that of the frames.
    gains
        (n, 3) what the light of each frame was multiplied by.
    """

    codes: NDArray[Any]
    seen: NDArray[np.bool_]
    profile: Profile
    gains: NDArray[np.float32]

    @property
    def eyes(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """What the left and the right eye see: equirectangular (W/2, W, 3)."""
        return eyes_of(self.codes)

    @property
    def eyes_seen(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Where the left and the right eye see anything (W/2, W)."""
        return eyes_of(self.seen)


def omnistereo(
    turn: ArmTurn,
    width: int | None = None,
    executor: Executor | None = None,
    *,
    pictures: TurnPictures | None = None,
    dtype: type[np.generic] = np.uint8,
    progress: Callable[..., Any] | None = None,
    room: Callable[[tuple[int, ...], type[np.generic]], NDArray[Any]] = np.empty,
) -> Omnistereo:
    """Make the mosaic of a turn.

    Parameters
    ----------
    turn
        The frames, their angles and how the camera is held.
    width
        And height of the mosaic, a multiple of 4; by default what the frames resolve.
    executor
        Where frames are opened and columns computed side by side.
    pictures
        Where frames are kept, made by `pictures_for`, some of them read before; by default all are opened now, once.
    dtype
        uint8 and uint16 are codes of the frames' colour space, float32 is linear light in its primaries.
    progress
        Wraps the loops.
    room
        Gives the array that the mosaic is put into; np.empty by default.

    Raises
    ------
    GeometryError
        If the camera does not see as far as 90 degrees from its axis.
    UsageError
        If the width is none.
    """
    refuse_narrow(turn.camera)
    size = checked_width(own_width(turn.camera) if width is None else width)
    pictures = pictures_for(turn.camera, turn.frames) if pictures is None else pictures
    wrap = progress or (lambda items, **_: items)
    unread = [frame for frame in turn.frames if not pictures.holds(frame)]
    for _ in wrap(ordered_map(executor, pictures.read, unread, ahead=4), title="reading frames", total=len(unread)):
        pass
    guide, gains = _first_look(turn, pictures, min(size, _GUIDE_WIDTH), executor)
    codes, seen = room((size, size, 3), dtype), room((size, size), np.bool_)
    profile = common_profile(turn.frames)
    reader = TurnReader(turn, pictures, Mosaic360((size, size)), guide)
    made = assemble(reader, gains, dtype, profile, executor)
    for columns in wrap(made, title="assembling", total=math.ceil(size / COLUMNS)):
        here = slice(columns.left, columns.left + columns.seen.shape[1])
        codes[:, here], seen[:, here] = columns.codes, columns.seen
    return Omnistereo(codes, seen, profile, gains)


def pictures_for(camera: Camera, frames: Sequence[Frame], kept_bytes: int = RING_BYTES) -> TurnPictures:
    """Where the frames of a full turn are to be kept, before their angles are known."""
    reach = _USUAL_GAPS * 2 * math.pi / max(len(frames), 1)
    tilted = camera.half_fov - math.pi / 2  # further tilted a camera does not see what it should
    return TurnPictures(camera, math.pi / 2 - reach - tilted - _ASIDE, kept_bytes, common_profile(frames))


def own_width(camera: Camera) -> int:
    """The width of a mosaic that shows what the camera resolves at 90 degrees from its axis."""
    right = np.array([math.pi / 2])
    per_radian = math.sqrt(float(camera.lens.radius(right)[0]) * float(camera.lens.slope(right)[0]) * camera.aspect)
    return math.ceil(2 * math.pi * per_radian / _WIDTHS) * _WIDTHS


def refuse_narrow(camera: Camera) -> None:
    """Raise GeometryError if the camera does not see as far as 90 degrees from its axis."""
    if camera.half_fov >= math.pi / 2 + _LEAST_BEYOND:
        return
    seen = math.degrees(camera.half_fov)
    slit = max(seen - 2, 0)
    raise GeometryError(
        f"the camera sees {seen:.1f} degrees from its axis, and the mosaic is made of the rays at 90 and a little "
        f"beyond; use a lens of 183 degrees or more. The slit at {slit:.0f} degrees would do for an approximation, "
        "which is not made here: "
        f"eyes on a circle of {math.sin(math.radians(slit)):.2f} arms, with elevations true at one distance only"
    )


def _first_look(
    turn: ArmTurn, pictures: TurnPictures, width: int, executor: Executor | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """One over the distance along each ray of a mosaic of `width`, in arm lengths, and the gains (n, 3) of the frames.

    From a mosaic that is made as if all were far, and frames that are compared first so and then as near as they are.
    """
    surface = Mosaic360((width, width))
    far = TurnReader(turn, pictures, surface, None)
    codes = np.empty((width, width, 3), np.uint8)
    for columns in assemble(far, even_light(far, executor), executor=executor):
        codes[:, columns.left : columns.left + columns.seen.shape[1]] = columns.codes
    guide = mosaic_of(*(_nearness(rho) for rho in filled_ranges(*eyes_of(codes))))
    return guide, even_light(TurnReader(turn, pictures, surface, guide), executor)


def _nearness(rho: NDArray[np.float32]) -> NDArray[np.float32]:
    """One over the distance along the ray of each pixel of an eye, of what is `rho` from the turning axis.

    The ray touches the circle of the camera's positions: its horizontal part from there is sqrt(rho^2 - 1), and
    cos(latitude) of the whole.
    """
    height = len(rho)
    latitudes = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    return np.asarray(np.cos(latitudes)[:, None] / np.sqrt(np.maximum(rho**2 - 1, _LEAST_SQUARE)), np.float32)


def range_from(made: Omnistereo, width: int) -> NDArray[np.float32]:
    """The range from the turning axis (width/2, width) as the left eye sees it, arm lengths; NaN where it is not known.

    The eyes are made as small first; a mosaic has to be at least as wide.
    """
    size = (width, width // 2)
    pairs = zip(made.eyes, made.eyes_seen, strict=True)
    small = [(cv2.resize(eye, size, interpolation=cv2.INTER_AREA), _all_of(seen, size)) for eye, seen in pairs]
    (left, left_seen), (right, _) = small
    found = stereo_range(left, right)[0].rho
    return np.where(left_seen, found, np.float32(np.nan))


def _all_of(seen: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.bool_]:
    return np.asarray(cv2.resize(seen.astype(np.uint8), size, interpolation=cv2.INTER_AREA) > 0)
