"""A Remapper gives what `remap` gives: in bands, with geometry kept, on any threads, for any kind of array."""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import minimum_filter

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import Interpolation, Remapper, remap
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from laws import SURFACES, fisheye, rotation

SPHERE = Equirectangular((600, 300))
VIEW = Camera(Perspective(150.0), (240, 150), (119.5, 74.5), half_fov=math.radians(50))
FRAME = fisheye(260)
KINDS = get_args(Interpolation)
every_interpolation = pytest.mark.parametrize("interpolation", KINDS)
every_dtype = pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32])
PAIRS: dict[str, tuple[Projection, Projection]] = {
    "fisheye to sphere": (FRAME, SPHERE),
    "sphere to view": (SPHERE, VIEW),
    "sphere to small fisheye": (SPHERE, fisheye(90)),
    "cube to sphere": (CubeMap(64), Equirectangular((300, 150))),
    "sphere to cube": (SPHERE, CubeMap(70, "cross")),
}
every_pair = pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)


def noise(
    projection: Projection, dtype: Any = np.uint8, channels: tuple[int, ...] = (3,), seed: int = 0
) -> NDArray[Any]:
    rng = np.random.default_rng(seed)
    shape = (projection.size[1], projection.size[0], *channels)
    if np.dtype(dtype).kind == "u":
        return rng.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    light: NDArray[Any] = rng.uniform(0, 4, shape).astype(dtype)
    return light


def assert_same(found: tuple[NDArray[Any], NDArray[Any]], expected: tuple[NDArray[Any], NDArray[Any]]) -> None:
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("antialias", [True, False])
@every_interpolation
@every_pair
def test_a_call_the_function_and_the_bands_are_the_same(
    pair: tuple[Projection, Projection], interpolation: Interpolation, antialias: bool
) -> None:
    source, target = pair
    image = noise(source)
    expected = remap(image, source, target, rotation(1), interpolation, antialias=antialias)
    assert expected[1].any()
    remapper = Remapper(source, target, rotation(1), interpolation, antialias=antialias)
    assert_same(remapper(image), expected)
    for rows in (1, 7, 64, 100, 1000) if interpolation == "cubic" else (50,):
        bands = list(remapper.bands(image, rows))
        assert [band.top for band in bands] == list(range(0, target.size[1], rows))
        assert all(len(band.pixels) == len(band.weight) <= rows for band in bands)
        whole = np.concatenate([band.pixels for band in bands]), np.concatenate([band.weight for band in bands])
        assert_same(whole, expected)


@every_pair
def test_kept_geometry_changes_no_byte(pair: tuple[Projection, Projection]) -> None:
    """None of it kept, some or all, frame after frame."""
    source, target = pair
    images = [noise(source, seed=seed) for seed in range(3)]
    expected = [remap(image, source, target, rotation(2)) for image in images]
    for kept_bytes in (0, 1, 300_000, 1 << 30):
        remapper = Remapper(source, target, rotation(2), kept_bytes=kept_bytes)
        for image, result in zip(images, expected, strict=True):
            assert_same(remapper(image), result)


@pytest.mark.parametrize("kept_bytes", [0, 100_000, 400_000, 1 << 30])
def test_geometry_stays_within_its_memory(kept_bytes: int) -> None:
    remapper = Remapper(FRAME, SPHERE, rotation(2), kept_bytes=kept_bytes)
    with thread_pool(2) as pool:
        remapper(noise(FRAME))
        remapper._executor = pool
        remapper(noise(FRAME))
    assert kept(remapper) <= kept_bytes
    if kept_bytes > 10_000_000:
        assert kept(remapper) > 8 * 0.4 * math.prod(SPHERE.size)
    elif kept_bytes:
        assert kept(remapper) > kept_bytes - 64 * 1024 * 8  # there is no room for one more tile


def kept(remapper: Remapper) -> int:
    found = [positions for positions in remapper._kept.values() if positions is not None]
    return sum(positions.u.nbytes + positions.v.nbytes for positions in found)


