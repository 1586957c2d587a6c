"""From any projection to any other: geometry against a slow twin, and what happens at rims, seams and poles."""

import math
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import Equidistant, Perspective
from fullsphere.model.remap import pixels_per_radian, remap, tiles, window_rays
from fullsphere.model.sampling import Interpolation
from fullsphere.model.surface import Equirectangular
from fullsphere.model.table import tabulate
from fullsphere.model.workers import thread_pool
from laws import fisheye, law, pixel_rays, rotation, smooth_light, smooth_panorama

WORLD = Equirectangular((800, 400))
NARROW = Camera(Perspective(300.0), (400, 300), (199.5, 149.5), half_fov=math.radians(50))
every_interpolation = pytest.mark.parametrize("interpolation", get_args(Interpolation))


def wavy(width: int, height: int) -> NDArray[np.float32]:
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack(
        [100 + 40 * np.sin(u / 20) * np.cos(v / 25), 80 + 0.1 * u, 90 + 30 * np.cos(u / 30 + v / 17)], -1
    ).astype(np.float32)


@given(width=st.integers(1, 3000), height=st.integers(1, 3000), side=st.integers(1, 700))
@law(40)
def test_tiles_partition_the_canvas(width: int, height: int, side: int) -> None:
    side = max(side, max(width, height) // 40)
    count = np.zeros((height, width), np.uint8)
    cut = tiles((width, height), side)
    for tile in cut:
        assert count[tile].size > 0
        assert max(count[tile].shape) <= side
        count[tile] += 1
    assert count.min() == count.max() == 1
    corners = [(rows.start, columns.start) for rows, columns in cut]
    assert corners == sorted(corners)


@pytest.mark.parametrize("projection", [WORLD, fisheye(300), NARROW], ids=["world", "fisheye", "narrow"])
def test_rays_of_a_tile_are_those_of_its_pixels(projection: Projection) -> None:
    rows, columns = slice(10, 130), slice(190, 257)
    tile, whole = window_rays(projection, (rows, columns)), pixel_rays(projection)
    np.testing.assert_allclose(tile, whole[rows, columns], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (fisheye(600, aspect=1.05), Equirectangular((1400, 700))),
        (fisheye(600), NARROW),
        (NARROW, fisheye(1200)),
        (fisheye(400), fisheye(500)),
    ],
    ids=["fisheye to world", "fisheye to narrow", "narrow to fisheye", "fisheye to fisheye"],
)
def test_remap_against_its_twin(source: Camera, target: Projection) -> None:
    """The exact camera and scipy; targets finer than the source, which is smoothed for coarser ones.

    OpenCV reads in steps of 1/32 px.
    """
    assert pixels_per_radian(source) < pixels_per_radian(target)
    image, turn = wavy(*source.size), Rotation.from_euler("YXZ", [25, -10, 40], degrees=True).as_matrix()
    result, weight = remap(image, source, target, turn, "linear", antialias=False)
    pixels = source.project(pixel_rays(target) @ turn)  # transposed twice: source_from_target on row vectors
    u, v = np.nan_to_num(pixels[..., 0], nan=-9.0), np.nan_to_num(pixels[..., 1], nan=-9.0)
    twin = np.stack([map_coordinates(image[..., c], [v, u], order=1, mode="nearest") for c in range(3)], -1)
    r = np.hypot(u - source.centre[0], (v - source.centre[1]) / source.aspect)
    within = (u >= 0) & (u <= source.size[0] - 1) & (v >= 0) & (v <= source.size[1] - 1)
    deep = within & (r < float(source.lens.radius(source.half_fov)) - 2)
    assert deep.sum() > 20_000
    per_px = sum(np.abs(step).max() for step in np.gradient(image, axis=(0, 1)))
    np.testing.assert_allclose(result[deep], twin[deep], rtol=0, atol=per_px / 64 + 1e-3)
    np.testing.assert_array_equal(weight[deep], 1)
    beyond = (u < -0.5) | (u > source.size[0] - 0.5) | (v < -0.5) | (v > source.size[1] - 0.5)
    np.testing.assert_array_equal(weight[beyond], 0)
    np.testing.assert_array_equal(result[weight == 0], 0)
    assert set(np.unique(weight)) <= {0.0, 1.0}


