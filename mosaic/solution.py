"""Links -> the largest group of frames and its orientations under one camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.adjust import Adjustment, Known, adjust, spread_px
from fullsphere.mosaic.matching import MIN_INLIERS
from fullsphere.mosaic.orientation import connected_groups, disagreement_deg, first_orientations
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig

_AGREEMENT_DEG = 6.0  # a link further from the averaged orientations is of another thing that looks the same
_SHARP, _LEAST_SCALE_PX = 1.0, 0.05  # times the spread: near and moving things weigh little, good matches nearly all
_MOST_MATCHES = 100_000  # adjusted at once: more do not make the orientations better, only slower


class Solution(NamedTuple):
    """The links kept, the frames they hold together, and their adjustment."""

    links: list[Link]
    group: NDArray[np.intp]
    adjustment: Adjustment


def solve_links(
    links: Sequence[Link],
    rig: Rig,
    cameras: Sequence[Camera],
    free: Sequence[str] = (),
    robust_scales_px: Sequence[float | None] = (16.0, 4.0, 1.0, None),
    tolerance: float = 1e-7,
    known: Sequence[Known | None] = (),
    tied: Sequence[str] = (),
) -> Solution:
    """Largest group, first orientations without the links that contradict them, adjustment.

    Parameters
    ----------
    links
        Between any of the frames.
    rig
        Which camera took which frame, for all frames.
    cameras, free, tolerance, known, tied
        As for `adjust`.
    robust_scales_px
        One adjustment for each: with a scale that falls in steps a loop that does not close yet is pulled shut first,
        and outliers are judged after.  None is the spread that the one before left.

    Raises
    ------
    GeometryError
        If the links hold no two frames together.
    """
    count = len(rig.camera_of)
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
    kept = agreeing or inner
    return Solution(
        kept, group, _in_steps(kept, rotations, group, cameras, free, robust_scales_px, tolerance, rig, known, tied)
    )


def readjusted(
    solution: Solution,
    rig: Rig,
    cameras: Sequence[Camera],
    free: Sequence[str],
    known: Sequence[Known | None] = (),
    tied: Sequence[str] = (),
) -> Solution:
    """The solution adjusted on with other cameras, or with other of their values free; parameters as of `solve_links`.

    Raises
    ------
    GeometryError
        If the matches do not determine the rotations.
    """
    links, group, (rotations, *_) = solution
    scales = (spread_px(np.concatenate(solution.adjustment.residuals_px)), None)
    return Solution(links, group, _in_steps(links, rotations, group, cameras, free, scales, 1e-7, rig, known, tied))


def refined(solution: Solution, rig: Rig, known: Sequence[Known | None]) -> Solution:
    """The solution with the cameras adjusted too, held by the covariances with which they are known."""
    cameras = solution.adjustment.cameras
    names = tuple(dict.fromkeys(name for camera in cameras for name in camera.parameter_names))
    return readjusted(solution, rig, cameras, tuple(name for name in names if known or name != "aspect"), known)


def _in_steps(
    links: Sequence[Link],
    rotations: FloatArray,
    group: NDArray[np.intp],
    cameras: Sequence[Camera],
    free: Sequence[str],
    scales_px: Sequence[float | None],
    tolerance: float,
    rig: Rig,
    known: Sequence[Known | None],
    tied: Sequence[str],
) -> Adjustment:
    """One adjustment after another, each with its robust scale, of no more matches than are worth it."""
    used = [thinned(link, max(MIN_INLIERS, _MOST_MATCHES // len(links))) for link in links]
    spread = 1.0
    for k, asked in enumerate(scales_px):
        scale = max(_SHARP * spread if asked is None else asked, _LEAST_SCALE_PX)
        fall = tolerance if k == len(scales_px) - 1 else 1e-3
        adjustment = adjust(used, rotations, group, cameras, free, scale, fall, rig, known, tied)
        rotations, cameras = adjustment.rotations, adjustment.cameras
        spread = spread_px(np.concatenate(adjustment.residuals_px))
    return adjustment


def thinned(link: Link, most: int) -> Link:
    """The link with at most `most` of its matches, evenly picked."""
    step = -(-len(link.pixels_i) // most)
    return dataclasses.replace(link, pixels_i=link.pixels_i[::step], pixels_j=link.pixels_j[::step])