@pytest.mark.parametrize("heights", [(100, 64), (64, 100), (3, 300), (300, 3), (100, 65, 7)])
def test_bands_of_other_heights_find_geometry_of_their_own(heights: tuple[int, ...]) -> None:
    """A band may begin where another one did that was lower or higher."""
    image = noise(FRAME)
    expected = remap(image, FRAME, SPHERE)
    remapper = Remapper(FRAME, SPHERE, kept_bytes=1 << 30)
    for rows in heights:
        pixels = np.concatenate([band.pixels for band in remapper.bands(image, rows)])
        np.testing.assert_array_equal(pixels, expected[0])
        assert_same(remapper(image), expected)


@pytest.mark.parametrize("rows", [0, -5])
def test_bands_without_rows_are_refused(rows: int) -> None:
    with pytest.raises(UsageError, match="rows"):
        next(iter(Remapper(FRAME, SPHERE).bands(noise(FRAME), rows)))


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("kept_bytes", [0, 500_000])
@every_pair
def test_threads_change_no_byte(pair: tuple[Projection, Projection], threads: int, kept_bytes: int) -> None:
    source, target = pair
    image = noise(source)
    expected = remap(image, source, target, rotation(3))
    with thread_pool(threads) as pool:
        remapper = Remapper(source, target, rotation(3), executor=pool, kept_bytes=kept_bytes)
        for _ in range(2):
            assert_same(remapper(image), expected)
        bands = list(remapper.bands(image, 40))
    assert_same(
        (np.concatenate([band.pixels for band in bands]), np.concatenate([band.weight for band in bands])), expected
    )


@pytest.mark.parametrize("room", [2 * 66 * 514 * 8 + 1000, 1 << 30])
def test_one_remapper_serves_several_frames_at_once(room: int) -> None:
    """Frames overlap: several threads ask the same object, and its memory is counted once."""
    images = [noise(FRAME, seed=seed) for seed in range(6)]
    expected = [remap(image, FRAME, SPHERE, rotation(4)) for image in images]
    remapper = Remapper(FRAME, SPHERE, rotation(4), kept_bytes=room)
    with ThreadPoolExecutor(4) as pool:
        for found, result in zip(pool.map(remapper, images), expected, strict=True):
            assert_same(found, result)
    assert kept(remapper) <= room
    assert remapper._room == room - kept(remapper)


def test_abandoned_bands_leave_the_remapper_usable() -> None:
    image = noise(FRAME)
    with thread_pool(2) as pool:
        remapper = Remapper(FRAME, SPHERE, executor=pool, kept_bytes=1 << 20)
        bands = remapper.bands(image, 10)
        next(bands)
        bands.close()  # type: ignore[attr-defined]
        assert_same(remapper(image), remap(image, FRAME, SPHERE))


@every_dtype
@every_interpolation
def test_channels_are_resampled_each_for_itself(interpolation: Interpolation, dtype: Any) -> None:
    """Grey (h, w), (h, w, 1) and three channels agree, and keep their shape and type."""
    image = noise(FRAME, dtype)
    colour, weight = remap(image, FRAME, VIEW, rotation(5), interpolation)
    assert colour.shape == (150, 240, 3)
    assert colour.dtype == dtype
    for k in range(3):
        grey, same = remap(image[..., k], FRAME, VIEW, rotation(5), interpolation)
        single, _ = remap(image[..., k : k + 1], FRAME, VIEW, rotation(5), interpolation)
        assert grey.shape == (150, 240)
        assert single.shape == (150, 240, 1)
        np.testing.assert_array_equal(grey, single[..., 0])
        np.testing.assert_array_equal(weight, same)
        # sums of products are rounded in another order where texels are packed
        np.testing.assert_allclose(
            grey.astype(float),
            colour[..., k],
            rtol=1e-3 if dtype is np.float16 else 1e-5,
            atol=1.01 if dtype in (np.uint8, np.uint16) else 1e-4,
        )
        assert np.mean(grey != colour[..., k]) < 0.01


