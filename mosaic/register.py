"""Frames of a rotating camera -> their orientations on the sphere: the page of verbs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle, brightest, find_circle
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.features import Features, find_features
from fullsphere.mosaic.level import level_turn
from fullsphere.mosaic.links import Progress, gather_evidence
from fullsphere.mosaic.matching import MIN_INLIERS
from fullsphere.mosaic.project import Frame, Mosaic, Picture
from fullsphere.mosaic.self_calibration import TOLERANCE_PX, self_calibrate, starting_cameras
from fullsphere.mosaic.solution import Solution, solve_links

_RIM = 0.985  # of the image circle's radius: beyond it the rim itself would give keypoints


def no_progress(items: Iterable[Any], title: str = "", total: int | None = None) -> Iterable[Any]:
    """The items themselves: the default, which shows nothing."""
    return items


def register(
    frames: Sequence[Frame],
    camera: Camera | None = None,
    executor: Executor | None = None,
    progress: Progress = no_progress,
) -> Mosaic:
    """Find how the camera was turned for each frame.

    Parameters
    ----------
    frames
        Pictures of one size taken by one camera from one place; frames already left out stay so.
    camera
        The calibrated camera; without it the camera is estimated from the frames themselves.
    executor
        Where frames and pairs are worked on side by side.
    progress
        Wraps the loops over frames and pairs.

    Returns
    -------
    The mosaic, levelled; frames that could not be placed are marked with the reason.

    Raises
    ------
    GeometryError
        If no two frames can be registered.
    """
    usable = [k for k, frame in enumerate(frames) if not frame.reason]
    if len(usable) < 2:
        raise GeometryError(f"a mosaic needs two frames or more that can be used, not {len(usable)}")
    circle = None if camera is not None else common_circle([frames[k] for k in usable])
    most = 5000 if len(usable) <= 16 else 2500
    seen = ordered_map(
        executor, lambda k: find_features(*_with_mask(frames[k].load(), camera, circle), most), usable, ahead=4
    )
    features = dict(zip(usable, progress(seen, title="finding features", total=len(usable)), strict=True))
    evidence = gather_evidence(features, executor, progress)
    if camera is None:
        starts = starting_cameras(frames[usable[0]].size, circle)
        solution = self_calibrate(evidence, starts, len(frames), executor)
    else:
        solution = solve_links(evidence.links(camera, TOLERANCE_PX, executor), len(frames), camera)
    return _mosaic(frames, features, solution, self_calibrated=camera is None)


def common_circle(frames: Sequence[Frame]) -> ImageCircle | None:
    """The image circle of frames taken with one lens, from the brightest that any of them shows at each pixel."""
    highest: NDArray[np.uint8] | None = None
    for frame in frames:
        picture = _eight_bit(frame.load())
        now = brightest([picture])
        highest = now if highest is None else np.maximum(highest, now)
    return None if highest is None else find_circle(highest)


def _eight_bit(picture: Picture) -> NDArray[np.uint8]:
    colour = picture[..., :3]
    if picture.dtype == np.uint8:
        return colour
    if picture.dtype == np.uint16:
        return (colour >> 8).astype(np.uint8)
    white = max(float(np.percentile(colour, 99)), 1e-9)
    return (255 * np.sqrt(np.clip(colour / white, 0, 1))).astype(np.uint8)


def _with_mask(
    picture: Picture, camera: Camera | None, circle: ImageCircle | None
) -> tuple[Picture, NDArray[np.uint8] | None]:
    """The picture, and where keypoints may lie: inside the image circle, and where an alpha channel is not empty."""
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
    return picture, allowed


def _mosaic(
    frames: Sequence[Frame], features: dict[int, Features], solution: Solution, self_calibrated: bool
) -> Mosaic:
    links, group, (rotations, camera, sigma, residuals, _) = solution
    turn, level = level_turn([rotations[k] for k in group])
    placed: list[Frame] = []
    for k, frame in enumerate(frames):
        if k in group:
            placed.append(
                dataclasses.replace(
                    frame, camera_from_world=rotations[k] @ turn.T, sigma_deg=float(np.rad2deg(sigma[k]))
                )
            )
        else:
            placed.append(frame if frame.reason else frame.left_out(_why_left_out(features[k])))
    every = np.concatenate(residuals)
    quality: dict[str, float] = {
        "matches": int(every.size),
        "residual_median_px": float(np.median(every)),
        "residual_rms_px": _rms(every[every < TOLERANCE_PX]),
    }
    return Mosaic((camera,), tuple(placed), tuple(links), level=level, self_calibrated=self_calibrated, quality=quality)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _why_left_out(features: Features) -> str:
    if len(features) < 2 * MIN_INLIERS:
        return f"shows too little texture: {len(features)} features found"
    return "does not overlap the other frames, or shows another place: no rotation agrees with its matches"
