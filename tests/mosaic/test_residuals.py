"""What matches say of frames: distances, arrows and medians, of known errors."""

import dataclasses

import numpy as np
import pytest
from turning import frame_of, matched, orientation

from fullsphere.mosaic.match_errors import MatchArrays, held_out_px, match_errors
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.residuals import against_theta, by_frame, by_link, residuals, sights
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
    mosaic = mosaic_of()
    found = residuals(mosaic)
    assert found.distance_px.max() < 1e-4
    assert np.nanmax(found.error_px) < 1e-4
    assert np.abs(sights(mosaic, found).arrow_px).max() < 1e-4
    assert found.held.sum() == 10 * len(mosaic.links)


def test_an_arrow_points_from_where_a_thing_was_seen_to_where_the_other_frame_puts_it() -> None:
    """What frame 2 saw 2 px too far right has arrows of 2 px to the left there, and frame 0 has them the other way."""
    mosaic = mosaic_of()
    links = tuple(
        dataclasses.replace(link, pixels_j=link.pixels_j + RIGHT, held_j=link.held_j + RIGHT)
        for link in mosaic.links
        if link.j == 2
    )
    mosaic = dataclasses.replace(mosaic, links=links)
    seen = sights(mosaic, residuals(mosaic))
    there = seen.where((seen.frame == 2) & np.isfinite(seen.arrow_px).all(1))
    assert there.frame.size > 40
    np.testing.assert_allclose(there.arrow_px, np.broadcast_to([-2.0, 0.0], there.arrow_px.shape), atol=1e-6)
    here = seen.where((seen.frame != 2) & (seen.theta < 1.2))  # not the stretched rim
    assert here.frame.size > 40
    assert (here.arrow_px[:, 0] > 0).mean() > 0.95
    middle = there.where(there.theta < 0.6)
    np.testing.assert_allclose(middle.distance_px, 2, rtol=0.25)


def test_every_match_is_seen_at_both_its_ends() -> None:
    mosaic = mosaic_of(noise_px=0.5)
    found = residuals(mosaic)
    seen = sights(mosaic, found)
    assert set(seen.frame.tolist()) == {0, 1, 2}
    assert seen.frame.size == 2 * found.i.size
    for k in range(3):
        own = np.concatenate([found.pixels_j[found.j == k], found.pixels_i[found.i == k]])
        np.testing.assert_array_equal(seen.pixels[seen.frame == k], own)


def test_medians_are_those_that_the_quality_of_a_mosaic_tells() -> None:
    """The fit's are errors of one keypoint, held-out ones distances on the sphere, as told for the whole set."""
    mosaic = mosaic_of(noise_px=0.5)
    found = residuals(mosaic)
    rig = Rig.of(mosaic.frames)
    every = held_out_px(mosaic.links, ROTATIONS, mosaic.cameras, rig)
    np.testing.assert_allclose(np.sort(found.distance_px[found.held]), np.sort(every[every < 2.5]))
    fitted = np.linalg.norm(match_errors(MatchArrays.of(mosaic.links), ROTATIONS, mosaic.cameras, rig).residual, axis=1)
    np.testing.assert_allclose(np.sort(found.error_px[~found.held]), np.sort(fitted))
    each = by_frame(mosaic, found)
    assert [one.links for one in each] == [sum(k in (link.i, link.j) for link in mosaic.links) for k in range(3)]
    own = (found.i == 1) | (found.j == 1)
    assert each[1].matches == (own & ~found.held).sum()
    assert each[1].median_px == pytest.approx(np.median(found.error_px[own & ~found.held]))
    assert each[1].held_median_px == pytest.approx(np.median(found.distance_px[own & found.held]))
    # of two keypoints with equal noise the one's error is Rayleigh's, 1.1774 sigma, the distance of both wider
    assert np.median(found.error_px[~found.held]) == pytest.approx(1.1774 * 0.5, rel=0.15)
    assert np.median(found.distance_px[~found.held]) > 1.2 * np.median(found.error_px[~found.held])


def test_a_link_tells_the_median_of_its_held_matches_and_else_of_the_fit() -> None:
    mosaic = mosaic_of(noise_px=0.5)
    found = residuals(mosaic)
    for least, held in ((4, True), (1000, False)):
        for link, median in zip(mosaic.links, by_link(mosaic, found, least), strict=True):
            own = (found.i == link.i) & (found.j == link.j) & (found.held == held)
            assert median == pytest.approx(np.median(found.distance_px[own]))
    none = np.empty((0, 2))
    bare = dataclasses.replace(mosaic.links[0], pixels_i=none, pixels_j=none, held_i=none, held_j=none)
    without = dataclasses.replace(mosaic, links=(bare, *mosaic.links[1:]))
    assert by_link(without, residuals(without), 4)[0] is None


def test_what_is_far_off_is_no_held_match() -> None:
    mosaic = mosaic_of()
    wild = tuple(dataclasses.replace(link, held_j=link.held_j + 15 * RIGHT) for link in mosaic.links)
    found = residuals(dataclasses.replace(mosaic, links=wild))
    assert not found.held.any()
    assert by_frame(mosaic, found)[0].held_median_px is None


def test_residuals_by_angle_are_quartiles_of_all() -> None:
    mosaic = mosaic_of(noise_px=0.5, held=20)
    found = sights(mosaic, residuals(mosaic))
    bins = against_theta(found)
    assert sum(one.matches for one in bins) == found.held.sum()  # both ends
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
