"""The laws of a blender: constant stays constant, one picture is itself, the order does not matter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fullsphere.model.errors import UsageError
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import ordered_map, thread_pool
from fullsphere.mosaic.blend import Bands, MultiBand, filled
from laws import SEEDS, law

HEIGHT, WIDTH = 64, 128
Picture = NDArray[np.float32]
Fed = tuple[Picture, NDArray[np.bool_], Picture]


def rays_of(height: int) -> NDArray[np.float64]:
    return Equirectangular((2 * height, height)).window_rays(slice(0, 2 * height), slice(0, height))


def patches(rng: np.random.Generator, count: int) -> list[Fed]:
    """Pictures of one sphere, each seen within a cone; every pixel is wanted of the one whose axis is the nearest."""
    rays = rays_of(HEIGHT)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    nearest = np.argmax(rays @ axes.T, -1)
    pictures = rng.random((count, HEIGHT, WIDTH, 3)).astype(np.float32)
    return [
        (pictures[k], rays @ axes[k] > rng.uniform(-0.6, 0.3), (nearest == k).astype(np.float32)) for k in range(count)
    ]


def joined(fed: list[Fed]) -> Picture:
    blender = MultiBand(*fed[0][1].shape)
    for light, seen, mask in fed:
        blender.feed(light, seen, mask)
    return blender.blended()


@given(seed=SEEDS, height=st.sampled_from([16, 24, 50, 64]), channels=st.integers(1, 4), all_seen=st.booleans())
@law(20)
def test_bands_of_one_picture_add_up_to_it(seed: int, height: int, channels: int, all_seen: bool) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.normal(size=(height, 2 * height, channels)).astype(np.float32)
    seen = np.full((height, 2 * height), all_seen) | (rays_of(height) @ np.array([0.5, 0.6, -0.7]) > 0.1)
    light = np.where(seen[..., None], picture, np.float32(np.nan))  # nobody looks at what is not seen
    blended = joined([(light, seen, np.ones(seen.shape, np.float32))])
    np.testing.assert_allclose(blended[seen], picture[seen], atol=3e-6)
    np.testing.assert_allclose(blended, filled(light, seen), atol=3e-6)
    assert blended.dtype == np.float32


@given(seed=SEEDS, constant=st.floats(-20, 1000, width=32), count=st.integers(1, 5))
@law(20)
def test_a_constant_sphere_stays_constant_for_any_masks(seed: int, constant: float, count: int) -> None:
    rng = np.random.default_rng(seed)
    flat = np.full((HEIGHT, WIDTH, 3), constant, np.float32)
    fed = [
        (flat, rng.random((HEIGHT, WIDTH)) > 0.5, (rng.random((HEIGHT, WIDTH)) * (rng.random((HEIGHT, WIDTH)) > 0.9)))
        for _ in range(count)
    ]
    for _, seen, _ in fed:
        seen[3, 5] = True
    masks = [mask.astype(np.float32) for _, _, mask in fed]
    blended = joined([(light, seen, mask) for (light, seen, _), mask in zip(fed, masks, strict=True)])
    np.testing.assert_allclose(blended, constant, rtol=1e-5, atol=1e-30)


def test_a_constant_wanted_in_one_small_place_goes_on_everywhere() -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[40:43, 100:104] = 1
    flat = np.full((HEIGHT, WIDTH, 1), 7, np.float32)
    np.testing.assert_allclose(joined([(flat, mask > 0, mask)]), 7, rtol=1e-5)


def steepest(picture: Picture, forward: tuple[float, float, float], view_deg: float = 40.0) -> float:
    """The largest slope, per radian, of one channel in a small perspective view of a sphere."""
    height, width = picture.shape
    axis = np.array(forward) / np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [0.0, 0.0, 1.0], axis)
    right /= np.linalg.norm(right)
    across = np.tan(np.radians(view_deg / 2)) * np.linspace(-1, 1, 60)
    rays = axis + across[:, None] * right + across[:, None, None] * np.cross(axis, right)
    pixels = Equirectangular((width, height)).project(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    beyond = [np.roll(rows[::-1], width // 2, 1) for rows in (picture[:2], picture[-2:])]
    padded = np.pad(np.concatenate([beyond[0], picture, beyond[1]]), ((0, 0), (2, 2)), mode="wrap")
    view = map_coordinates(padded, [pixels[..., 1] + 2, pixels[..., 0] + 2], order=1)
    return float(np.hypot(*np.gradient(view, across, across)).max() if np.isfinite(view).all() else np.inf)


UP, DOWN, AHEAD, BEHIND, SIDE = (0, -1, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (1, 0, 0)


@pytest.mark.parametrize(
    ("normal", "on_the_seam"),
    [
        ((1, 0, 0), (UP, DOWN, AHEAD, BEHIND)),  # through both poles and along the edge
        ((0, 1, 0), (AHEAD, BEHIND, SIDE)),
        ((0.1, 0.3, 0.95), (UP, (0, -0.95, 0.3), (0, 0.95, -0.3), (0.95, 0, -0.1))),  # past the poles
        ((0, 0, 1), (UP, DOWN, SIDE)),
    ],
)
def test_an_offset_is_spread_over_the_widest_band_at_poles_edge_and_equator_alike(
    normal: tuple[float, float, float], on_the_seam: tuple[tuple[float, float, float], ...]
) -> None:
    height, offset = 128, 0.8
    mine = (rays_of(height) @ np.array(normal, float) > 0).astype(np.float32)
    everything = np.ones(mine.shape, bool)
    flat = np.zeros((*mine.shape, 1), np.float32)
    blended = joined([(flat, everything, mine), (flat + np.float32(offset), everything, 1 - mine)])[..., 0]
    assert blended.min() >= -1e-6
    assert blended.max() <= offset + 1e-6
    assert blended[rays_of(height) @ np.array(normal, float) > 0.95 * np.linalg.norm(normal)].max() < 0.02 * offset
    widest = np.pi / 8  # a pixel of the coarsest band
    for forward in on_the_seam:
        assert 0.3 * offset / widest < steepest(blended, forward) < 0.8 * offset / widest, forward


def test_a_detailed_picture_and_itself_brighter_join_without_a_step() -> None:
    height = 128
    rays = rays_of(height)
    scene = (0.3 * np.sin(rays @ np.array([9.0, 7, 4])) * np.cos(rays @ np.array([3.0, -8, 6])))[..., None]
    mine = (rays @ np.array([0.1, 0.3, 0.95]) > 0).astype(np.float32)
    everything = np.ones(mine.shape, bool)
    blended = joined(
        [(scene.astype(np.float32), everything, mine), (scene.astype(np.float32) + 1, everything, 1 - mine)]
    )
    added = blended[..., 0] - scene[..., 0].astype(np.float32)
    for forward in (UP, DOWN, SIDE, (0, -0.95, 0.3)):
        assert steepest(added, forward) < 8 / np.pi


@given(seed=SEEDS, turn=st.integers(1, 15))
@law(10)
def test_turning_by_pixels_of_the_coarsest_band_turns_what_is_blended(seed: int, turn: int) -> None:
    fed = patches(np.random.default_rng(seed), 3)
    turned = [tuple(np.roll(array, 8 * turn, 1) for array in one) for one in fed]
    np.testing.assert_allclose(joined(turned), np.roll(joined(fed), 8 * turn, 1), atol=1e-6)  # type: ignore[arg-type]


@given(seed=SEEDS, turn=st.integers(1, WIDTH - 1))
@law(10)
def test_turning_by_any_columns_turns_it_but_for_where_the_coarse_pixels_lie(seed: int, turn: int) -> None:
    """A pyramid drops samples, so its coarse pixels stand elsewhere: not rounding, yet little."""
    fed = patches(np.random.default_rng(seed), 3)
    turned = [tuple(np.roll(array, turn, 1) for array in one) for one in fed]
    changed = joined(turned) - np.roll(joined(fed), turn, 1)  # type: ignore[arg-type]
    assert np.sqrt((changed**2).mean()) < 0.01


@given(seed=SEEDS)
@law(10)
def test_the_order_of_feeding_is_rounding(seed: int) -> None:
    fed = patches(np.random.default_rng(seed), 5)
    np.testing.assert_allclose(joined(fed[::-1]), joined(fed), atol=1e-5)


def test_threads_change_nothing() -> None:
    fed = patches(np.random.default_rng(5), 6)
    blender = MultiBand(HEIGHT, WIDTH)

    def taken_apart(one: Fed) -> Bands:
        return blender.taken_apart(*one)

    with thread_pool(3) as pool:
        for bands in ordered_map(pool, taken_apart, fed):
            blender.add(bands)
    np.testing.assert_array_equal(blender.blended(), joined(fed))
    np.testing.assert_array_equal(blender.blended(), joined(fed))  # asking does not change the answer


def test_what_is_fed_is_not_changed() -> None:
    fed = patches(np.random.default_rng(6), 2)
    before = [tuple(array.copy() for array in one) for one in fed]
    joined(fed)
    for one, copy in zip(fed, before, strict=True):
        for array, kept in zip(one, copy, strict=True):
            np.testing.assert_array_equal(array, kept)


def test_a_picture_is_not_wanted_where_it_does_not_see() -> None:
    """Half a sphere is unseen by its owner: the other picture, which sees it, is taken, and not the continuation."""
    rays = rays_of(HEIGHT)
    bright, dark = np.ones((HEIGHT, WIDTH, 1), np.float32), np.zeros((HEIGHT, WIDTH, 1), np.float32)
    half, everything = rays[..., 2] > 0, np.ones((HEIGHT, WIDTH), bool)
    whole_mask = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    blended = joined([(bright, half, whole_mask), (dark, everything, whole_mask)])[..., 0]
    assert blended[rays[..., 2] < -0.6].max() < 0.02
    assert abs(blended[rays[..., 2] > 0.6] - 0.5).max() < 0.02


def test_what_is_no_sphere_is_refused() -> None:
    with pytest.raises(UsageError, match="twice"):
        MultiBand(64, 127)
    with pytest.raises(UsageError, match="two bands"):
        MultiBand(25, 50)
    with pytest.raises(UsageError, match="nothing to blend"):
        MultiBand(16, 32).blended()
    with pytest.raises(UsageError, match="are not those of a sphere"):
        MultiBand(16, 32).feed(np.zeros((16, 32), np.float32), np.ones((16, 32), bool), np.ones((16, 32), np.float32))