@every_dtype
@every_interpolation
@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize("target", [VIEW, fisheye(60)], ids=["finer", "coarser"])
def test_the_colour_of_what_is_transparent_never_bleeds(
    target: Projection, channels: int, interpolation: Interpolation, dtype: Any
) -> None:
    """Whatever colour stands under alpha 0, the result is the same, and what is opaque keeps its own to the edge."""
    top = np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1
    image = np.zeros((300, 600, channels), dtype)
    image[:, :300, :-1], image[:, :300, -1] = top // 2 if top > 1 else 0.5, top
    other = image.copy()
    other[:, 300:, :-1] = top
    one, weight = remap(image, SPHERE, target, None, interpolation)
    two, _ = remap(other, SPHERE, target, None, interpolation)
    np.testing.assert_array_equal(one, two)
    alpha = one[..., -1] / top
    assert 0.3 < alpha[weight > 0].mean() < 0.7
    solid = one[alpha > 0.1][:, :-1].astype(float)
    np.testing.assert_allclose(solid, image[0, 0, 0], rtol=2e-3, atol=0.51 if top > 1 else 0)


@every_interpolation
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_not_even_infinities_bleed_from_what_is_transparent(interpolation: Interpolation, dtype: Any) -> None:
    """Programs that divide colours by alpha leave infinities and NaN where it is zero."""
    image = np.full((300, 600, 4), 0.5, dtype)
    image[:, 300:, -1] = 0
    clean, _ = remap(image, SPHERE, VIEW, None, interpolation)
    image[:, 300:, :-1] = np.resize(np.array([np.inf, np.nan, -np.inf], dtype), (300, 300, 3))
    spoilt, _ = remap(image, SPHERE, VIEW, None, interpolation)
    np.testing.assert_array_equal(spoilt, clean)
    assert np.isfinite(clean).all()


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_colours_under_alpha_are_not_multiplied_by_it(interpolation: Interpolation) -> None:
    image = np.empty((300, 600, 4), np.uint8)
    image[...] = [200, 100, 50, 128]
    result, weight = remap(image, SPHERE, VIEW, rotation(1), interpolation)
    np.testing.assert_array_equal(result[weight > 0], np.broadcast_to([200, 100, 50, 128], (int(weight.sum()), 4)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_black_and_white_average_to_a_middle_of_light_or_of_codes(channels: int, dtype: Any) -> None:
    """A fine checker seen from afar: 188 in linear light, 128 by its codes; alpha is linear anyway."""
    source, target = (
        Equirectangular((1024, 512)),
        Camera(Perspective(10.0), (8, 8), (3.5, 3.5), half_fov=math.radians(40)),
    )
    top = np.iinfo(dtype).max
    image = np.zeros((512, 1024, channels), dtype)
    image[::2, ::2] = image[1::2, 1::2] = top
    if channels in (2, 4):
        image[..., -1] = top
    for linear_light, expected in (
        (False, top / 2),
        (True, float(encoded_from_linear(np.full((1, 1), 0.5, np.float32), dtype)[0, 0])),
    ):
        result, _ = remap(image, source, target, None, "linear", linear_light=linear_light)
        middle = result[2:6, 2:6].astype(float)
        colours = middle[..., : channels - (channels in (2, 4))]
        assert abs(colours.mean() - expected) < 0.006 * top
        assert np.abs(colours - expected).max() < 0.02 * top
        if channels in (2, 4):
            np.testing.assert_array_equal(middle[..., -1], top)


@pytest.mark.parametrize("linear_light", [True, False])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_floats_are_linear_light_already(dtype: Any, linear_light: bool) -> None:
    image = noise(FRAME, dtype)
    assert_same(
        remap(image, FRAME, VIEW, linear_light=linear_light), remap(image, FRAME, VIEW, linear_light=not linear_light)
    )


@every_interpolation
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_every_code_survives_linear_light(interpolation: Interpolation, dtype: Any) -> None:
    codes = np.linspace(0, np.iinfo(dtype).max, 256).astype(dtype)
    image = np.broadcast_to(codes[:, None, None], (256, 512, 3)).copy()
    sphere = Equirectangular((512, 256))
    result, _ = remap(image, sphere, sphere, None, interpolation, linear_light=True)
    np.testing.assert_allclose(result.astype(int), image, rtol=0, atol=0 if dtype is np.uint8 else 1)


@every_interpolation
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_light_beyond_white_is_kept(interpolation: Interpolation, dtype: Any) -> None:
    image = np.full((300, 600, 3), 0.25, dtype)
    image[140:160, 290:310] = 40000
    result, _ = remap(image, SPHERE, VIEW, None, interpolation)
    assert result.dtype == dtype
    assert np.isfinite(result).all()
    assert result.max() > 39000
    np.testing.assert_allclose(result[:20].astype(float), 0.25, rtol=1e-3)


@every_interpolation
def test_half_floats_end_at_their_largest_number(interpolation: Interpolation) -> None:
    """Cubic kernels overshoot: beside 65504, the largest half float, nothing becomes infinite."""
    image = np.zeros((300, 600, 3), np.float16)
    image[:, 300:] = 65504
    result, _ = remap(image, SPHERE, VIEW, None, interpolation)
    assert np.isfinite(result).all()
    assert result.max() == 65504
    image[150, 450] = np.inf
    assert np.isinf(remap(image, SPHERE, SPHERE, None, interpolation)[0]).any()


@pytest.mark.parametrize("target", [VIEW, fisheye(60), SPHERE], ids=["finer", "coarser", "same"])
@every_interpolation
@pytest.mark.parametrize("channels", [3, 4])
def test_infinities_and_nan_in_a_picture_harm_their_neighbours_only(
    channels: int, interpolation: Interpolation, target: Projection
) -> None:
    image = noise(SPHERE, np.float32, (channels,))
    spoilt = image.copy()
    spoilt[150, 300, 0], spoilt[152, 310, 1], spoilt[140, 305, 2] = np.inf, -np.inf, np.nan
    good, _ = remap(image, SPHERE, target, None, interpolation)
    result, _ = remap(spoilt, SPHERE, target, None, interpolation)
    assert np.isfinite(good).all()
    harmed = ~np.isclose(good, result).all(-1)
    rows, columns = np.nonzero(harmed)
    assert harmed.sum() < 3 * 14**2
    assert harmed.any() or target.size == (60, 60)
    if harmed.any():
        assert np.abs(rows - (target.size[1] - 1) / 2).max() < 24
        assert np.abs(columns - (target.size[0] - 1) / 2).max() < 24


ARRAYS: dict[str, Any] = {
    "a slice": lambda image: np.repeat(np.repeat(image, 2, 0), 3, 1)[::2, ::3],
    "flipped": lambda image: np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1],
    "Fortran order": np.asfortranarray,
    "other order of channels": lambda image: np.ascontiguousarray(image[..., ::-1])[..., ::-1],
    "planes": lambda image: np.moveaxis(np.ascontiguousarray(np.moveaxis(image, -1, 0)), 0, -1),
    "part of a larger picture": lambda image: np.pad(image, [(2, 3), (1, 4), (0, 0)])[2:-3, 1:-4],
    "fewer channels of more": lambda image: np.concatenate([image, image[..., :1]], -1)[..., :-1],
}


@pytest.mark.parametrize("layout", ARRAYS)
@every_dtype
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_any_layout_of_the_array_is_the_same_picture(channels: int, dtype: Any, layout: str) -> None:
    image = noise(FRAME, dtype, (channels,))
    same = ARRAYS[layout](image)
    np.testing.assert_array_equal(same, image)
    assert_same(remap(same, FRAME, VIEW), remap(image, FRAME, VIEW))


@every_dtype
@every_pair
def test_the_picture_given_is_left_alone(pair: tuple[Projection, Projection], dtype: Any) -> None:
    source, target = pair
    image = noise(source, dtype)
    before = image.tobytes()
    image.flags.writeable = False
    remap(image, source, target)
    assert image.tobytes() == before


class Own:
    """A projection of a user's own: plate carree of the front, 2 px a degree; only size, project and unproject."""

    size = (240, 160)

    def project(self, rays: ArrayLike) -> FloatArray:
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        lon, lat = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(-y, np.hypot(x, z)))
        pixels = np.stack([119.5 + 2 * lon, 79.5 - 2 * lat], -1)
        return np.where((np.abs(lon) <= 60)[..., None], pixels, np.nan)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        lon, lat = np.radians((u - 119.5) / 2), np.radians((79.5 - v) / 2)
        return np.stack([np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)], -1)


