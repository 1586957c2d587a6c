"""Frames of a rotating camera -> their orientations on the sphere: the page of verbs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle
from fullsphere.model.errors import GeometryError, UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.adjust import Known
from fullsphere.mosaic.features import Features, find_features
from fullsphere.mosaic.level import level_turn
from fullsphere.mosaic.links import Progress, gather_evidence
from fullsphere.mosaic.match_errors import held_out_px
from fullsphere.mosaic.matching import MIN_INLIERS
from fullsphere.mosaic.options import DEFAULT, Options
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.rim import common_circle
from fullsphere.mosaic.self_calibration import self_calibrate, starting_cameras, tolerance_px
from fullsphere.mosaic.solution import Solution, refined, solve_links

HELD_OUT_GATE = 12 / 1920
"""Share of the picture's width beyond which two rays that no fit saw are no match at all."""

_RIM = 0.985  # of the image circle's radius: beyond it the rim itself would give keypoints


def no_progress(items: Iterable[Any], title: str = "", total: int | None = None) -> Iterable[Any]:
    """The items themselves: the default, which shows nothing."""
    return items


def register(
    frames: Sequence[Frame],
    cameras: Camera | Sequence[Camera] | None = None,
    executor: Executor | None = None,
    progress: Progress = no_progress,
    options: Options = DEFAULT,
    covariances: Sequence[FloatArray | None] = (),
) -> Mosaic:
    """Find how the camera was turned for each frame.

    Parameters
    ----------
    frames
        Pictures taken from one place, of one size for each camera; frames already left out stay so.
    cameras
        The calibrated camera, or those of a rig in the order of `Frame.camera`; without them cameras are estimated
        from the frames themselves.
    executor
        Where frames and pairs are worked on side by side.
    progress
        Wraps the loops over frames and pairs.
    options
        What else is asked for.
    covariances
        Of each given camera's values (P, P), from its calibration; None where it is not known.

    Returns
    -------
    The mosaic, levelled; frames that could not be placed are marked with the reason.

    Raises
    ------
    GeometryError
        If no two frames can be registered.
    UsageError
        If there are fewer cameras than the frames name.
    """
    usable = [k for k, frame in enumerate(frames) if not frame.reason]
    if len(usable) < 2:
        raise GeometryError(f"a mosaic needs two frames or more that can be used, not {len(usable)}")
    given = (cameras,) if isinstance(cameras, Camera) else tuple(cameras) if cameras is not None else None
    rig = Rig.of(frames)
    of_camera = [[frames[k] for k in usable if frames[k].camera == c] for c in range(int(rig.camera_of.max()) + 1)]
    if given is not None and len(given) < len(of_camera):
        raise UsageError(f"the frames were taken by {len(of_camera)} cameras, and {len(given)} are given")
    circles = None if given is not None else [common_circle(own) for own in of_camera]
    most = 5000 if len(usable) <= 16 else 2500

    def features_of(k: int) -> Features:
        c = frames[k].camera
        camera, circle = (given[c], None) if given is not None else (None, circles[c] if circles else None)
        return find_features(*_with_mask(frames[k], camera, circle), most)

    seen = ordered_map(executor, features_of, usable, ahead=4)
    features = dict(zip(usable, progress(seen, title="finding features", total=len(usable)), strict=True))
    evidence = gather_evidence(features, executor, progress)
    evidence = dataclasses.replace(evidence, camera_of={k: frames[k].camera for k in usable})
    if given is None:
        sizes = [own[0].size for own in of_camera]
        each = [starting_cameras(size, circle) for size, circle in zip(sizes, circles or [], strict=True)]
        solution = self_calibrate(evidence, list(zip(*each, strict=True)), rig, options.lens, executor)
    else:
        known = [
            Known(camera.parameter_names, camera.values, covariance) if covariance is not None else None
            for camera, covariance in zip(given, covariances, strict=False)
        ]
        links = evidence.links(given, tolerance_px(given), executor)
        solution = solve_links(links, rig, given, known=known)
        if options.refine:
            solution = refined(solution, rig, known)
    return _mosaic(frames, rig, features, solution, self_calibrated=given is None)


def _with_mask(
    frame: Frame, camera: Camera | None, circle: ImageCircle | None
) -> tuple[Picture, NDArray[np.uint8] | None]:
    """The picture, and where keypoints may lie: inside the image circle, its mask, and an alpha that is not zero."""
    picture = frame.load()
    height, width = picture.shape[:2]
    allowed = np.full((height, width), 255, np.uint8)
    if camera is not None:
        circle, aspect = ImageCircle(camera.centre, camera.image_radius), camera.aspect
    else:
        aspect = 1.0
    if circle is not None:
        inner = circle._replace(radius=_RIM * circle.radius)
        allowed[~inner.covers((width, height), aspect)] = 0
    if picture.shape[2] == 4:
        allowed[picture[..., 3] == 0] = 0
    if frame.mask is not None:
        allowed[frame.mask() == 0] = 0
    return picture, allowed


def _mosaic(
    frames: Sequence[Frame], rig: Rig, features: dict[int, Features], solution: Solution, self_calibrated: bool
) -> Mosaic:
    links, group, adjusted = solution
    turn, level = level_turn([adjusted.rotations[k] for k in group])
    placed: list[Frame] = []
    for k, frame in enumerate(frames):
        if k in group:
            rotation, sigma_deg = adjusted.rotations[k] @ turn.T, float(np.rad2deg(adjusted.sigma[k]))
            placed.append(dataclasses.replace(frame, camera_from_world=rotation, sigma_deg=sigma_deg))
        else:
            placed.append(frame if frame.reason else frame.left_out(_why_left_out(features[k])))
    every = np.concatenate(adjusted.residuals_px)
    held = held_out_px(links, adjusted.rotations, adjusted.cameras, rig)
    gate = HELD_OUT_GATE * max(camera.size[0] for camera in adjusted.cameras)
    inside = held[held < gate]
    quality: dict[str, float] = {
        "matches": int(every.size),
        "residual_median_px": float(np.median(every)),
        "residual_rms_px": _rms(every[every < tolerance_px(adjusted.cameras)]),
        "held_out_matches": int(inside.size),
        "held_out_share": inside.size / held.size if held.size else 0.0,
        "held_out_median_px": float(np.median(inside)) if inside.size else 0.0,
    }
    on_rig = bool(rig.mount_tree(group))
    return Mosaic(
        adjusted.cameras,
        tuple(placed),
        tuple(links),
        level=level,
        self_calibrated=self_calibrated,
        quality=quality,
        camera_from_rig=tuple(adjusted.mounts) if on_rig else (),
        camera_covariances=adjusted.covariances if any(c.any() for c in adjusted.covariances) else (),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _why_left_out(features: Features) -> str:
    if len(features) < 2 * MIN_INLIERS:
        return f"shows too little texture: {len(features)} features found"
    return "does not overlap the other frames, or shows another place: no rotation agrees with its matches"
