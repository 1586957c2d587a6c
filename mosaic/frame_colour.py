"""The colour space of frames: all in one, or those of several brought into sRGB."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.icc import SRGB, Profile
from fullsphere.mosaic.project import Frame, Picture

_ROWS = 256  # converted at once


def own_profile(frame: Frame) -> Profile:
    """The colour space of a frame's codes; raises InputError if its file cannot be read."""
    return SRGB if frame.profile is None else frame.profile()


def common_profile(frames: Sequence[Frame]) -> Profile:
    """The colour space that frames are composed in: their own where they have one and the same, else sRGB."""
    found = {profile.icc: profile for profile in map(own_profile, frames)}
    only = next(iter(found.values()), SRGB)
    return only if len(found) == 1 and not only.grey else SRGB


def in_profile(picture: Picture, own: Profile, wanted: Profile) -> Picture:
    """Pixels (h, w, c) as codes of another colour space: of 16 bits, unless they mean the same in both.

    What is beyond the wanted primaries is clipped.  Floating-point pixels are light, and stay as they are.
    """
    if picture.dtype.kind == "f" or own.icc == wanted.icc or (own.is_srgb and wanted.is_srgb):
        return picture
    wanted_from_own = np.linalg.solve(wanted.srgb_from_own, own.srgb_from_own).T.astype(np.float32)
    converted = np.empty(picture.shape, np.uint16)
    for top in range(0, len(picture), _ROWS):
        light = linear_from_encoded(picture[top : top + _ROWS], own)
        if picture.shape[2] >= 3:
            light[..., :3] = light[..., :3] @ wanted_from_own
        converted[top : top + _ROWS] = encoded_from_linear(light, np.uint16, wanted)
    return converted


def srgb_light(light: NDArray[np.float32], own: Profile) -> NDArray[np.float32]:
    """Linear light (..., 3) of a colour space in the primaries of sRGB, which files of floats are in."""
    to_srgb = own.srgb_from_own.T.astype(np.float32)
    return light if np.array_equal(to_srgb, np.eye(3)) else np.asarray(light @ to_srgb)


def colour_notes(frames: Sequence[Frame]) -> tuple[str, ...]:
    """What a person should know of the colour spaces of registered frames, in plain sentences."""
    own = [own_profile(frame) for frame in frames]
    notes = []
    for doubt in dict.fromkeys(profile.doubt for profile in own if profile.doubt):
        names = [frame.id for frame, profile in zip(frames, own, strict=True) if profile.doubt == doubt]
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        notes.append(f"{', '.join(names[:3])}{more}: the colour profile {doubt}; its codes are taken for those of sRGB")
    if len({profile.icc for profile in own}) > 1 and not all(profile.is_srgb for profile in own):
        notes.append("the frames have several colour profiles; what is made of them is in sRGB")
    return tuple(notes)