def test_a_projection_of_a_users_own_is_as_good_as_ours() -> None:
    """The same window by our surface: source or target, the pictures agree."""
    ours = Equirectangular(Own.size, (-math.pi / 3, math.pi / 3), (-math.radians(40), math.radians(40)))
    image, panorama = noise(ours), noise(SPHERE)
    for seen_by_own, seen_by_ours in (
        (remap(image, Own(), FRAME, rotation(0)), remap(image, ours, FRAME, rotation(0))),
        (remap(panorama, SPHERE, Own(), rotation(0)), remap(panorama, SPHERE, ours, rotation(0))),
    ):
        assert np.mean(seen_by_own[1] != seen_by_ours[1]) < 1e-3
        seen = (seen_by_own[1] > 0) & (seen_by_ours[1] > 0)
        assert seen.any()
        apart = np.abs(seen_by_own[0][seen].astype(int) - seen_by_ours[0][seen])
        assert apart.max() <= 2
        assert np.mean(apart > 0) < 0.01


@pytest.mark.parametrize("name", SURFACES)
def test_every_surface_there_and_back(name: str) -> None:
    """A smooth picture of each surface, seen by another and brought back, is the picture."""
    surface, between = SURFACES[name], Equirectangular((1200, 600))
    v, u = np.mgrid[: surface.size[1], : surface.size[0]].astype(float)
    rays = surface.unproject(np.stack([u, v], -1))
    light = np.nan_to_num(0.5 + 0.2 * rays[..., :1] + 0.2 * rays[..., 1:2] * rays[..., 2:]).astype(np.float32)
    turn = rotation(6)
    there, weight = remap(light, surface, between, turn)
    back, again = remap(there, between, surface, turn.T)
    clear = minimum_filter(weight, 9, mode=["nearest", "wrap"])  # no kernel and no footprint reaches an edge
    covered, _ = remap(clear, between, surface, turn.T, "linear", antialias=False)
    sure = (again > 0) & (covered == 1) & np.isfinite(rays[..., 0])
    assert sure.sum() > 0.5 * np.isfinite(rays[..., 0]).sum()
    np.testing.assert_allclose(back[sure], light[sure], rtol=0, atol=4e-3)


