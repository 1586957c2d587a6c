"""How bright a panorama is: the exposure that all frames are brought to."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.colour import largest_channel
from fullsphere.model.errors import UsageError
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.frame_light import gain_of
from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.sphere_pyramid import latitudes

_TRUSTED = 0.9  # of what a frame can record: brighter is clipped, and says only that it is bright
_LIGHT = 1.001  # more than this is in no frame of codes: such a frame holds light, which is not clipped
_LOST = 0.001  # of the sphere: so much may be brighter than white, as lamps and the sun are
_MOST_DARKER_EV = 2.0


class Exposure(NamedTuple):
    """What the exposure of a panorama follows.

    Attributes
    ----------
    by
        "auto": the mean of the frames, and so much darker that highlights which some frame recorded are kept.
        "frame": one frame keeps its brightness and its white balance.
        "none": every frame keeps its own, and its vignetting; for frames that were evened out before.
    frame
        The frame's name, or its number from 1; for "frame" only.
    """

    by: Literal["auto", "frame", "none"] = "auto"
    frame: str = ""


def parse_exposure(text: str) -> Exposure:
    """What "auto", "none", "frame 3" or "frame NAME" mean; a colon or = may stand for the space.

    Raises
    ------
    UsageError
        For anything else.
    """
    if text in ("auto", "none"):
        return Exposure("auto" if text == "auto" else "none")
    found = re.fullmatch(r"frame[\s:=]+(\S.*)", text)
    if found is None:
        raise UsageError(f"exposure {text!r} is none of auto, none, frame N (from 1) and frame NAME")
    return Exposure("frame", found[1].strip())


def compensated(mosaic: Mosaic, exposure: Exposure) -> Mosaic:
    """The mosaic with what is to be taken out of its frames; the first step to a panorama.

    Raises
    ------
    UsageError
        If the frame that is to keep its brightness is not in the mosaic, or has no place in it.
    """
    if exposure.by == "auto":
        return mosaic
    if exposure.by == "none":
        plain = tuple(dataclasses.replace(f, exposure_ev=0.0, white_balance=(1.0, 1.0, 1.0)) for f in mosaic.frames)
        return dataclasses.replace(mosaic, frames=plain, vignetting_ev=(), shade_ev=())
    kept = _named(mosaic, exposure.frame)
    return dataclasses.replace(mosaic, frames=tuple(_beside(frame, kept) for frame in mosaic.frames))


def reference_ev(mosaic: Mosaic, exposure: Exposure, overviews: Sequence[Overview]) -> float:
    """How much brighter than the reference of a `compensated` mosaic its panorama is to be, EV; never above 0.

    Parameters
    ----------
    mosaic
        After `compensated`.
    exposure
        What the exposure follows.
    overviews
        Its registered frames on the working sphere.

    Returns
    -------
    0, but for "auto" where more than a thousandth of the sphere, by what unclipped pixels show, is above white.
    """
    if exposure.by != "auto" or not any(seen.light.max() > 1 for seen in overviews):
        return 0.0
    brightest, seen = _highlights(mosaic, overviews)
    if not seen.any():
        return 0.0
    rows = np.cos(latitudes(len(seen)))
    weight = np.broadcast_to(rows[:, None], seen.shape)[seen]
    order = np.argsort(brightest[seen], kind="stable")
    share = np.cumsum(weight[order]) / weight.sum()
    kept = float(brightest[seen][order][np.searchsorted(share, 1 - _LOST)])
    return -min(math.log2(kept), _MOST_DARKER_EV) if kept > 1 else 0.0


def _highlights(mosaic: Mosaic, overviews: Sequence[Overview]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The scene's brightest channel (H, W) by the best frame that is not clipped there, and where there is one."""
    height, width = overviews[0].quality.shape
    rays = Equirectangular((width, height)).window_rays(slice(0, width), slice(0, height), np.float32)
    best, brightest = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    for frame, seen in zip(mosaic.registered, overviews, strict=True):
        assert frame.camera_from_world is not None
        z = rays @ frame.camera_from_world[2].astype(np.float32)
        recorded = largest_channel(seen.light / gain_of(mosaic, frame).at(z))
        limit = _TRUSTED if recorded.max() <= _LIGHT else math.inf
        better = (seen.quality > best) & (recorded < limit)
        best[better] = seen.quality[better]
        brightest[better] = largest_channel(seen.light)[better]
    return brightest, best > 0


def _named(mosaic: Mosaic, name: str) -> Frame:
    """A registered frame by its name, or by its number from 1."""
    found = [frame for frame in mosaic.frames if frame.id == name]
    if not found and name.isdecimal() and 1 <= int(name) <= len(mosaic.frames):
        found = [mosaic.frames[int(name) - 1]]
    if not found:
        raise UsageError(
            f"exposure frame {name}: there is no such frame; the mosaic has {len(mosaic.frames)}, from "
            f"{mosaic.frames[0].id} to {mosaic.frames[-1].id}"
        )
    if not found[0].registered:
        raise UsageError(f"exposure frame {name}: {found[0].id} is left out, it {found[0].reason}; name another")
    return found[0]


def _beside(frame: Frame, kept: Frame) -> Frame:
    red, green, blue = (own / other for own, other in zip(frame.white_balance, kept.white_balance, strict=True))
    return dataclasses.replace(
        frame, exposure_ev=frame.exposure_ev - kept.exposure_ev, white_balance=(red, green, blue)
    )
