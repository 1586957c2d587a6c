"""Compiled sampling against slow NumPy twins: every kernel, every kind of sample, points and footprints."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fullsphere.model import sampling_kernels as kernels
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.lens import Equidistant, FloatArray, Perspective
from fullsphere.model.remap import INTERPOLATIONS
from fullsphere.model.source_picture import BORDER, Samples, SourcePicture, source_picture
from fullsphere.model.surface import Cylindrical, Equirectangular
from laws import fisheye

WIDTH, HEIGHT = 37, 29
PLAIN = Camera(Perspective(40.0), (WIDTH, HEIGHT), (18.0, 14.0), half_fov=math.radians(60))
KINDS = (kernels.NEAREST, kernels.LINEAR, kernels.CUBIC, kernels.LANCZOS3)
every_kernel = pytest.mark.parametrize("kind", KINDS, ids=INTERPOLATIONS)
every_place = pytest.mark.parametrize("real", [np.float32, np.float64])
every_picture = pytest.mark.parametrize(
    ("dtype", "channels"), [*itertools.product((np.uint8, np.uint16, np.float32), (1, 3)), (np.float16, 3)]
)
LARGEST_STEP = 1.2  # source pixels, up to which a footprint is a point, if nothing else is asked for


def random_picture(dtype: Any, channels: int, width: int = WIDTH, height: int = HEIGHT) -> NDArray[Any]:
    rng = np.random.default_rng(channels)
    if np.dtype(dtype).kind == "u":
        return rng.integers(0, np.iinfo(dtype).max, (height, width, channels), dtype, endpoint=True)
    light: NDArray[Any] = rng.uniform(-1, 3, (height, width, channels)).astype(dtype)
    return light


def ready(image: NDArray[Any], projection: Projection = PLAIN, linear_light: bool = False) -> SourcePicture:
    return source_picture([(0, image)], projection, Samples(image.dtype, image.shape[2], linear_light))


def points(real: type, count: int = 300, seed: int = 0) -> tuple[NDArray[Any], NDArray[Any]]:
    """Positions (1, n) in the bordered picture: random ones, on pixels, next to them, halfway, on the border, NaN."""
    rng = np.random.default_rng(seed)
    hard = [0.0, 1e-7, 1e-3, 0.25, 0.5, 0.75, 0.999, 1 - 1e-6]
    u = rng.uniform(-0.5, WIDTH - 0.5, count)
    v = rng.uniform(-0.5, HEIGHT - 0.5, count)
    pairs = np.array(list(itertools.product(hard, hard)))
    u = np.concatenate([u, 7 + pairs[:, 0], [-0.5, WIDTH - 0.5, -0.5, WIDTH - 0.5, np.nan, 3.0]])
    v = np.concatenate([v, 9 + pairs[:, 1], [-0.5, -0.5, HEIGHT - 0.5, HEIGHT - 0.5, np.nan, 4.0]])
    u[::17], v[::17] = np.nan, np.nan
    return (u + BORDER).astype(real)[None], (v + BORDER).astype(real)[None]


def weights_twin(kind: int, t: float) -> FloatArray:
    """Weights of the taps at t, t - 1, ... from the first tap on, by the formulas of the literature."""
    if kind == kernels.LINEAR:
        return np.array([1 - t, t])
    if kind == kernels.CUBIC:  # Keys 1981
        a, x = -0.6, np.abs(t - np.arange(-1.0, 3.0))
        near, far = (a + 2) * x**3 - (a + 3) * x**2 + 1, a * (x**3 - 5 * x**2 + 8 * x - 4)
        return np.asarray(np.where(x <= 1, near, far))
    x = t - np.arange(-2.0, 4.0)
    weights = np.sinc(x) * np.sinc(x / 3)
    return np.asarray(weights / weights.sum())


def less_curvature(kind: int, weights: FloatArray, t: float, share: float) -> FloatArray:
    """Weights less a share of the second difference, which is read linearly between the pixels."""
    if kind < kernels.CUBIC:
        return weights
    first = len(weights) // 2 - 1  # the tap at or before the position
    taken = weights.copy()
    for tap, part in ((first, 1 - t), (first + 1, t)):
        taken[tap - 1 : tap + 2] -= share * part * np.array([1.0, -2.0, 1.0])
    return taken


def value_twin(picture: FloatArray, kind: int, u: float, v: float, across: float = 0, down: float = 0) -> FloatArray:
    """(c,) of a bordered picture at one position, with the shares of curvature that are taken off."""
    if kind == kernels.NEAREST:
        return np.asarray(picture[math.floor(v + 0.5), math.floor(u + 0.5)], float)
    x, y, reach = math.floor(u), math.floor(v), kernels.TAPS[kind] // 2
    columns = less_curvature(kind, weights_twin(kind, u - x), u - x, across)
    rows = less_curvature(kind, weights_twin(kind, v - y), v - y, down)
    taps = picture[y - reach + 1 : y + reach + 1, x - reach + 1 : x + reach + 1]
    return np.asarray(np.einsum("j,i,jic->c", rows, columns, taps.astype(float)))


def step_twin(before: FloatArray, at: FloatArray, after: FloatArray, around: float) -> FloatArray | None:
    """The shorter of two steps, the short way round; none if both neighbours see nothing."""
    steps = [at - before, after - at]
    for step in steps:
        step[0] -= around * np.floor(step[0] / around + 0.5)
    seen = [step for step in steps if np.isfinite(step).all()]
    return min(seen, key=np.linalg.norm) if seen else None


def pixel_twin(picture: FloatArray, kind: int, near: FloatArray, limits: FloatArray) -> FloatArray:
    """(c,) of the target pixel whose position and those around it are `near` (3, 3, 2), over its footprint."""
    at = near[1, 1]
    x = step_twin(near[1, 0], at, near[1, 2], limits[9])
    y = step_twin(near[0, 1], at, near[2, 1], limits[9])
    x, y = np.zeros(2) if x is None else x, np.zeros(2) if y is None else y
    across, down = (max(0.0, 1 - x[k] ** 2 - y[k] ** 2) / 24 for k in (0, 1))
    largest = math.sqrt(limits[11])
    offsets = []
    for step in (x, y):
        length = float(np.linalg.norm(step))
        if length <= largest:
            offsets.append([0.0])
            continue
        count = min(math.ceil(length), 64)
        wide = math.sqrt(length**2 - largest**2) / length
        offsets.append([((k + 0.5) / count - 0.5) * wide for k in range(count)])
    if len(offsets[0]) == len(offsets[1]) == 1 and max(np.linalg.norm(x), np.linalg.norm(y)) <= largest:
        return value_twin(picture, kind, at[0], at[1], across, down)
    places = [met_twin(at + a * x + b * y, limits) for b in offsets[1] for a in offsets[0]]
    seen = [place for place in places if seen_twin(place, limits)]
    return np.asarray(np.mean([value_twin(picture, kind, s, t, across, down) for s, t in seen or [at]], axis=0))


def met_twin(place: FloatArray, limits: FloatArray) -> FloatArray:
    """Where a place past an edge that is none comes in again: over a pole half a turn further."""
    (s, t), (left, top, right, bottom, meets) = place, limits[:5]
    if meets > 1 and not top <= t <= bottom:
        s, t = s + (right - left) / 2, 2 * (top if t < top else bottom) - t
    return np.array([(s - left) % (right - left) + left if meets > 0 and not left <= s <= right else s, t])


def seen_twin(place: FloatArray, limits: FloatArray) -> bool:
    left, top, right, bottom = limits[:4]
    in_disc = math.hypot(place[0] - limits[5], (place[1] - limits[6]) / limits[7]) <= limits[8]
    return bool(left <= place[0] <= right and top <= place[1] <= bottom and in_disc)


def assert_is_stored(found: NDArray[Any], exact: FloatArray, of: Any, off: float = 2e-6) -> None:
    """Codes are the exact value clipped and rounded, floats the value itself; `off` is the error of reckoning."""
    dtype = np.dtype(of)
    if dtype.kind == "u":
        top = np.iinfo(dtype).max
        assert np.abs(found - np.clip(exact, 0, top)).max() <= 0.5 + off * top
    else:
        rounding = 2.0**-11 if dtype == np.float16 else 0.0
        np.testing.assert_allclose(found.astype(float), exact, rtol=rounding, atol=8 * off)


@every_place
@every_picture
@every_kernel
def test_points_against_the_twin(kind: int, dtype: Any, channels: int, real: type) -> None:
    picture = ready(random_picture(dtype, channels))
    u, v = points(real)
    found = picture.sampled(u, v, kind, (1, u.shape[1]))
    assert found.dtype == dtype
    seen = np.flatnonzero(np.isfinite(u[0]))
    light = picture.bordered[..., :channels]
    exact = np.array([value_twin(light, kind, float(u[0, k]), float(v[0, k])) for k in seen])
    assert_is_stored(found[0, seen], exact, dtype)
    assert not found[0, np.isnan(u[0])].any()
    if kind == kernels.NEAREST:
        np.testing.assert_array_equal(found[0, seen], exact.astype(dtype))


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32])
@every_kernel
def test_colours_are_averaged_by_their_alpha(kind: int, dtype: Any, channels: int) -> None:
    """(sum of weight alpha colour) / (sum of weight alpha), alpha beside it; the twin premultiplies in float64."""
    image = random_picture(dtype, channels)
    image[..., -1] = np.maximum(
        image[..., -1], np.dtype(dtype).type(np.iinfo(dtype).max // 3 if dtype in (np.uint8, np.uint16) else 0.5)
    )
    picture = ready(image)
    u, v = points(np.float32)
    found = picture.sampled(u, v, kind, (1, u.shape[1]))[0].astype(float)
    full = float(np.iinfo(dtype).max) if np.dtype(dtype).kind == "u" else 1.0
    light = np.pad(image.astype(float) / full, [(BORDER, BORDER), (BORDER, BORDER), (0, 0)], mode="edge")
    light[..., :-1] *= light[..., -1:]
    seen = np.flatnonzero(np.isfinite(u[0]))
    exact = np.array([value_twin(light, kind, float(u[0, k]), float(v[0, k])) for k in seen])
    solid = exact[:, -1] > 0.2
    assert solid.mean() > 0.8
    exact[:, :-1] /= exact[:, -1:]
    assert_is_stored(found[seen][solid], exact[solid] * full, dtype, 2e-5)
    assert not found[np.isnan(u[0])].any()


@every_place
def test_linear_against_scipy(real: type) -> None:
    image = random_picture(np.float32, 3)
    u, v = points(real)
    found = ready(image).sampled(u, v, kernels.LINEAR, (1, u.shape[1]))[0]
    seen = np.isfinite(u[0])
    places = [v[0, seen].astype(float) - BORDER, u[0, seen].astype(float) - BORDER]
    twin = np.stack([map_coordinates(image[..., c].astype(float), places, order=1, mode="nearest") for c in range(3)])
    np.testing.assert_allclose(found[seen], twin.T, rtol=0, atol=2e-6)


@pytest.mark.parametrize("kind", KINDS[1:], ids=INTERPOLATIONS[1:])
def test_weights_sum_to_one_at_every_fraction(kind: int) -> None:
    """A constant stays constant, to the rounding of float32, and a ramp a ramp where the kernel promises it."""
    fractions = np.concatenate([np.linspace(0, 1, 4001)[:-1], np.nextafter(1, 0, dtype=np.float64)[None]])
    u = (15 + fractions + BORDER)[None]
    v = np.full_like(u, 11.37 + BORDER)
    ones = ready(np.ones((HEIGHT, WIDTH, 1), np.float32)).sampled(u, v, kind, u.shape)
    np.testing.assert_allclose(ones, 1, rtol=0, atol=1e-6)
    ramp = np.broadcast_to(np.arange(WIDTH, dtype=np.float32)[None, :, None], (HEIGHT, WIDTH, 1))
    off = ready(np.ascontiguousarray(ramp)).sampled(u, v, kind, u.shape)[0, :, 0] - (15 + fractions)
    # The cubic of slope a bends a ramp by (2a + 1) (2 t^3 - 3 t^2 + t), Lanczos-3 by a fiftieth
    assert np.abs(off).max() <= {kernels.LINEAR: 1e-5, kernels.CUBIC: 0.0194, kernels.LANCZOS3: 0.0201}[kind]


@pytest.mark.parametrize("kind", KINDS[1:], ids=INTERPOLATIONS[1:])
@every_picture
def test_on_a_pixel_its_value_comes_back_exactly(kind: int, dtype: Any, channels: int) -> None:
    image = random_picture(dtype, channels)
    v, u = np.mgrid[BORDER : BORDER + HEIGHT, BORDER : BORDER + WIDTH].astype(np.float32)
    found = ready(image).sampled(u, v, kind, u.shape)
    np.testing.assert_allclose(found, image, rtol=0, atol=0 if np.dtype(dtype).kind == "u" else 1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("kind", [kernels.CUBIC, kernels.LANCZOS3], ids=["cubic", "lanczos3"])
def test_overshoot_is_clipped_not_wrapped(kind: int, channels: int, dtype: Any) -> None:
    """Beside an edge from black to white the kernels go past both; no code comes round from the other end."""
    image = np.zeros((HEIGHT, WIDTH, channels), dtype)
    image[:, WIDTH // 2 :] = top = np.iinfo(dtype).max
    u = np.linspace(WIDTH / 2 - 4, WIDTH / 2 + 4, 801, dtype=np.float32)[None] + BORDER
    found = ready(image).sampled(u, np.full_like(u, 12.3 + BORDER), kind, u.shape)[0, :, 0].astype(float)
    exact = [value_twin(np.pad(image, [(4, 4), (4, 4), (0, 0)], mode="edge"), kind, float(x), 16.3)[0] for x in u[0]]
    assert min(exact) < -0.02 * top
    assert max(exact) > 1.02 * top
    assert np.abs(found - np.clip(exact, 0, top)).max() <= 0.5 + 1e-5 * top


@pytest.mark.parametrize("channels", [1, 3])
def test_halves_round_up(channels: int) -> None:
    image = np.zeros((HEIGHT, WIDTH, channels), np.uint8)
    image[:, ::2] = np.arange(10, 10 + HEIGHT)[:, None, None]
    image[:, 1::2] = np.arange(11, 11 + HEIGHT)[:, None, None]
    v, u = np.mgrid[BORDER : BORDER + HEIGHT, BORDER : BORDER + WIDTH - 1].astype(np.float32)
    found = ready(image).sampled(u + np.float32(0.5), v, kernels.LINEAR, u.shape)
    assert (found == np.arange(11, 11 + HEIGHT)[:, None, None]).all()


@pytest.mark.parametrize("kind", KINDS[1:], ids=INTERPOLATIONS[1:])
@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
def test_what_is_no_number_stays_within_reach_of_the_kernel(kind: int, bad: float) -> None:
    """An infinity or a NaN in a floating-point picture spoils what its taps touch, and nothing else."""
    image = random_picture(np.float32, 3)
    spoilt = image.copy()
    spoilt[14, 18, 1] = bad
    u, v = points(np.float32, 2000)
    one, other = (ready(part).sampled(u, v, kind, (1, u.shape[1]))[0] for part in (image, spoilt))
    reach = kernels.TAPS[kind] // 2
    with np.errstate(invalid="ignore"):
        touched = (np.abs(u[0] - BORDER - 18) <= reach) & (np.abs(v[0] - BORDER - 14) <= reach)
    np.testing.assert_array_equal(one[~touched], other[~touched])
    np.testing.assert_array_equal(one[:, [0, 2]], other[:, [0, 2]])
    inner = (np.abs(u[0] - BORDER - 18) < 0.5) & (np.abs(v[0] - BORDER - 14) < 0.5)
    assert inner.any()
    assert not np.isfinite(other[inner, 1]).any()


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@every_kernel
def test_high_dynamic_range_is_kept(kind: int, dtype: Any) -> None:
    """A sun of 30000 beside a shade of 0.01 comes out as itself; nothing is clipped to white."""
    image = np.full((HEIGHT, WIDTH, 3), 0.01, dtype)
    image[10:14, 10:16] = 30000
    u, v = points(np.float32, 900)
    found = ready(image).sampled(u, v, kind, (1, u.shape[1]))[0].astype(float)
    light = np.pad(image.astype(float), [(BORDER, BORDER), (BORDER, BORDER), (0, 0)], mode="edge")
    seen = np.flatnonzero(np.isfinite(u[0]))
    exact = np.array([value_twin(light, kind, float(u[0, k]), float(v[0, k])) for k in seen])
    np.testing.assert_allclose(found[seen], exact, rtol=1e-3 if dtype is np.float16 else 2e-6, atol=0.02)
    assert found.max() > 25000


FOOTPRINTS: dict[
    str, tuple[Projection, FloatArray, tuple[float, float]]
] = {  # steps to the right and down, first place
    "2.5 across, 1.7 down": (PLAIN, np.array([[2.5, 0.2], [-0.3, 1.7]]), (3.3, 4.2)),
    "across only": (PLAIN, np.array([[3.4, 1.0], [-0.1, 0.4]]), (2.0, 5.0)),
    "down only": (PLAIN, np.array([[0.5, 0.1], [1.3, 2.2]]), (2.0, 3.0)),
    "just over the limit": (PLAIN, np.array([[1.21, 0.0], [0.0, 1.21]]), (5.0, 5.0)),
    "finer": (PLAIN, np.array([[0.4, 0.1], [-0.2, 0.7]]), (6.0, 6.0)),
    "finer across only": (PLAIN, np.array([[0.3, 0.0], [0.0, 3.1]]), (6.0, 2.0)),
    "over the picture's border": (PLAIN, np.array([[3.0, 0.0], [0.0, 3.0]]), (-0.4, -0.3)),
    "round a cylinder": (Cylindrical((36, HEIGHT)), np.array([[3.1, 0.4], [0.3, 2.0]]), (20.2, 6.1)),
    "over the poles": (Equirectangular((36, 18)), np.array([[2.7, 0.6], [-0.4, 2.3]]), (22.6, 0.1)),
    "rim of a disc": (fisheye(40), np.array([[3.0, 0.0], [0.0, 2.0]]), (0.0, 9.0)),
    "rim of an ellipse": (fisheye(40, aspect=0.7), np.array([[2.0, 0.0], [0.0, 1.9]]), (0.0, 9.0)),
}


@pytest.mark.parametrize("place", FOOTPRINTS)
@pytest.mark.parametrize(
    ("dtype", "channels", "largest"),
    [(np.uint8, 3, LARGEST_STEP), (np.uint16, 1, LARGEST_STEP), (np.float32, 3, LARGEST_STEP), (np.float32, 3, 2.0)],
)
@pytest.mark.parametrize("kind", KINDS[1:], ids=INTERPOLATIONS[1:])
def test_footprints_against_the_twin(kind: int, dtype: Any, channels: int, largest: float, place: str) -> None:
    projection, steps, first = FOOTPRINTS[place]
    image = random_picture(dtype, channels, *projection.size)
    picture = ready(image, projection)
    picture = picture if largest == LARGEST_STEP else picture.averaged_beyond(largest)
    rows, columns = 7, 9
    v, u = np.mgrid[-1 : rows + 1, -1 : columns + 1].astype(float)
    near = np.stack([u, v], -1) @ steps + first + BORDER
    limits = picture.limits
    if limits[4] > 0:  # in at the other side, as `project` answers
        near[..., 0] = (near[..., 0] - limits[0]) % (limits[2] - limits[0]) + limits[0]
    inside = np.array([seen_twin(at, limits) for at in near.reshape(-1, 2)]).reshape(near.shape[:2])
    near[~inside] = np.nan
    near = near.astype(np.float32).astype(float)
    found = picture.sampled(
        np.ascontiguousarray(near[..., 0], np.float32),
        np.ascontiguousarray(near[..., 1], np.float32),
        kind,
        (rows, columns),
    )
    light = picture.bordered[..., :channels]
    compared = 0
    for j, i in itertools.product(range(rows), range(columns)):
        if not inside[j + 1, i + 1]:
            assert not found[j, i].any()
            continue
        exact = pixel_twin(light, kind, near[j : j + 3, i : i + 3], limits)
        assert_is_stored(found[j, i], exact, dtype, 3e-5)
        compared += 1
    assert compared >= 15


def test_the_rim_is_filled_from_next_to_it() -> None:
    """Every pixel within reach outside the disc takes the value of a pixel of the disc not far from it; others none."""
    rng = np.random.default_rng(0)
    for aspect, radius in itertools.product((0.8, 1.0, 1.3), (9.3, 14.0, 21.7)):
        pixels = rng.random((47, 53, 2)).astype(np.float32)
        u0, v0 = 25.4, 22.7
        filled = pixels.copy()
        kernels.fill_rim(filled, u0, v0, aspect, radius, 4.0)
        y, x = np.mgrid[:47, :53]
        r = np.hypot(x - u0, (y - v0) / aspect)
        untouched = (r <= radius) | (r > radius + 4 + 1e-6)
        np.testing.assert_array_equal(filled[untouched], pixels[untouched])
        for j, i in zip(*np.nonzero((r > radius + 1e-9) & (r < radius + 4 - 1e-9)), strict=True):
            from_y, from_x = np.argwhere((pixels == filled[j, i]).all(-1))[0]
            assert r[from_y, from_x] <= radius + 1e-9 or from_y in (0, 46) or from_x in (0, 52)
            assert math.hypot(from_x - i, from_y - j) <= (4 + 2) * max(1, aspect)


def test_a_disc_larger_than_its_picture_is_no_rim() -> None:
    camera = Camera(Equidistant(100.0), (40, 30), (20.0, 15.0), half_fov=math.radians(80))
    image = random_picture(np.uint8, 3, 40, 30)
    bordered = ready(image, camera).bordered[BORDER:-BORDER, BORDER:-BORDER, :3]
    np.testing.assert_array_equal(bordered, image)