BAD_PICTURES: dict[str, Any] = {
    "too wide": np.zeros((260, 261, 3), np.uint8),
    "too low": np.zeros((259, 260, 3), np.uint8),
    "empty": np.zeros((0, 0, 3), np.uint8),
    "five channels": np.zeros((260, 260, 5), np.uint8),
    "no channel": np.zeros((260, 260, 0), np.uint8),
    "signed": np.zeros((260, 260, 3), np.int16),
    "32 bits": np.zeros((260, 260, 3), np.uint32),
    "double": np.zeros((260, 260, 3), np.float64),
    "yes and no": np.zeros((260, 260, 3), bool),
    "complex": np.zeros((260, 260), np.complex64),
    "bytes of another machine": np.zeros((260, 260, 3), np.dtype(np.uint16).newbyteorder()),
    "a line": np.zeros(260, np.uint8),
    "a number": np.zeros((), np.uint8),
    "several frames": np.zeros((260, 260, 3, 2), np.uint8),
}


@pytest.mark.parametrize("name", BAD_PICTURES)
@pytest.mark.parametrize("way", ["call", "bands"])
def test_what_is_no_picture_of_the_source_is_refused(name: str, way: str) -> None:
    remapper = Remapper(FRAME, SPHERE)
    with pytest.raises(UsageError, match="picture"):
        if way == "call":
            remapper(BAD_PICTURES[name])
        else:
            list(remapper.bands(BAD_PICTURES[name]))


@pytest.mark.parametrize(
    "turn", [np.full((3, 3), np.nan), np.diag([1.0, 1.0, -1.0]), np.eye(4), 1.01 * np.eye(3), np.zeros((3, 3))]
)
def test_what_is_no_rotation_is_refused(turn: NDArray[Any]) -> None:
    with pytest.raises(UsageError, match="rotation"):
        Remapper(FRAME, SPHERE, turn)


