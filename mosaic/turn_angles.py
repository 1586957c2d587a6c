"""Frames of a turning arm -> its turn angles and how the camera is held: the page of verbs.

    turn = find_turn(frames, camera, executor)                  angles and mount
    turn = find_turn(frames, camera, executor, even)            angles are told: checked, and the mount

Keypoints are matched between neighbours and between frames up to 45 degrees apart.  Each pair tells its turn by itself,
whatever is near or far; the turns place all frames, and one fit over all matches makes angles and mount exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.arm import ArmTurn, mount_angles
from fullsphere.mosaic.frames import refuse_if_fewer, without_doubles
from fullsphere.mosaic.project import Frame, Picture
from fullsphere.mosaic.turn_diagnosis import (
    about_mount,
    missing_frames,
    names,
    out_of_order,
    refuse_part,
    refuse_without_stereo,
    standing_still,
    surplus,
)
from fullsphere.mosaic.turn_frames import LEAST_FRAMES
from fullsphere.mosaic.turn_solve import Pairs, Progress, quality_of, solve
from fullsphere.mosaic.turn_told import told_turn
from fullsphere.mosaic.turn_views import View, keypoints_for, view


def find_turn(
    frames: Sequence[Frame],
    camera: Camera,
    executor: Executor | None = None,
    angles: FloatArray | None = None,
    *,
    straight: bool = False,
    picture_of: Callable[[Frame], Picture] | None = None,
    progress: Progress | None = None,
) -> ArmTurn:
    """The turn angles of frames, and how the camera is held on its arm.

    Parameters
    ----------
    frames
        Of one turn, either way; those with a reason are left out.
    camera
        That took all of them.
    executor
        Where frames and pairs are worked on side by side.
    angles
        Turn angles (n,) in radians of all frames, if they are known; they are checked by some pairs of frames then.
    straight
        The camera is held straight: its mount is not estimated.
    picture_of
        Opens a frame's pixels, each once; by default `Frame.load`.  With known angles only some frames are opened.
    progress
        Wraps the loops.

    Returns
    -------
    The turn, its frames sorted by angle; the first frame given has the angle 0 unless angles were told.

    Raises
    ------
    InputError
        If there are too few frames, or one is not of the camera's size.
    GeometryError
        If the frames are less than a full turn, match nothing, show no parallax, or contradict the angles told.
    """
    if angles is not None and np.shape(angles) != (len(frames),):
        raise UsageError(f"{len(frames)} frames and {np.size(angles)} turn angles; give one angle for each frame")
    checked = _without_doubles(frames)
    usable = np.array([k for k, frame in enumerate(checked) if not frame.reason], int)
    doubles = [b.id for a, b in zip(frames, checked, strict=True) if b.reason and not a.reason]
    refuse_if_fewer(checked, LEAST_FRAMES, f"a full turn needs at least {LEAST_FRAMES} frames")
    kept = [checked[k] for k in usable]
    said = [f"{names(doubles)}: the same picture as an earlier frame, left out"] if doubles else []
    opened = picture_of or (lambda frame: frame.load())

    def seen(indices: Sequence[int]) -> dict[int, View]:
        most = keypoints_for(len(indices))
        views = ordered_map(executor, lambda k: view(kept[k], opened(kept[k]), camera, most), indices, ahead=4)
        wrap = progress or (lambda items, **_: items)
        return dict(zip(indices, wrap(views, title="finding keypoints", total=len(indices)), strict=True))

    if angles is not None:
        return told_turn(kept, camera, np.asarray(angles, float)[usable], seen, executor, straight, said)
    return turn_of_views(
        kept, camera, seen(range(len(kept))), executor, straight=straight, said=said, progress=progress
    )


def turn_of_views(
    frames: Sequence[Frame],
    camera: Camera,
    views: Mapping[int, View],
    executor: Executor | None = None,
    *,
    straight: bool = False,
    said: Sequence[str] = (),
    progress: Progress | None = None,
) -> ArmTurn:
    """`find_turn` of frames (n,) whose keypoints are found: `views` by their indices."""
    pairs = Pairs(views, executor, progress)
    solved = solve(pairs, len(frames), frames[0].quarter_turns, straight)
    fit, ids = solved.fit, [frame.id for frame in frames]
    said = list(said)
    if not solved.together.all():
        lost = [ids[k] for k in np.flatnonzero(~solved.together)]
        said.append(f"{names(lost)}: nothing in common with the other frames, left out; see whether it is of this turn")
    kept = np.flatnonzero(solved.together)
    more = surplus(solved.progress, fit.angles, kept)
    if more.any():
        over = math.degrees(float(np.ptp(solved.progress[kept]))) % 360
        beyond = names([ids[k] for k in kept[more]])
        said.append(f"the frames are more than one full turn, by {over:.1f} degrees: {beyond} left out")
        kept = kept[~more]
    still = standing_still(fit.angles, fit.sigmas, kept)
    if still.any():
        said.append(f"{names([ids[k] for k in kept[still]])}: the arm stood still, left out")
        kept = kept[~still]
    forward = 1.0 if np.median(np.diff(solved.progress[kept])) >= 0 else -1.0
    within = np.mod(fit.angles[kept] - fit.angles[kept[0]], 2 * np.pi)
    moved = out_of_order(within, forward)
    if len(moved):
        which = names([ids[kept[k]] for k in moved])
        said.append(f"frames are not in the order of turning, {len(moved)} of them were sorted in: {which}")
    order = np.argsort(within, kind="stable")
    chosen, within = kept[order], within[order]
    sorted_ids = [ids[k] for k in chosen]
    refuse_part(within, sorted_ids)
    share = refuse_without_stereo(solved.found, fit)
    said += missing_frames(within, sorted_ids)
    said += about_mount(mount_angles(fit.mount), fit.mount_sigmas, camera.half_fov)
    return ArmTurn(
        camera,
        tuple(frames[k] for k in chosen),
        within,
        fit.mount,
        fit.sigmas[chosen],
        fit.mount_sigmas,
        quality_of(solved.found, fit, views, share),
        tuple(said),
    )


def _without_doubles(frames: Sequence[Frame]) -> list[Frame]:
    """The frames, those left out whose file is the same as an earlier one's; pictures that are no files are not."""
    files = iter(without_doubles([frame for frame in frames if frame.sha256]))
    return [next(files) if frame.sha256 else frame for frame in frames]
