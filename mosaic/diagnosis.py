"""What is wrong with a set of frames, in plain words: what was found, in which frames, and what to try."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.found_camera import curve_sigma_px
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.moving_things import moving_things
from fullsphere.mosaic.parallax import Parallax, parallaxes
from fullsphere.mosaic.project import Frame, Link, Mosaic
from fullsphere.mosaic.viewpoints import Viewpoints, pairs_to_compare, viewpoints
from fullsphere.mosaic.wrong_lens import WrongLens

WEAK_CURVE = 0.002
"""Standard deviation of r(theta), as a share of the image circle's radius, from which a lens is weakly determined."""

_COVERED = 0.4  # share of the field of view that matches must cover for the rest of the curve to follow from them
_WEAK_PX = 1.0  # standard deviation of a frame's orientation at which a seam shows it
_FEW = 40  # matches with all other frames together: one thing that moved can spoil them
_FEW_FRAMES = 3  # that are named one by one
_SEEN = 0.3  # share of the pairs that must show parallax for it to be said of the set
_SEEN_PX, _SEEN_DEG = 0.25, 0.03  # parallax below this is not worth a word
_WALKED = 0.5  # share of the pairs with another viewpoint from which the camera went with every frame


def diagnose(
    mosaic: Mosaic,
    evidence: Evidence,
    parallax: Mapping[Pair, Parallax] | None = None,
    wrong: WrongLens | None = None,
    places: Viewpoints | None = None,
    executor: Executor | None = None,
) -> tuple[str, ...]:
    """Sentences about a set of frames, the most important first; none where all is well.

    Parameters
    ----------
    mosaic
        As it was solved.
    evidence
        Keypoints and matches of its frames, by index.
    parallax
        Of pairs of frames, where it is known already.
    wrong
        What `wrong_lens` found of cameras that were given.
    places
        The groups that frames fell into, where those of another place were left out already.
    executor
        Where pairs are worked on side by side.
    """
    if parallax is None:
        rotations = {k: f.camera_from_world for k, f in enumerate(mosaic.frames) if f.camera_from_world is not None}
        parallax = parallaxes(evidence, mosaic.cameras, pairs_to_compare(evidence), executor, rotations)
    placed = {k for k, frame in enumerate(mosaic.frames) if frame.registered}
    parallax = {pair: one for pair, one in parallax.items() if placed.issuperset(pair)}
    here = viewpoints(parallax)
    if wrong is not None:  # whatever else is seen under such a lens may be its doing
        return (*of_wrong_lens(wrong), *_of_places(mosaic.frames, places))
    sentences = [
        *_of_places(mosaic.frames, places or here),
        *(weak_lens := _of_weak_lens(mosaic)),
        *_of_weak_frames(mosaic, lens_known=not weak_lens),
        *_of_moving_things(mosaic, evidence, parallax),
        *([] if here is not None else _of_parallax(mosaic.frames, parallax)),
    ]
    return tuple(sentences)


def named(frames: Sequence[Frame], which: Sequence[int]) -> str:
    """The names of frames: "a, b and c", or the first and the last and how many there are."""
    names = [frames[k].id for k in which]
    if len(names) > 2 * _FEW_FRAMES:
        return f"{', '.join(names[:_FEW_FRAMES])} ... {names[-1]} ({len(names)} frames)"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _of_places(frames: Sequence[Frame], places: Viewpoints | None) -> list[str]:
    if places is None:
        return []
    number = {2: "two", 3: "three"}.get(len(places.groups), str(len(places.groups)))
    groups = [f"{named(frames, group)} {'was' if len(group) == 1 else 'were'} taken from" for group in places.groups]
    told = f"{groups[0]} one place, " + ", ".join(f"{group} another" for group in groups[1:])
    return [
        f"{number} viewpoints: {told}; things are off by {_deg(places.between)} degrees between the groups, by "
        f"{_deg(places.within)} within them (medians): stitch each group by itself"
    ]


def of_wrong_lens(wrong: WrongLens | None) -> list[str]:
    """The sentence about cameras that were given and do not fit, where they do not."""
    if wrong is None:
        return []
    return [
        f"the camera that was given does not fit these frames: the median residual is {wrong.given_px:.1f} px, "
        f"{wrong.worst_px:.1f} px at {wrong.worst_deg:.0f} degrees from the axis, and {wrong.fitted_px:.1f} px with a "
        "lens fitted to the frames: register without --camera, or calibrate anew"
    ]


def _of_weak_lens(mosaic: Mosaic) -> list[str]:
    """Where the frames tell little of the lens that was estimated from them."""
    if not mosaic.self_calibrated:
        return []
    sentences = []
    for k, camera in enumerate(mosaic.cameras):
        covariance = mosaic.camera_covariances[k] if mosaic.camera_covariances else None
        sigma_px, at = _widest(camera, covariance)
        seen = _angles_seen(mosaic, k)
        if not seen.size:
            continue
        low, high = np.quantile(seen, [0.02, 0.98])
        if sigma_px < WEAK_CURVE * camera.image_radius and high - low > _COVERED * camera.half_fov:
            continue
        of = f" of camera {k + 1}" if len(mosaic.cameras) > 1 else ""
        sentences.append(
            f"the lens{of} is weakly determined by these frames: its curve is known to {sigma_px:.1f} px only, "
            f"{math.degrees(at):.0f} degrees from the axis, and they have matches from {math.degrees(low):.0f} to "
            f"{math.degrees(high):.0f} degrees: take more frames that overlap by half, or calibrate the lens and give "
            "it with --camera"
        )
    return sentences


