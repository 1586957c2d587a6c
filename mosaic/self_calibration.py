"""A camera from the rotating frames themselves, when no calibration is given.

The scale of the lens is unknown to a factor of two at first: several starts are tried on all pairs of frames, the one
that most matches agree with is kept, and the bundle adjustment frees the parameters a few at a time, from one length
to the four parameters of Bakstein & Pajdla, the centre and the aspect.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from fullsphere.model.calibration.lens_fit import fitted_lenses
from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import LENSES, BaksteinPajdla, Equidistant, Equisolid, KannalaBrandt, Lens, Perspective
from fullsphere.mosaic.adjust import Adjustment, Known, with_same_circle
from fullsphere.mosaic.lens_spread import gain, with_lens_spread
from fullsphere.mosaic.links import Evidence
from fullsphere.mosaic.options import AUTO
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.solution import Solution, readjusted, solve_links, thinned

CIRCLE_HALF_FOVS_DEG = (75, 82, 88, 94, 100, 108, 118)
FULL_FRAME_STARTS: tuple[tuple[type[Lens], float], ...] = (
    *((Perspective, angle) for angle in (8, 12, 17, 23, 30, 38, 47, 56)),
    *((Equisolid, angle) for angle in (62, 70, 80, 90, 100)),
)
"""Lens and half of the diagonal field of view in degrees, for frames without a visible circle."""

MATCH_TOLERANCE = 1 / 480
"""How well a match must agree with a rotation once the camera is known, as a share of the picture's longer side."""

_START = 0.02  # of the picture's radius: how well matches must agree while the lens is only guessed
_ROUGH_PX = 4.0  # robust scales beyond it are for a camera that is still a guess
_SAMPLE = 150  # matches of a link that are enough while the camera is being found
_NOT_SQUARE = 0.005  # standard deviation of the aspect: pixels are square, but some pictures were resized unevenly
_OFF_CENTRE = 0.02  # of the circle's radius: standard deviation of the axis from the circle's centre
_CENTRE = ("centre_u_px", "centre_v_px")
_CLEARLY = 10.0  # variances of a keypoint that a lens must fit better: a fifth value alone gains one


def starting_cameras(size: tuple[int, int], circle: ImageCircle | None) -> list[Camera]:
    """Cameras to try first: one for each plausible field of view."""
    if circle is not None:
        return [
            Camera(Equidistant(circle.radius / math.radians(half)), size, circle.centre, half_fov=math.radians(half))
            for half in CIRCLE_HALF_FOVS_DEG
        ]
    width, height = size
    diagonal = math.hypot(width, height) / 2
    return [
        Camera(
            kind(diagonal / float(kind(1.0).radius(math.radians(half)))),  # type: ignore[call-arg]
            size,
            ((width - 1) / 2, (height - 1) / 2),
            half_fov=math.radians(half),
        )
        for kind, half in FULL_FRAME_STARTS
    ]


def as_bakstein_pajdla(camera: Camera) -> Camera:
    """The camera with a Bakstein-Pajdla lens of the same curve, as nearly as can be.

    For each b and d of a grid a and c follow linearly; the nearest growing curve is taken.  The grid stays in the range
    in which both terms have a say of their own, so that the adjustment has four directions to move in.
    """
    theta = np.linspace(0, camera.half_fov, 60)
    target = camera.lens.radius(theta)
    best: tuple[float, BaksteinPajdla | None] = (math.inf, None)
    for b in (1.0, 1.05, 1.2, 1.5, 2.0, 2.5, 3.2):
        for d in (0.7, 1.0, 1.15, 1.4, 2.0):
            if camera.half_fov > 0.97 * b * math.pi / 2 or camera.half_fov > 0.99 * d * math.pi / 2 + 0.6:
                continue
            shape = np.column_stack([np.tan(theta / b), np.sin(theta / d)])
            (a, c), *_ = np.linalg.lstsq(shape, target, rcond=None)
            error = float(np.sqrt(np.mean((shape @ [a, c] - target) ** 2)))
            # An a of zero would leave b, and a c of zero d, without any effect: the adjustment could not move them.
            alive = min(abs(a * shape[-1, 0]), abs(c * shape[-1, 1])) > 0.1 * target[-1]
            if not alive or error >= best[0] or not shape[1] @ [a, c] > 0:
                continue
            lens = BaksteinPajdla(a, b, c, d)
            if lens.theta_max > camera.half_fov:
                best = (error, lens)
    if best[1] is None:
        raise ValueError(f"no Bakstein-Pajdla lens is near {camera}")
    return Camera(best[1], camera.size, camera.centre, aspect=camera.aspect, half_fov=camera.half_fov)


def self_calibrate(
    evidence: Evidence,
    starts: Sequence[tuple[Camera, ...]],
    rig: Rig,
    lens: str = AUTO,
    executor: Executor | None = None,
) -> Solution:
    """From one length to the whole camera, the matches chosen anew each time the camera is known better.

    On the way a sample of the pairs and of their matches is enough; the last adjustment takes them all.

    Parameters
    ----------
    evidence
        What the frames have in common.
    starts
        Cameras to try first, of `starting_cameras`: each time one for every camera of the rig.
    rig
        Which camera took which frame.
    lens
        Name of the lens that the last adjustment fits; `AUTO` for the one of two that fits the matches.
    executor
        Where pairs are worked on side by side.

    Raises
    ------
    GeometryError
        If no two frames can be registered under any of the starts.
    """
    cameras = _found(evidence, starts, rig, executor)
    if lens not in (AUTO, BaksteinPajdla.projection):
        cameras = of_one_lens(tuple(with_lens(camera, lens) for camera in cameras))
    return settle(evidence, cameras, starts[0], rig, lens, executor)


