"""Frames of a rotating camera -> their orientations on the sphere: the page of verbs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle
from fullsphere.model.errors import GeometryError, InputError, UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic import self_calibration
from fullsphere.mosaic.adjust import Known
from fullsphere.mosaic.allowed import allowed_pixels
from fullsphere.mosaic.candidates import near_pairs
from fullsphere.mosaic.conformal import is_wide
from fullsphere.mosaic.copies import copies
from fullsphere.mosaic.diagnosis import diagnose, of_wrong_lens
from fullsphere.mosaic.features import Features, find_features
from fullsphere.mosaic.links import Evidence, Pair, Progress, gather_evidence, matched
from fullsphere.mosaic.options import DEFAULT, Options, Order
from fullsphere.mosaic.outcome import mosaic_of
from fullsphere.mosaic.parallax import Parallax, parallaxes
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.rim import common_circle
from fullsphere.mosaic.self_calibration import self_calibrate, starting_cameras, tolerance_px
from fullsphere.mosaic.solution import Solution, refined, solve_links
from fullsphere.mosaic.viewpoints import Viewpoints, pairs_to_compare, viewpoints
from fullsphere.mosaic.wrong_lens import wrong_lens

_NEIGHBOURS = 6  # of each frame that are matched in the end, by where they look
_KEYPOINTS = 24_000  # of all frames together: few frames may have their fill of them
_MOST, _LEAST = 6000, 2500  # of one frame
_FEW = 60  # frames: of more a lost one is not worth looking at all of them again


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
    The mosaic, levelled; frames that could not be placed are marked with the reason.  Where frames were taken from
    several places, it is that of the place with most frames.

    Raises
    ------
    GeometryError
        If no two frames can be registered.
    UsageError
        If there are fewer cameras than the frames name.
    """
    usable = _demand_two(frames)
    given = (cameras,) if isinstance(cameras, Camera) else None if cameras is None else tuple(cameras)
    of_camera = _by_camera(frames, given)
    circles = [None if given else common_circle(own, executor) for own in of_camera]
    frames, evidence = _observed(frames, usable, given, circles, options.order, executor, progress)
    frames, evidence = _without_copies(frames, evidence)
    rig = Rig.of(frames)

    def settle(evidence: Evidence, cameras: Sequence[Camera]) -> Solution:
        if given is not None:
            return _under(given, covariances, evidence, rig, options.refine, executor)
        return self_calibration.settle(
            evidence, cameras, [one[0] for one in _starts(of_camera, circles)], rig, options.lens, executor
        )

    def solve(evidence: Evidence) -> Solution:
        if given is not None:
            return settle(evidence, given)
        starts = list(zip(*_starts(of_camera, circles), strict=True))
        return self_calibrate(evidence, starts, rig, options.lens, executor)

    try:
        solution = solve(evidence)
    except GeometryError as error:
        raise _because_of_the_lens(error, evidence, given, rig, executor) from error
    if given is None:
        evidence, solution = _looked_again(frames, evidence, solution, settle, options.order, executor, progress)
    pairs = near_pairs({int(k): solution.adjustment.rotations[k] for k in solution.group}, _NEIGHBOURS)
    if not evidence.matches.keys() >= set(pairs):  # frames that follow one another late see the same early ones again
        evidence = matched(evidence, pairs, executor, progress)
        solution = settle(evidence, solution.adjustment.cameras)
    wrong = None if given is None or options.refine else wrong_lens(evidence, given, rig, executor, solution)
    parallax = _parallax(evidence, solution, executor)
    places = None if wrong else viewpoints(parallax)  # a wrong lens looks like parallax
    if places is not None:  # parallax between them has bent whatever was adjusted
        frames, evidence = _from_one_place(frames, evidence, places)
        solution = solve(evidence)
        parallax = _parallax(evidence, solution, executor)
    mosaic = mosaic_of(frames, rig, evidence, solution, parallax, given is None, options.levelling, executor)
    sentences = diagnose(mosaic, evidence, parallax, wrong, places, executor)
    return dataclasses.replace(mosaic, diagnosis=sentences)


def _demand_two(frames: Sequence[Frame]) -> list[int]:
    usable = [k for k, frame in enumerate(frames) if not frame.reason]
    if len(usable) < 2:
        raise GeometryError(f"a mosaic needs two frames or more that can be used, not {len(usable)}")
    return usable


def _by_camera(frames: Sequence[Frame], given: Sequence[Camera] | None) -> list[list[Frame]]:
    """The usable frames that each camera took."""
    count = max(frame.camera for frame in frames) + 1
    if given is not None and len(given) < count:
        raise UsageError(f"the frames were taken by {count} cameras, and {len(given)} are given")
    return [[frame for frame in frames if frame.camera == k and not frame.reason] for k in range(count)]


