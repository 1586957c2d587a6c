"""Frames of a rotating camera -> their orientations on the sphere: the page of verbs."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle, brightest, find_circle
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.adjust import Adjustment, adjust
from fullsphere.mosaic.features import Features, find_features
from fullsphere.mosaic.level import level_turn
from fullsphere.mosaic.matching import MIN_INLIERS, Matches, fit_rotation, match_features
from fullsphere.mosaic.orientation import connected_groups, disagreement_deg, first_orientations
from fullsphere.mosaic.project import Frame, Link, Mosaic, Picture
from fullsphere.mosaic.self_calibration import as_bakstein_pajdla, best_start, image_radius, starting_cameras

TOLERANCE_PX = 4.0  # how well a match must agree with a rotation once the camera is known
_CLEARLY_BETTER = 0.8  # pixels are taken for square unless another aspect leaves less than this share of the cost
_AGREEMENT_DEG = 6.0  # a link further from the averaged orientations is of another thing that looks the same
_SAMPLE = 150  # matches of a link that are enough while the camera is being found
_RIM = 0.985  # of the image circle's radius: beyond it the rim itself would give keypoints

Progress = Callable[..., Iterable[Any]]
"""Wraps an iterable to show how far it is: progress(items, title=..., total=...)."""


def no_progress(items: Iterable[Any], title: str = "", total: int | None = None) -> Iterable[Any]:
    """The items themselves: the default, which shows nothing."""
    return items


class _Solution(NamedTuple):
    links: list[Link]
    group: NDArray[np.intp]
    adjustment: Adjustment


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
    circle = None if camera is not None else _common_circle([frames[k] for k in usable])
    most = 5000 if len(usable) <= 16 else 2500
    seen = ordered_map(
        executor, lambda k: find_features(*_with_mask(frames[k].load(), camera, circle), most), usable, ahead=4
    )
    features = dict(zip(usable, progress(seen, title="finding features", total=len(usable)), strict=True))
    pairs = list(itertools.combinations(usable, 2))
    matched = ordered_map(executor, lambda ij: match_features(features[ij[0]], features[ij[1]]), pairs)
    matches = dict(zip(pairs, progress(matched, title="matching frames", total=len(pairs)), strict=True))

    def find_links(trial: Camera, tolerance_px: float) -> list[Link]:
        return list(_links(features, matches, trial, tolerance_px, executor))

    if camera is None:
        solution = _self_calibrate(frames[usable[0]].size, circle, find_links, len(frames))
    else:
        solution = _solve(find_links(camera, TOLERANCE_PX), len(frames), camera)
    return _mosaic(frames, features, solution, self_calibrated=camera is None)


def _common_circle(frames: Sequence[Frame]) -> ImageCircle | None:
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
        circle, aspect = ImageCircle(camera.centre, image_radius(camera)), camera.aspect
    else:
        aspect = 1.0
    if circle is not None:
        v, u = np.ogrid[:height, :width]
        r = np.hypot(u - circle.centre[0], (v - circle.centre[1]) / aspect)
        allowed[r > _RIM * circle.radius] = 0
    if picture.shape[2] == 4:
        allowed[picture[..., 3] == 0] = 0
    return picture, allowed


def _links(
    features: dict[int, Features],
    matches: dict[tuple[int, int], Matches],
    camera: Camera,
    tolerance_px: float,
    executor: Executor | None,
) -> Iterable[Link]:
    rays = {k: camera.unproject(f.pixels) for k, f in features.items()}
    scale = {k: camera.pixels_per_radian(r) for k, r in rays.items()}

    def link(pair: tuple[int, int]) -> Link | None:
        (i, j), (first, second) = pair, matches[pair]
        seen = np.isfinite(rays[i][first, 0]) & np.isfinite(rays[j][second, 0])
        first, second = first[seen], second[seen]
        tolerance = tolerance_px * np.hypot(1 / scale[i][first], 1 / scale[j][second])
        fit = fit_rotation(rays[i][first], rays[j][second], tolerance, seed=i * 100_003 + j)
        if fit is None:
            return None
        a, b = features[i].pixels[first[fit.inliers]], features[j].pixels[second[fit.inliers]]
        return Link(i, j, a, b, fit.rotation)

    return [found for found in ordered_map(executor, link, list(matches)) if found is not None]


def _solve(
    links: list[Link],
    count: int,
    camera: Camera,
    free: Sequence[str] = (),
    robust_scales_px: Sequence[float] = (16.0, 4.0, 1.0),
    tolerance: float = 1e-7,
) -> _Solution:
    """Largest group, first orientations without the links that contradict them, adjustment.

    The robust scale falls in steps: a loop that does not close yet is pulled shut first, outliers are judged after.
    """
    group = connected_groups(links, count)[0]
    if len(group) < 2:
        raise GeometryError(
            f"no two frames see the same things: no pair has {MIN_INLIERS} matches that agree with a rotation "
            "(do the frames overlap, and were they taken from one place with this lens?)"
        )
    inner = [link for link in links if link.i in group]
    rotations = first_orientations(inner, group, count)
    agreeing = [link for link in inner if disagreement_deg(link, rotations) < _AGREEMENT_DEG]
    if len(agreeing) < len(inner) and agreeing:
        group = connected_groups(agreeing, count)[0]
        agreeing = [link for link in agreeing if link.i in group]
    links = agreeing or inner
    for scale in robust_scales_px:
        last = scale == robust_scales_px[-1]
        adjustment = adjust(links, rotations, group, camera, free, scale, tolerance if last else 1e-3)
        rotations, camera = adjustment.rotations, adjustment.camera
    return _Solution(links, group, adjustment)


def _self_calibrate(
    size: tuple[int, int], circle: ImageCircle | None, find_links: Callable[[Camera, float], list[Link]], count: int
) -> _Solution:
    """From one length to the whole camera, the matches chosen anew each time the camera is known better.

    On the way a sample of the matches is enough; the last adjustment takes them all.
    """

    def improve(camera: Camera, links: list[Link], free: Sequence[str], scales: Sequence[float]) -> Adjustment:
        return _solve([_thinned(link) for link in links], count, camera, free, scales, tolerance=1e-4).adjustment

    camera, links = best_start(starting_cameras(size, circle), find_links)
    camera = as_bakstein_pajdla(improve(camera, links, ("f_px",), (10.0,)).camera)
    lens = tuple(p.key for p in camera.lens.parameters)
    square = (*lens, "centre_u_px", "centre_v_px")
    for tolerance, free, scales in ((0.015, lens, (5.0,)), (0.01, square, (5.0, 2.0)), (0.005, square, (4.0, 1.0))):
        links = find_links(camera, max(tolerance * image_radius(camera), TOLERANCE_PX))
        camera = improve(camera, links, free, scales).camera
    plain, oblong = (improve(camera, links, free, (1.0,)) for free in (square, (*square, "aspect")))
    if oblong.cost < _CLEARLY_BETTER * plain.cost:
        return _solve(find_links(oblong.camera, TOLERANCE_PX), count, oblong.camera, (*square, "aspect"))
    return _solve(find_links(plain.camera, TOLERANCE_PX), count, plain.camera, square)


def _thinned(link: Link) -> Link:
    """The link with at most `_SAMPLE` of its matches, evenly picked."""
    step = max(1, len(link.pixels_i) // _SAMPLE)
    return dataclasses.replace(link, pixels_i=link.pixels_i[::step], pixels_j=link.pixels_j[::step])


def _mosaic(
    frames: Sequence[Frame], features: dict[int, Features], solution: _Solution, self_calibrated: bool
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
    return Mosaic(camera, tuple(placed), tuple(links), level=level, self_calibrated=self_calibrated, quality=quality)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _why_left_out(features: Features) -> str:
    if len(features) < 2 * MIN_INLIERS:
        return f"shows too little texture: {len(features)} features found"
    return "does not overlap the other frames, or shows another place: no rotation agrees with its matches"