def settle(
    evidence: Evidence,
    cameras: Sequence[Camera],
    starts: Sequence[Camera],
    rig: Rig,
    lens: str = AUTO,
    executor: Executor | None = None,
) -> Solution:
    """The last adjustment of cameras that are nearly found, with all matches; parameters as of `self_calibrate`.

    `starts` has one of the starting cameras for every camera of the rig: they tell the circles.  A second lens formula
    is fitted beside that of the cameras: to be taken in its place where it fits clearly better and no lens was asked
    for, and to tell how far the first may be trusted.
    """
    known = _usual(starts)
    links = evidence.links(cameras, tolerance_px(cameras), executor)
    tied = (*_lens_names(cameras), "aspect")
    solution = solve_links(links, rig, cameras, (*tied, *_CENTRE), known=known, tied=tied)
    other = with_other_lens(solution, rig, known)
    if other is None:
        return solution
    if lens == AUTO and gain(solution, other) > _CLEARLY:
        return other
    return with_lens_spread(solution, other)


def with_other_lens(solution: Solution, rig: Rig, known: Sequence[Known]) -> Solution | None:
    """The same with another lens formula; None where that cannot image what the cameras do."""
    kinds = (KannalaBrandt.projection, BaksteinPajdla.projection)
    found = solution.adjustment.cameras
    kind = next(kind for kind in kinds if kind != found[0].lens.projection)
    try:
        cameras = of_one_lens(tuple(with_lens(camera, kind) for camera in found))
        tied = (*_lens_names(cameras), "aspect")
        return readjusted(solution, rig, cameras, (*tied, *_CENTRE), known, tied)
    except GeometryError:
        return None


def _found(
    evidence: Evidence, starts: Sequence[tuple[Camera, ...]], rig: Rig, executor: Executor | None
) -> tuple[Camera, ...]:
    """Cameras that are right to a pixel or so."""
    few, more = evidence.strongest_pairs(2), evidence.strongest_pairs(5)
    usual = _usual(starts[0])

    def improve(cameras: Sequence[Camera], links: Sequence[Link], free: Sequence[str], scale: float) -> Adjustment:
        sampled = [thinned(link, _SAMPLE) for link in links]
        tied = [name for name in free if name not in _CENTRE]
        tolerance = 1e-3 if scale > _ROUGH_PX else 1e-4  # matches are chosen anew soon
        return solve_links(
            sampled, rig, cameras, free, (scale,), tolerance=tolerance, known=usual, tied=tied
        ).adjustment

    cameras = _best_start(starts, lambda start: evidence.links(start, _START * start[0].image_radius, executor, few))
    links = evidence.links(cameras, _START * cameras[0].image_radius, executor, more)
    cameras = of_one_lens(tuple(map(as_bakstein_pajdla, improve(cameras, links, ("f_px",), 10.0).cameras)))
    shape = _lens_names(cameras)
    for tolerance, free, scales in (
        (0.015, shape, (5.0,)),
        (0.01, (*shape, *_CENTRE), (5.0, 2.0)),
        (0.005, (*shape, *_CENTRE), (4.0, 1.0)),
    ):
        links = evidence.links(cameras, max(tolerance * cameras[0].image_radius, tolerance_px(cameras)), executor, more)
        for scale in scales:
            cameras = improve(cameras, links, free, scale).cameras
    return cameras


def _usual(starts: Sequence[Camera]) -> list[Known]:
    """What is usual of cameras: the axis meets the picture near the middle of its circle, and pixels are square."""
    return [
        Known(
            (*_CENTRE, "aspect"),
            np.array([*start.centre, 1.0]),
            np.diag([(_OFF_CENTRE * start.image_radius) ** 2] * 2 + [_NOT_SQUARE**2]),
        )
        for start in starts
    ]


def tolerance_px(cameras: Sequence[Camera]) -> float:
    """How many pixels a match may be off: near things shift by an angle, whatever the resolution."""
    return max(MATCH_TOLERANCE * max(side for camera in cameras for side in camera.size), 2.0)


def of_one_lens(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """The cameras with the lens and aspect of the first, each imaging the circle it did."""
    first = cameras[0]
    values = [np.array([*first.lens.values, *camera.centre, first.aspect]) for camera in cameras]
    others = [
        with_same_circle(dataclasses.replace(camera, lens=first.lens, half_fov=first.half_fov), v)
        for camera, v in zip(cameras, values, strict=True)
    ]
    return tuple(camera if camera is not None else first for camera in others)


def with_lens(camera: Camera, projection: str) -> Camera:
    """The camera with the lens of that name whose curve is nearest to its own.

    Raises
    ------
    GeometryError
        If no such lens images the whole field of view.
    """
    theta = np.linspace(0, camera.half_fov, 100)
    nearest, *_ = fitted_lenses(LENSES[projection], theta, camera.lens.radius(theta))
    return dataclasses.replace(camera, lens=nearest)


def _lens_names(cameras: Sequence[Camera]) -> tuple[str, ...]:
    return tuple(p.key for p in cameras[0].lens.parameters)


def _best_start(
    starts: Sequence[tuple[Camera, ...]], links_of: Callable[[tuple[Camera, ...]], list[Link]]
) -> tuple[Camera, ...]:
    """The cameras with which most matches agree on rotations."""
    return max(starts, key=lambda cameras: sum(len(link.pixels_i) for link in links_of(cameras)))