def _observed(
    frames: Sequence[Frame],
    usable: Sequence[int],
    given: Sequence[Camera] | None,
    circles: Sequence[ImageCircle | None],
    order: Order,
    executor: Executor | None,
    progress: Progress,
) -> tuple[list[Frame], Evidence]:
    """What the frames have in common; those whose files cannot be read any more are left out."""
    most = min(_MOST, max(_LEAST, _KEYPOINTS // len(usable)))

    def features_of(k: int) -> Features | str:
        frame = frames[k]
        try:
            picture = frame.load()
            camera = given[frame.camera] if given is not None else None
            circle = None if camera else circles[frame.camera]
            return find_features(picture, allowed_pixels(frame, picture, camera, circle), most, camera)
        except InputError as error:
            return str(error)

    seen = ordered_map(executor, features_of, usable, ahead=4)
    found = dict(zip(usable, progress(seen, title="finding features", total=len(usable)), strict=True))
    left = [frame.left_out(found[k]) if isinstance(found.get(k), str) else frame for k, frame in enumerate(frames)]
    features = {k: one for k, one in found.items() if isinstance(one, Features)}
    _demand_two(left)
    priors = {k: prior for k in features if (prior := frames[k].prior) is not None}
    evidence = gather_evidence(features, executor, progress, order, priors)
    return left, dataclasses.replace(evidence, camera_of={k: frames[k].camera for k in features})


def _looked_again(
    frames: Sequence[Frame],
    evidence: Evidence,
    solution: Solution,
    settle: Callable[[Evidence, Sequence[Camera]], Solution],
    order: Order,
    executor: Executor | None,
    progress: Progress,
) -> tuple[Evidence, Solution]:
    """The same with more frames, if some were lost that the lens that was found brings back.

    Far from the axis of a wide lens pictures are bent too much to be matched; seen through the lens they are not.
    """
    cameras = solution.adjustment.cameras
    lost = evidence.features.keys() - {int(k) for k in solution.group}
    if not lost or len(evidence.features) > _FEW or not any(is_wide(camera) for camera in cameras):
        return evidence, solution
    closer = _observed(frames, sorted(evidence.features), cameras, (), order, executor, progress)[1]
    try:
        again = settle(closer, cameras)
    except GeometryError:
        return evidence, solution
    return (closer, again) if len(again.group) > len(solution.group) else (evidence, solution)


def _starts(of_camera: Sequence[Sequence[Frame]], circles: Sequence[ImageCircle | None]) -> list[list[Camera]]:
    """For each camera those to try first."""
    return [starting_cameras(own[0].size, circle) for own, circle in zip(of_camera, circles, strict=True)]


def _without_copies(frames: Sequence[Frame], evidence: Evidence) -> tuple[list[Frame], Evidence]:
    left = list(frames)
    for k, first in copies(frames, evidence).items():
        left[k] = frames[k].left_out(f"is a copy of {frames[first].id}, saved anew")
    _demand_two(left)
    return left, evidence.among([k for k in evidence.features if not left[k].reason])


def _because_of_the_lens(
    error: GeometryError, evidence: Evidence, given: Sequence[Camera] | None, rig: Rig, executor: Executor | None
) -> GeometryError:
    """The error itself, or one that says that the given cameras are the reason where they are."""
    wrong = None if given is None else wrong_lens(evidence, given, rig, executor)
    sentences = of_wrong_lens(wrong)
    return GeometryError(sentences[0]) if sentences else error


def _parallax(evidence: Evidence, solution: Solution, executor: Executor | None) -> Mapping[Pair, Parallax]:
    adjusted = solution.adjustment
    rotations = {int(k): adjusted.rotations[k] for k in solution.group}
    return parallaxes(evidence, adjusted.cameras, pairs_to_compare(evidence), executor, rotations)


def _from_one_place(frames: Sequence[Frame], evidence: Evidence, places: Viewpoints) -> tuple[list[Frame], Evidence]:
    """The frames of the largest group, the others left out."""
    first, *others = places.groups
    left = list(frames)
    for k in (k for group in others for k in group):
        left[k] = frames[k].left_out(
            f"was taken from another place than {frames[first[0]].id}: two viewpoints make no seamless sphere; "
            "stitch each place's frames by themselves"
        )
    return left, evidence.among([k for k in evidence.features if not left[k].reason])


def _under(
    cameras: Sequence[Camera],
    covariances: Sequence[FloatArray | None],
    evidence: Evidence,
    rig: Rig,
    refine: bool,
    executor: Executor | None,
) -> Solution:
    """The solution under given cameras."""
    known = [
        None if covariance is None else Known(camera.parameter_names, camera.values, covariance)
        for camera, covariance in zip(cameras, covariances, strict=False)
    ]
    solution = solve_links(evidence.links(cameras, tolerance_px(cameras), executor), rig, cameras, known=known)
    return refined(solution, rig, known) if refine else solution