def _widest(camera: Camera, covariance: FloatArray | None) -> tuple[float, float]:
    """The largest standard deviation of r(theta) in pixels, and the angle where it is."""
    theta = np.linspace(0, camera.half_fov, 60)[1:]
    sigma = np.zeros(len(theta)) if covariance is None else curve_sigma_px(camera, covariance, theta)
    worst = int(sigma.argmax())
    return float(sigma[worst]), float(theta[worst])


def _angles_seen(mosaic: Mosaic, camera: int) -> FloatArray:
    """Angles (m,) from the axis of the keypoints that matches have in a camera's frames."""
    ends = [end for link in mosaic.links for end in ((link.i, link.pixels_i), (link.j, link.pixels_j))]
    pixels = [of_frame for frame, of_frame in ends if mosaic.frames[frame].camera == camera]
    z = mosaic.cameras[camera].unproject(np.concatenate([np.empty((0, 2)), *pixels]))[:, 2]
    return np.asarray(np.arccos(np.clip(z[np.isfinite(z)], -1, 1)))


def _of_weak_frames(mosaic: Mosaic, lens_known: bool) -> list[str]:
    """Frames that hang on few matches, or, where that is not the lens's fault, are known to no better than a pixel."""
    sentences = []
    for k, frame in enumerate(mosaic.frames):
        if not frame.registered:
            continue
        own = [link for link in mosaic.links if k in (link.i, link.j)]
        if not own:
            continue
        matches = sum(len(link.pixels_i) + len(link.held_i) for link in own)
        camera = mosaic.cameras[frame.camera]
        sigma_deg = frame.sigma_deg or 0.0
        sigma_px = math.radians(sigma_deg) * camera.image_radius / camera.half_fov
        if matches >= _FEW and (sigma_px < _WEAK_PX or not lens_known):
            continue
        others = named(mosaic.frames, [_other(link, k) for link in own])
        known = f"its orientation is known to {_deg(math.radians(sigma_deg))} degrees only ({sigma_px:.1f} px)"
        sentences.append((matches, f"{frame.id} is held by {matches} matches with {others}, {known}"))
    return _together(sentences, "that have little in common with the others", "let frames overlap by a third")


def _of_moving_things(mosaic: Mosaic, evidence: Evidence, parallax: Mapping[Pair, Parallax]) -> list[str]:
    of_one_place = {pair: one for pair, one in parallax.items() if one.verdict != "parallax"}
    rotations = {k: f.camera_from_world for k, f in enumerate(mosaic.frames) if f.camera_from_world is not None}
    sentences = []
    for thing in moving_things(evidence, mosaic.cameras, rotations, of_one_place):
        x, y, z = thing.direction
        yaw, pitch = math.degrees(math.atan2(x, z)), math.degrees(math.asin(max(-1.0, min(1.0, -float(y)))))
        text = (
            f"something at yaw {yaw:.0f}, pitch {pitch:.0f} degrees moved by {_deg(thing.moved)} degrees between "
            f"{named(mosaic.frames, thing.frames)} ({thing.matches} matches)"
        )
        sentences.append((-thing.matches, text))
    return _together(sentences, "that moved", "mask them out in all frames but one")


def _of_parallax(frames: Sequence[Frame], parallax: Mapping[Pair, Parallax]) -> list[str]:
    """Near things seen from slightly different places, or a camera that was carried along."""
    seen = {
        pair: one
        for pair, one in parallax.items()
        if one.gain > 0 and one.size_px > max(_SEEN_PX, one.sigma_px) and math.degrees(one.size) > _SEEN_DEG
    }
    if not seen or len(seen) < _SEEN * len(parallax):
        return []
    strongest = max(seen, key=lambda pair: seen[pair].size_px)
    most = seen[strongest]
    median_px = float(np.median([one.size_px for one in seen.values()]))
    median = float(np.median([one.size for one in seen.values()]))
    size = (
        f"in the median by {median_px:.1f} px ({_deg(median)} degrees), most between {named(frames, strongest)} "
        f"({most.size_px:.1f} px, {_deg(most.size)} degrees)"
    )
    moved = sum(one.verdict == "parallax" for one in parallax.values())
    if moved > _WALKED * len(parallax):
        return [
            f"the camera was carried from place to place: {moved} of {len(parallax)} pairs of frames show parallax, "
            f"things are off {size}: take all frames from one place"
        ]
    return [
        f"near things have parallax: they are off {size}: turn the camera about the entrance pupil of its lens, and "
        "keep near things out of the overlaps"
    ]


def _together(sentences: Sequence[tuple[int, str]], what: str, remedy: str) -> list[str]:
    """The first few sentences, with what to try in the last; the rest is only counted."""
    ordered = [text for _, text in sorted(sentences)]
    told = ordered[:_FEW_FRAMES]
    rest = len(ordered) - len(told)
    if rest:
        told.append(f"{rest} more {what}")
    return [f"{text}: {remedy}" for text in told]


def _other(link: Link, k: int) -> int:
    return link.j if link.i == k else link.i


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.2g}"