@every_interpolation
@pytest.mark.parametrize("projection", [NARROW, WORLD], ids=["narrow", "world"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_remap_to_itself_is_the_picture(projection: Projection, interpolation: Interpolation, dtype: type[Any]) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (projection.size[1], projection.size[0], 3)).astype(dtype)
    result, weight = remap(image, projection, projection, interpolation=interpolation)
    assert result.dtype == dtype
    assert weight.dtype == np.float32
    np.testing.assert_allclose(result, image, rtol=0, atol=0 if dtype is not np.float32 else 1e-6)
    np.testing.assert_array_equal(weight, 1)


@every_interpolation
@pytest.mark.parametrize("channels", [(), (1,), (3,), (4,)])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_constant_picture_stays_constant_up_to_the_rim(
    interpolation: Interpolation, channels: tuple[int, ...], dtype: type[Any]
) -> None:
    """The dark beyond the rim of a fisheye leaves no fringe, nor does a border of the picture."""
    source = fisheye(400)
    image = np.where(np.isfinite(pixel_rays(source)[..., :1]), 200, 0).astype(dtype)
    image = np.broadcast_to(image.reshape(400, 400, *[1] * len(channels)), (400, 400, *channels)).copy()
    for target in (WORLD, fisheye(350, 80)):
        result, weight = remap(image, source, target, rotation(8), interpolation)
        assert result.shape == (target.size[1], target.size[0], *channels)
        rounding = 1 if np.issubdtype(dtype, np.integer) else 1e-3  # at the rim a code is divided by its cover
        np.testing.assert_allclose(result[weight > 0].astype(float), 200, rtol=0, atol=rounding)
        assert set(np.unique(result[weight == 0])) <= {0}


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_the_dark_round_a_fisheye_picture_does_not_come_in(interpolation: Interpolation) -> None:
    """Whatever stands beyond the rim, the result is the same."""
    source = fisheye(400)
    seen = np.isfinite(pixel_rays(source)[..., :1])
    scene = wavy(400, 400)
    dark, bright = np.where(seen, scene, 0), np.where(seen, scene, np.float32(9999))
    target = fisheye(800, 95)  # finer than the source: nothing is smoothed
    one, weight = remap(dark, source, target, None, interpolation)
    other, same = remap(bright, source, target, None, interpolation)
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(weight, same)


def test_the_dark_does_not_come_in_when_the_target_is_coarse() -> None:
    """The same where the source must be smoothed for a coarser target: no dim rim."""
    source, target = fisheye(800), fisheye(100, 94.9)
    image = np.where(np.isfinite(pixel_rays(source)[..., :1]), 200, 0).astype(np.float32).repeat(3, axis=2)
    result, weight = remap(image, source, target)
    assert weight.sum() > 5000
    np.testing.assert_allclose(result[weight > 0], 200, rtol=0, atol=1e-3)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_bytes_do_not_depend_on_threads(threads: int) -> None:
    source, target = fisheye(500), Equirectangular((1400, 700))
    image = np.random.default_rng(0).integers(0, 256, (500, 500, 3)).astype(np.uint8)
    alone, alone_weight = remap(image, source, target, rotation(1))
    with thread_pool(threads) as pool:
        result, weight = remap(image, source, target, rotation(1), executor=pool)
    np.testing.assert_array_equal(result, alone)
    np.testing.assert_array_equal(weight, alone_weight)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("look", [(0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)], ids=["seam", "zenith", "nadir"])
def test_a_panorama_has_no_edge_as_a_source(interpolation: Interpolation, look: tuple[float, float, float]) -> None:
    """Looking at the seam or a pole, the picture is as smooth as the function on the sphere that it shows."""
    z = np.array(look)
    x = np.array([1.0, 0.0, 0.0])
    target_from_world = np.stack([x, np.cross(z, x), z])
    camera = Camera(Perspective(400.0), (201, 201), (100.0, 100.0), half_fov=math.radians(25))
    result, weight = remap(smooth_panorama(800), WORLD, camera, target_from_world, interpolation)
    seen = np.isfinite(pixel_rays(camera)[..., 0])
    np.testing.assert_array_equal(weight, seen)
    truth = smooth_light(pixel_rays(camera)[seen] @ target_from_world)
    np.testing.assert_allclose(result[seen], truth, atol=3e-4)


@pytest.mark.parametrize("width", [200, 800, 2400])
def test_no_column_of_a_panorama_is_its_edge(width: int) -> None:
    """Rolled sideways and turned back it looks the same: the seam is nowhere, also when detail is smoothed away."""
    image = np.random.default_rng(0).integers(0, 256, (width // 2, width, 3)).astype(np.uint8)
    source = Equirectangular((width, width // 2))
    camera = fisheye(250)
    straight, _ = remap(image, source, camera, rotation(4))
    quarter = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # +x, at 3/4 of the width, to the middle
    rolled, _ = remap(np.roll(image, -width // 4, axis=1), source, camera, rotation(4) @ quarter.T)
    assert np.abs(straight.astype(int) - rolled).max() <= 16  # a step of 1/32 px may fall the other way
    assert np.mean(straight != rolled) < 0.01


def test_there_and_back_again() -> None:
    """A smooth panorama seen by two fisheyes back to back comes back from them."""
    panorama, camera = smooth_panorama(800), fisheye(700)
    total = np.zeros_like(panorama)
    weights = np.zeros(panorama.shape[:2], np.float32)
    for turn in (rotation(2), np.diag([-1.0, 1.0, -1.0]) @ rotation(2)):
        frame, _ = remap(panorama, WORLD, camera, turn)
        back, weight = remap(frame, camera, WORLD, turn.T)
        assert weight.mean() == pytest.approx((1 - math.cos(camera.half_fov)) / 2, abs=0.05)
        np.testing.assert_allclose(back[weight > 0], panorama[weight > 0], atol=2e-3)
        total += back
        weights += weight
    assert weights.min() >= 1
    np.testing.assert_allclose(total / weights[..., None], panorama, atol=2e-3)


def test_a_table_gives_the_same_as_its_camera() -> None:
    camera, image = fisheye(300), wavy(300, 300)
    by_camera, by_table = (remap(image, source, WORLD)[0] for source in (camera, tabulate(camera)))
    np.testing.assert_array_equal(by_camera, by_table)


def test_a_target_that_sees_beyond_the_source_has_no_weight_there() -> None:
    source = Camera(Equidistant(100.0), (200, 200), (99.5, 99.5), half_fov=math.radians(60))
    _, weight = remap(np.ones((200, 200, 3), np.float32), source, fisheye(300))
    theta = np.arccos(np.clip(np.nan_to_num(pixel_rays(fisheye(300))[..., 2], nan=-1), -1, 1))
    assert np.all(weight[theta > math.radians(61)] == 0)
    assert np.all(weight[theta < math.radians(56)] == 1)


@pytest.mark.parametrize("shape", [(300, 299, 3), (299, 300, 3), (150, 150, 3)])
def test_a_picture_of_another_size_is_refused(shape: tuple[int, int, int]) -> None:
    with pytest.raises(UsageError, match="300"):
        remap(np.zeros(shape, np.uint8), fisheye(300), WORLD)


def test_an_unknown_interpolation_is_refused() -> None:
    with pytest.raises(UsageError, match="nearest, linear, cubic"):
        remap(np.zeros((300, 300, 3), np.uint8), fisheye(300), WORLD, interpolation="sharp")  # type: ignore[arg-type]
