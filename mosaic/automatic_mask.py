"""What turns with the camera is hidden in its frames, where others see the scene behind it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.turning_things import turning_things


class Hidden(NamedTuple):
    """The mosaic with masks, and what share of the picture of each camera (c,) they hide."""

    mosaic: Mosaic
    share: tuple[float, ...]


def without_turning_things(mosaic: Mosaic, seen: Sequence[Overview], executor: Executor | None = None) -> Hidden:
    """Give a mask to the frames of each camera with which something turns.

    Parameters
    ----------
    mosaic
        The solved project; frames that have masks keep them.
    seen
        Its registered frames on the working sphere.
    executor
        Where frames are compared side by side.
    """
    registered = mosaic.registered
    frames, shares = list(mosaic.frames), []
    for c, camera in enumerate(mosaic.cameras):
        own = [k for k, frame in enumerate(registered) if frame.camera == c and frame.mask is None]
        turns = [registered[k].camera_from_world for k in own]
        thing = turning_things([seen[k] for k in own], [turn for turn in turns if turn is not None], camera, executor)
        shares.append(0.0 if thing is None else float(thing.mean()))
        if thing is None:
            continue
        mask = functools.partial(_same, np.where(thing, 0, 255).astype(np.uint8))
        for k, frame in enumerate(frames):
            if frame.registered and frame.camera == c and frame.mask is None:
                frames[k] = dataclasses.replace(frame, mask=mask)
    if not any(shares):
        return Hidden(mosaic, tuple(shares))
    return Hidden(dataclasses.replace(mosaic, frames=tuple(frames)), tuple(shares))


def _same(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return mask
