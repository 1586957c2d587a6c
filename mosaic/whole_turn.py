"""`find_turn` of frames that are read once: pictures are kept on the way, and what cannot be read is left out."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import ArmTurn
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.turn_angles import find_turn
from fullsphere.mosaic.turn_pictures import TurnPictures
from fullsphere.mosaic.turn_solve import Progress


def whole_turn(
    frames: Sequence[Frame],
    camera: Camera,
    pictures: TurnPictures,
    angles: FloatArray | None = None,
    straight: bool = False,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> tuple[list[Frame], ArmTurn]:
    """All frames, those left out that turn out to be damaged, and the turn of the others.

    Parameters
    ----------
    frames
        In any state: those with a reason stay left out.
    camera, straight, executor, progress
        As `find_turn` takes them.
    pictures
        Where they are kept.
    angles
        Turn angles (n,) in radians of all frames, if they are told.

    Raises
    ------
    InputError, GeometryError
        As `find_turn` does.
    """
    reader = _Reader(pictures)
    if angles is not None:  # else each is read when its keypoints are found
        wrap = progress or (lambda items, **_: items)
        usable = [frame for frame in frames if not frame.reason]
        for _ in wrap(ordered_map(executor, reader.tried, usable, ahead=4), title="reading frames", total=len(usable)):
            pass
    while True:
        frames = [f.left_out(reader.damaged[f.id]) if f.id in reader.damaged else f for f in frames]
        chosen = [k for k, frame in enumerate(frames) if not frame.reason]
        known = len(reader.damaged)
        try:
            turn = find_turn(
                [frames[k] for k in chosen],
                camera,
                executor,
                None if angles is None else np.asarray(angles)[chosen],
                straight=straight,
                picture_of=reader.opened,
                progress=progress,
            )
        except InputError:
            if len(reader.damaged) == known:
                raise
        else:
            return frames, turn


class _Reader:
    """Opens frames, and notes which cannot be."""

    def __init__(self, pictures: TurnPictures) -> None:
        self._pictures = pictures
        self.damaged: dict[str, str] = {}

    def opened(self, frame: Frame) -> Picture:
        """The codes of a frame; InputError if it is damaged."""
        try:
            return self._pictures.read(frame)
        except InputError as error:
            self.damaged[frame.id] = str(error).removeprefix(f"{frame.image}: ")
            raise

    def tried(self, frame: Frame) -> None:
        """Open a frame if it can be."""
        with contextlib.suppress(InputError):
            self.opened(frame)
