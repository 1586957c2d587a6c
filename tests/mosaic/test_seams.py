"""Who owns which direction: on a smooth world with a ball that stands elsewhere in every frame."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.seams import find_owners

SPHERE = Equirectangular((512, 256))
RAYS = SPHERE.window_rays(slice(0, 512), slice(0, 256))
RING = (-120.0, 0.0, 120.0)


def direction(lon_deg: float, lat_deg: float = 0.0) -> FloatArray:
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    return np.array([np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)])


def within(centre: FloatArray, radius_deg: float) -> NDArray[np.bool_]:
    return np.asarray(RAYS @ centre > np.cos(np.radians(radius_deg)))


def world(rng: np.random.Generator) -> NDArray[np.float32]:
    """Random waves on the sphere, as light."""
    waves = rng.normal(size=(24, 3)) * rng.uniform(1, 20, 24)[:, None]
    strength = rng.normal(size=(24, 3)) / np.sqrt(1 + np.linalg.norm(waves, axis=1))[:, None]
    level = np.sin(RAYS @ waves.T + rng.uniform(0, 6, 24)) @ strength
    return np.asarray(0.2 * np.exp(0.25 * level), np.float32)


def quality(axis: FloatArray, half_fov_deg: float) -> NDArray[np.float32]:
    theta = np.degrees(np.arccos(np.clip(RAYS @ axis, -1, 1)))
    return np.where(theta < half_fov_deg, 1 - 0.95 * theta / half_fov_deg, 0).astype(np.float32)


def frames(
    axes: list[FloatArray],
    half_fov_deg: float,
    rng: np.random.Generator,
    things: list[NDArray[np.bool_]] | None = None,
) -> list[Overview]:
    """Noisy frames of one world, each a little brighter or darker, with a thing painted into each."""
    light = world(rng)
    made = []
    for i, axis in enumerate(axes):
        seen = quality(axis, half_fov_deg)
        one = light * (1 + 0.01 * rng.standard_normal(light.shape)) * 2 ** (0.03 * rng.standard_normal())
        if things is not None:
            one[things[i]] = (0.6, 0.1, 0.05)
        made.append(Overview(np.where(seen[..., None] > 0, one, 0).astype(np.float32), seen))
    return made


def shown(owner: NDArray[np.int16], overviews: list[Overview], things: list[NDArray[np.bool_]]) -> list[float]:
    """The share of each frame's thing that is seen in the mosaic."""
    return [float((owner == i)[thing].mean()) for i, thing in enumerate(things)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("half_fov_deg", [181, 150, 105])
def test_a_moved_ball_is_seen_once_and_whole_or_not_at_all(seed: int, half_fov_deg: float) -> None:
    """Seen by three frames everywhere, by two or three, or by two where it stands."""
    rng = np.random.default_rng(seed)
    axes = [direction(lon) for lon in RING]
    spots = [direction(lon + rng.uniform(40, 80), rng.uniform(-40, 40)) for lon in RING]
    balls = [within(spot, rng.uniform(3, 9)) for spot in spots]
    overviews = frames(axes, half_fov_deg, rng, balls)
    share = shown(find_owners(overviews), overviews, [ball & o.seen for ball, o in zip(balls, overviews, strict=True)])
    assert all(s in (0, 1) for s in share)
    assert sum(share) <= 1


@pytest.mark.parametrize("seed", range(3))
def test_a_ball_that_moved_by_less_than_itself_is_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = [direction(lon) for lon in RING]
    balls = [within(direction(60 + 5 * i, 10), 6) for i in range(3)]
    owner = find_owners(frames(axes, 181, rng, balls))
    assert len(np.unique(owner[balls[0] | balls[1] | balls[2]])) == 1


def test_a_ball_that_only_two_frames_tell_apart_is_seen_once() -> None:
    """Two frames that see everything: there is no majority."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        balls = [within(direction(-90, 20), 6), within(direction(95, -10), 6)]
        overviews = frames([direction(0), direction(180)], 181, rng, balls)
        share = shown(find_owners(overviews), overviews, balls)
        assert all(s in (0, 1) for s in share)
        assert sum(share) <= 1


def test_a_ball_half_outside_of_the_overlap_is_whole() -> None:
    rng = np.random.default_rng(1)
    ball = within(direction(70, 0), 8)  # the second frame sees from 70 degrees on
    nothing = np.zeros_like(ball)
    owner = find_owners(frames([direction(0), direction(180)], 110, rng, [ball, nothing]))
    assert (owner[ball] == 0).all()


def test_seams_go_around_what_frames_see_differently() -> None:
    """A band of near things shifted by parallax crosses the place where the seam would lie; it has a gap."""
    rng = np.random.default_rng(3)
    first, second = frames([direction(0), direction(90)], 150, rng)
    lat = np.degrees(np.arcsin(-RAYS[..., 1]))
    lon = np.degrees(np.arctan2(RAYS[..., 0], RAYS[..., 2]))
    differs = (np.abs(lat) < 30) & (lon > 30) & (lon < 60)
    second.light[differs] *= rng.uniform(0.5, 2, (*differs.shape, 1)).astype(np.float32)[differs]
    owner = find_owners([first, second])
    seam = (owner != np.roll(owner, -1, 1)) & differs & np.roll(differs, -1, 1)
    assert not seam.any()
    assert set(np.unique(owner)) == {0, 1}


@pytest.mark.parametrize("columns", [4, 100, 256])
def test_turned_frames_have_turned_owners(columns: int) -> None:
    rng = np.random.default_rng(5)
    axes = [direction(lon, lat) for lon, lat in ((0, 0), (90, 10), (180, -5), (-90, 0), (0, 90), (0, -90))]
    overviews = frames(axes, 95, rng, [within(direction(45, 0), 5), *[within(direction(200, 0), 0)] * 5])
    turned = [Overview(np.roll(o.light, columns, 1), np.roll(o.quality, columns, 1)) for o in overviews]
    np.testing.assert_array_equal(find_owners(turned), np.roll(find_owners(overviews), columns, 1))


def test_neither_the_edge_nor_a_pole_attracts_a_seam() -> None:
    """The frame that looks that way owns them, and a pole is one place."""
    rng = np.random.default_rng(6)
    owner = find_owners(frames([direction(180), direction(0), direction(0, 90), direction(0, -90)], 95, rng))
    assert (owner[128, [0, -1]] == 0).all()
    assert (owner[:8] == 2).all()
    assert (owner[-8:] == 3).all()


def test_the_owner_sees_where_anybody_does_and_holes_go_to_the_nearest() -> None:
    rng = np.random.default_rng(7)
    overviews = frames([direction(-90, 20), direction(90, 20)], 95, rng)
    seen = np.stack([o.seen for o in overviews])
    owner = find_owners(overviews)
    assert owner.shape == (256, 512)
    assert owner.dtype == np.int16
    by_owner = np.take_along_axis(seen, owner[None].astype(int), 0)[0]
    np.testing.assert_array_equal(by_owner, seen.max(0))
    hole = np.asarray(seen.sum(0) == 0)
    assert not seen[:, -1].any()
    clearly = hole & np.asarray(np.abs(RAYS[..., 0]) > 0.15)
    np.testing.assert_array_equal(owner[clearly], np.where(RAYS[..., 0] > 0, 1, 0)[clearly])


def test_one_frame_or_a_blind_one() -> None:
    one, blind = frames([direction(0), direction(90)], 95, np.random.default_rng(8))
    assert not find_owners([one]).any()
    blind = Overview(np.zeros_like(blind.light), np.zeros_like(blind.quality))
    assert (find_owners([blind, one]) == 1).all()
    assert not find_owners([blind, blind]).any()


def test_of_many_frames_few_are_used_and_nothing_is_lost() -> None:
    rng = np.random.default_rng(10)
    overviews = frames([direction(9 * i, rng.normal()) for i in range(40)], 95, rng)
    owner = find_owners(overviews)
    best = np.stack([o.quality for o in overviews])
    owned = np.take_along_axis(best, owner[None].astype(int), 0)[0]
    seen = best.max(0) > 0
    assert (owned > 0)[seen].all()
    assert len(np.unique(owner)) < 20
    assert np.mean((owned / np.maximum(best.max(0), 1e-9))[seen]) > 0.8


def test_threads_change_nothing() -> None:
    overviews = frames([direction(0), direction(120), direction(240)], 120, np.random.default_rng(9))
    owner = find_owners(overviews)
    with thread_pool(2) as pool:
        np.testing.assert_array_equal(find_owners(overviews, pool), owner)
