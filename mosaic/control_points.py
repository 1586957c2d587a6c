"""A Hugin project adjusted by its control points alone: its pictures are not opened, and need not be there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray, KannalaBrandt, Perspective
from fullsphere.mosaic.adjust import Adjustment, adjust
from fullsphere.mosaic.orientation import connected_groups, first_orientations
from fullsphere.mosaic.project import Link, Mosaic
from fullsphere.mosaic.pto import NORMAL, Project, links_of
from fullsphere.mosaic.rig import Rig

_LOST = math.radians(5)  # median distance of control points under orientations that were never optimised
_SCALES_PX = (16.0, 4.0, 1.0)
_POINTS_FOR_A_LENS = 100  # of a camera: with fewer its values stay as the project has them
_NODES = 200


def register_points(project: Project, refine: bool = True) -> Mosaic:
    """The mosaic that a project's control points determine.

    It starts from the project's orientations, or, where they are those of no optimised project, from the points alone.
    The world stays that of the project: the frames are turned as little as possible on the whole.

    Parameters
    ----------
    project
        Its points of the kind `NORMAL` are used.
    refine
        Whether the cameras are adjusted too, where they have enough points; by Kannala-Brandt lenses where the
        project's lens is not an ordinary one.

    Raises
    ------
    GeometryError
        If the points hold no two frames together, or do not determine their orientations.
    """
    cameras, frames, rotations = project.cameras, project.frames, project.rotations
    links = links_of(project.points, cameras, frames, rotations)
    group = connected_groups(links, len(frames))[0]
    if len(group) < 2:
        raise GeometryError("the project has no control points between two of its pictures; match them anew")
    links = [link for link in links if link.i in group]
    if not np.nanmedian(distances(project, rotations, cameras)) < _LOST:
        rotations = first_orientations(links, group, len(frames))
    rig = Rig(np.array([frame.camera for frame in frames], np.intp), np.arange(len(frames)))
    adjusted = _adjusted(links, rotations, group, cameras, rig, ())
    free = _to_refine(links, rig, len(cameras)) if refine else np.zeros(0, bool)
    if free.any():
        opened = [_polynomial(camera) if wanted else camera for camera, wanted in zip(cameras, free, strict=True)]
        names = tuple(dict.fromkeys(name for camera in opened for name in camera.parameter_names if name != "aspect"))
        adjusted = _adjusted(links, adjusted.rotations, group, opened, rig, names)
    return _mosaic(project, links, group, adjusted)


def distances(project: Project, rotations: FloatArray, cameras: Sequence[Camera] | None = None) -> FloatArray:
    """Angles (n,) in radians between the two rays of each control point of the kind `NORMAL`.

    NaN where a camera does not see one.

    Parameters
    ----------
    project
        Whose control points.
    rotations
        camera_from_world (n, 3, 3) of its frames.
    cameras
        Those that turn pixels into rays, one for each of the project's; without them the project's own lenses do, as
        Hugin has them.
    """
    points = project.points.where(project.points.kind == NORMAL)

    def rays(frames: NDArray[np.intp], pixels: FloatArray) -> FloatArray:
        found = np.full((len(frames), 3), np.nan)
        for k, frame in enumerate(project.frames):
            own = frames == k
            if cameras is None:
                corner = np.array((frame.crop_px or (0, 0))[:2], float)
                found[own] = project.lenses[k].unproject(pixels[own] + corner) @ rotations[k]
            else:
                found[own] = cameras[frame.camera].unproject(pixels[own]) @ rotations[k]
        return found

    chord = np.linalg.norm(rays(points.i, points.pixels_i) - rays(points.j, points.pixels_j), axis=1)
    return np.asarray(2 * np.arcsin(np.minimum(chord / 2, 1)))


def _adjusted(
    links: Sequence[Link],
    rotations: FloatArray,
    group: NDArray[np.intp],
    cameras: Sequence[Camera],
    rig: Rig,
    free: Sequence[str],
) -> Adjustment:
    for scale in _SCALES_PX:
        adjusted = adjust(links, rotations, group, cameras, free, scale, rig=rig)
        rotations, cameras = adjusted.rotations, adjusted.cameras
    return adjusted


def _to_refine(links: Sequence[Link], rig: Rig, cameras: int) -> NDArray[np.bool_]:
    """Which cameras (c,) may be adjusted: all of those used, if each has enough points."""
    count = np.zeros(cameras)
    for link in links:
        for frame in (link.i, link.j):
            count[rig.camera_of[frame]] += len(link.pixels_i)
    enough = bool((count[count > 0] >= _POINTS_FOR_A_LENS).all())
    return np.asarray((count > 0) & enough)


def _polynomial(camera: Camera) -> Camera:
    """The camera with a lens that can take any curve, if its own is a formula of the angle with one value only."""
    if len(camera.lens.values) > 1 or isinstance(camera.lens, Perspective):
        return camera
    theta = np.linspace(0, camera.half_fov, _NODES)
    powers = theta[:, None] ** np.arange(1, 10, 2)
    first, *higher = np.linalg.lstsq(powers, camera.lens.radius(theta), rcond=None)[0].tolist()
    try:
        return dataclasses.replace(camera, lens=KannalaBrandt(first, *(k / first for k in higher)))
    except CameraError:
        return camera


def _mosaic(project: Project, links: Sequence[Link], group: NDArray[np.intp], adjusted: Adjustment) -> Mosaic:
    before, after = project.rotations[group], adjusted.rotations[group]
    turn = Rotation.from_matrix(np.swapaxes(after, 1, 2) @ before).mean().as_matrix()  # world after -> world before
    frames = []
    for k, frame in enumerate(project.frames):
        if k in group:
            sigma_deg = float(np.rad2deg(adjusted.sigma[k]))
            frames.append(
                dataclasses.replace(frame, camera_from_world=adjusted.rotations[k] @ turn, sigma_deg=sigma_deg)
            )
        else:
            frames.append(frame.left_out("no control points join it to the other pictures"))
    every = np.concatenate(adjusted.residuals_px)
    return Mosaic(
        tuple(adjusted.cameras),
        tuple(frames),
        tuple(links),
        vignetting_ev=project.vignetting_ev,
        level="hugin",
        self_calibrated=any(a is not b for a, b in zip(adjusted.cameras, project.cameras, strict=True)),
        quality={
            "matches": int(every.size),
            "residual_median_px": float(np.median(every)),
            "residual_rms_px": float(np.sqrt(np.mean(every**2))),
        },
    )
