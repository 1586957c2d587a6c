"""What matches say of frames: distances, arrows and medians, of known errors."""

import dataclasses

import numpy as np
import pytest
from turning import frame_of, matched, orientation

from fullsphere.mosaic.match_errors import held_out_px
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.residuals import against_theta, by_frame, residuals
from fullsphere.mosaic.rig import Rig
from laws import fisheye

CAMERA = fisheye(400)
ROTATIONS = np.array([orientation(yaw) for yaw in (0, 60, 120)])
RIGHT = np.array([2.0, 0.0])
GONE = np.zeros((400, 400, 3), np.uint8)


def mosaic_of(noise_px: float = 0.0, held: int = 10) -> Mosaic:
    frames = [frame_of(str(k), GONE, turn) for k, turn in enumerate(ROTATIONS)]
    links = [
        dataclasses.replace(
            link,
            pixels_i=link.pixels_i[held:],
            pixels_j=link.pixels_j[held:],
            held_i=link.pixels_i[:held],
            held_j=link.pixels_j[:held],
        )
        for link in matched(CAMERA, ROTATIONS, count=50, noise_px=noise_px)
    ]
    return Mosaic((CAMERA,), tuple(frames), tuple(links))


def test_matches_that_agree_are_no_distance_apart() -> None:
    found = residuals(mosaic_of())
    assert found.distance_px.max() < 1e-4
    assert np.abs(found.arrow_px).max() < 1e-4
    assert found.held.sum() == 10 * len(mosaic_of().links)


def test_an_arrow_points_from_where_a_thing_was_seen_to_where_the_others_put_it() -> None:
    """A frame in which everything was seen 2 px too far right has arrows of 2 px to the left."""
    mosaic = mosaic_of()
    links = tuple(
        dataclasses.replace(link, pixels_j=link.pixels_j + RIGHT, held_j=link.held_j + RIGHT) for link in mosaic.links
    )
    found = residuals(dataclasses.replace(mosaic, links=links))
    known = np.isfinite(found.arrow_px).all(1)
    np.testing.assert_allclose(found.arrow_px[known], np.broadcast_to([-2, 0], (known.sum(), 2)), atol=1e-6)
    middle = found.theta < 0.6
    np.testing.assert_allclose(found.distance_px[middle], 2, rtol=0.25)


def test_medians_are_those_of_the_mosaic() -> None:
    mosaic = mosaic_of(noise_px=0.5)
    found = residuals(mosaic)
    rig = Rig.of(mosaic.frames)
    every = held_out_px(mosaic.links, ROTATIONS, mosaic.cameras, rig)
    np.testing.assert_allclose(np.sort(found.distance_px[found.held]), np.sort(every[every < 2.5]))
    each = by_frame(mosaic, found)
    assert [one.links for one in each] == [sum(k in (link.i, link.j) for link in mosaic.links) for k in range(3)]
    own = (found.i == 1) | (found.j == 1)
    assert each[1].matches == (own & ~found.held).sum()
    assert each[1].median_px == pytest.approx(np.median(found.distance_px[own & ~found.held]))
    assert each[1].held_median_px == pytest.approx(np.median(found.distance_px[own & found.held]))


def test_what_is_far_off_is_no_held_match() -> None:
    mosaic = mosaic_of()
    wild = tuple(dataclasses.replace(link, held_j=link.held_j + 15 * RIGHT) for link in mosaic.links)
    found = residuals(dataclasses.replace(mosaic, links=wild))
    assert not found.held.any()
    assert by_frame(mosaic, found)[0].held_median_px is None


def test_residuals_by_angle_are_quartiles_of_all() -> None:
    found = residuals(mosaic_of(noise_px=0.5, held=20))
    bins = against_theta(found)
    assert sum(one.matches for one in bins) == found.held.sum()
    assert all(one.lower_px <= one.median_px <= one.upper_px for one in bins)
    theta = np.rad2deg(found.theta[found.held])
    at = bins[len(bins) // 2]
    own = np.abs(theta - at.theta_deg) <= 2.5
    assert at.median_px == pytest.approx(np.median(found.distance_px[found.held][own]))


def test_frames_left_out_have_no_matches() -> None:
    mosaic = mosaic_of()
    left = dataclasses.replace(mosaic, frames=(*mosaic.frames[:2], mosaic.frames[2].left_out("odd")))
    found = residuals(left)
    assert set(found.i.tolist()) | set(found.j.tolist()) == {0, 1}
    assert by_frame(left, found)[2].matches == 0