def test_an_unknown_interpolation_is_refused_before_any_frame() -> None:
    with pytest.raises(UsageError, match="nearest, linear, cubic, lanczos3"):
        Remapper(FRAME, SPHERE, interpolation="bicubic")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 7), (7, 1), (3, 3)])
@every_interpolation
def test_the_smallest_pictures(size: tuple[int, int], interpolation: Interpolation) -> None:
    """Smaller than a kernel and its border, as source and as target."""
    tiny = Camera(Perspective(2.0), size, ((size[0] - 1) / 2, (size[1] - 1) / 2), half_fov=math.radians(70))
    for dtype in (np.uint8, np.float32):
        image = np.full((size[1], size[0], 3), 77, dtype)
        result, weight = remap(image, tiny, SPHERE, None, interpolation)
        assert weight.any()
        np.testing.assert_allclose(result[weight > 0], 77, rtol=1e-5)
        small, seen = remap(np.full((300, 600, 3), 55, dtype), SPHERE, tiny, None, interpolation)
        assert seen.all()
        np.testing.assert_allclose(small, 55, rtol=1e-5)


@pytest.mark.parametrize("width", [2, 4, 6])
@every_interpolation
def test_the_smallest_panoramas(width: int, interpolation: Interpolation) -> None:
    """Their border of four pixels goes round them more than once."""
    source = Equirectangular((width, width // 2))
    result, weight = remap(np.full((width // 2, width, 3), 99, np.uint8), source, FRAME, rotation(0), interpolation)
    assert (result[weight > 0] == 99).all()
    coarse, _ = remap(np.full((300, 600, 3), 99, np.uint8), SPHERE, source, rotation(0), interpolation)
    assert (coarse == 99).all()


OFF_PX = {"linear": 0.003, "cubic": 0.0195, "lanczos3": 0.0205}  # that a ramp is bent by


@every_interpolation
@pytest.mark.parametrize("channels", [1, 3])
def test_a_target_of_70000_columns(channels: int, interpolation: Interpolation) -> None:
    """Columns far beyond 32767 and 65535 are where they belong: each shows the direction that it stands for."""
    target = Equirectangular((70_000, 6), (-math.pi, math.pi), (-0.02, 0.02))
    lon = (np.arange(2000) + 0.5) / 2000 * 2 * math.pi - math.pi
    light = np.broadcast_to(np.sin(3 * lon)[None, :, None], (1000, 2000, channels)).astype(np.float32)
    result, weight = remap(np.ascontiguousarray(light), Equirectangular((2000, 1000)), target, None, interpolation)
    assert weight.all()
    fine = (np.arange(70_000) + 0.5) / 70_000 * 2 * math.pi - math.pi
    np.testing.assert_allclose(
        result[3, :, 0],
        np.sin(3 * fine),
        rtol=0,
        atol=5e-3 if interpolation == "nearest" else OFF_PX[interpolation] * 0.0095,
    )
    np.testing.assert_allclose(result[0], result[5], rtol=0, atol=1e-6)


@every_interpolation
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_source_of_40000_columns(dtype: Any, interpolation: Interpolation) -> None:
    source = Equirectangular((40_000, 200), (-math.pi, math.pi), (-0.01, 0.01))
    codes = (np.arange(40_000) % 200 + 20).astype(dtype)
    image = np.broadcast_to(codes[None, :, None], (200, 40_000, 3)).copy()
    for lon in (-3.1, 0.5, 3.1):
        step = 2 * math.pi / 40_000
        left = math.floor((lon + math.pi) / step)
        window = Equirectangular((300, 20), (left * step - math.pi, (left + 300) * step - math.pi), (-0.005, 0.005))
        result, weight = remap(image, source, window, None, interpolation, antialias=False)
        expected = codes[np.arange(left, left + 300) % 40_000]
        assert weight.all()
        np.testing.assert_allclose(result[10, :, 0].astype(int), expected, rtol=0, atol=1)
