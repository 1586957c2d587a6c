"""Links -> the largest group of frames and its orientations under one camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.mosaic.adjust import Adjustment, adjust
from fullsphere.mosaic.matching import MIN_INLIERS
from fullsphere.mosaic.orientation import connected_groups, disagreement_deg, first_orientations
from fullsphere.mosaic.project import Link

_AGREEMENT_DEG = 6.0  # a link further from the averaged orientations is of another thing that looks the same
_MOST_MATCHES = 100_000  # adjusted at once: more do not make the orientations better, only slower


class Solution(NamedTuple):
    """The links kept, the frames they hold together, and their adjustment."""

    links: list[Link]
    group: NDArray[np.intp]
    adjustment: Adjustment


def solve_links(
    links: Sequence[Link],
    count: int,
    camera: Camera,
    free: Sequence[str] = (),
    robust_scales_px: Sequence[float] = (16.0, 4.0, 1.0),
    tolerance: float = 1e-7,
) -> Solution:
    """Largest group, first orientations without the links that contradict them, adjustment.

    Parameters
    ----------
    links
        Between any of the frames.
    count
        How many frames there are.
    camera, free, tolerance
        As for `adjust`.
    robust_scales_px
        One adjustment for each: with a scale that falls in steps a loop that does not close yet is pulled shut first,
        and outliers are judged after.

    Raises
    ------
    GeometryError
        If the links hold no two frames together.
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
    kept = agreeing or inner
    used = [thinned(link, max(MIN_INLIERS, _MOST_MATCHES // len(kept))) for link in kept]
    for scale in robust_scales_px:
        last = scale == robust_scales_px[-1]
        adjustment = adjust(used, rotations, group, camera, free, scale, tolerance if last else 1e-3)
        rotations, camera = adjustment.rotations, adjustment.camera
    return Solution(kept, group, adjustment)


def thinned(link: Link, most: int) -> Link:
    """The link with at most `most` of its matches, evenly picked."""
    step = -(-len(link.pixels_i) // most)
    return dataclasses.replace(link, pixels_i=link.pixels_i[::step], pixels_j=link.pixels_j[::step])
