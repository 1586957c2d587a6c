"""Targets coarser than their source: as good as averaging over every pixel's area, wherever on the sphere."""

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fullsphere.model.camera import Camera, Projection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import INTERPOLATIONS, Interpolation, remap
from fullsphere.model.surface import Cylindrical, Equirectangular
from laws import fisheye, pixel_rays, rotation, smooth_light

AVERAGING = INTERPOLATIONS[1:]
every_interpolation = pytest.mark.parametrize("interpolation", AVERAGING)
every_zoom = pytest.mark.parametrize(
    ("times", "interpolation"),
    [*itertools.product([4.0], AVERAGING), (2.5, "linear"), (2.5, "cubic"), (10.0, "lanczos3")],
)
SUPER = 16  # points along a side of a target pixel, for the average over its area

Scene = Callable[[FloatArray], FloatArray]


def view(side: int, focal: float) -> Camera:
    """A perspective picture, seen to its corners."""
    return Camera(Perspective(focal), (side, side), ((side - 1) / 2,) * 2, half_fov=math.atan(0.75 * side / focal))


def sub_pixels(projection: Projection, count: int) -> FloatArray:
    """Pixels (H, W, count, count, 2) spread evenly over the square of each pixel of a picture."""
    offsets = (np.arange(count) + 0.5) / count - 0.5
    width, height = projection.size
    u = np.arange(width)[None, :, None, None] + offsets[None, None, None, :]
    v = np.arange(height)[:, None, None, None] + offsets[None, None, :, None]
    return np.stack(np.broadcast_arrays(u, v), -1)


def photographed(scene: Scene, projection: Projection, count: int = 4) -> NDArray[np.float32]:
    """What a camera with square pixels takes of a scene: the mean of `count` x `count` rays of each pixel."""
    light = scene(projection.unproject(sub_pixels(projection, count)))
    return np.asarray(light.mean((2, 3))[..., None], np.float32)


def area_exact(
    image: NDArray[Any], source: Projection, target: Projection, turn: FloatArray, wraps: bool = False
) -> FloatArray:
    """The source, linear between its pixels, averaged over 16 x 16 points of each target pixel."""
    pixels = source.project(target.unproject(sub_pixels(target, SUPER)) @ turn)
    if wraps:
        image, pixels = np.pad(image, [(0, 0), (2, 2), (0, 0)], mode="wrap"), pixels + np.array([2, 0])
    places = [pixels[..., 1], pixels[..., 0]]
    values = map_coordinates(image[..., 0].astype(float), places, order=1, mode="nearest")
    return np.asarray(values.mean((2, 3)))


def decibels(found: NDArray[Any], truth: NDArray[Any]) -> float:
    return float(-10 * np.log10(np.mean((found - truth) ** 2)))


def random_waves(cycles: float, seed: int = 0, count: int = 10) -> Scene:
    """A scene of plane waves of up to `cycles` a radian, 0..1 about."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(count, 3))
    waves *= (2 * math.pi * cycles * rng.uniform(0.1, 1, count) / np.linalg.norm(waves, axis=1))[:, None]
    phases = rng.uniform(0, 2 * math.pi, count)

    def scene(rays: FloatArray) -> FloatArray:
        light = np.zeros(rays.shape[:-1])
        for wave, phase in zip(waves, phases, strict=True):
            light += np.sin(rays @ wave + phase)
        return 0.5 + 0.25 * light / math.sqrt(count / 2)

    return scene


def zone_plate(cycles: float) -> Scene:
    """Rings about the axis, ever finer: at tan(theta) = 0.5 there are `cycles` a radian."""
    return lambda rays: (
        0.5 + 0.5 * np.cos(2 * math.pi * cycles * (rays[..., 0] ** 2 + rays[..., 1] ** 2) / rays[..., 2] ** 2)
    )


SCENES: dict[str, Callable[[float], Scene]] = {"waves": random_waves, "zone plate": zone_plate}


@pytest.mark.parametrize("scene", SCENES)
@every_zoom
def test_coarser_by_a_factor_is_as_good_as_the_average_over_areas(
    interpolation: Interpolation, times: float, scene: str
) -> None:
    """The source resolves twice as much as the target can show; both are judged by the target taken of the scene."""
    source, target, turn, image, truth = zoomed_out(scene, times)
    ours, weight = remap(image, source, target, turn, interpolation)
    reference = area_exact(image, source, target, turn)
    assert (weight == 1).all()
    assert decibels(ours, truth) > decibels(reference, truth[..., 0]) - 1
    aliased, _ = remap(image, source, target, turn, interpolation, antialias=False)
    assert decibels(ours, truth) > decibels(aliased, truth) + 10


@cache
def zoomed_out(scene: str, times: float) -> tuple[Camera, Camera, FloatArray, NDArray[np.float32], NDArray[np.float32]]:
    """Two views, one `times` coarser, the rotation between them, and photographs of a scene by both."""
    source, target = view(180, 180.0), view(int(140 / times), 180 / times)
    light = SCENES[scene](0.8 * 180 / times)
    turn = np.eye(3) if scene == "zone plate" else rotation_by_degrees(3, -2, 7)
    return source, target, turn, photographed(light, source), photographed(lambda rays: light(rays @ turn), target, 12)


def rotation_by_degrees(yaw: float, pitch: float, roll: float) -> FloatArray:
    a, b, c = np.radians([yaw, pitch, roll])
    about_y = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    return np.asarray(about_y @ about_x @ about_z)


@every_zoom
def test_noise_is_averaged_away_as_much_as_over_areas(interpolation: Interpolation, times: float) -> None:
    """White noise has everything to alias: what is left of it is what the mean over a target pixel leaves."""
    side = 240
    source, target = view(side, side), view(int(0.8 * side / times), side / times)
    image = np.random.default_rng(0).random((side, side, 1)).astype(np.float32)
    ours, _ = remap(image, source, target, None, interpolation)
    left, least = float(ours.std()), float(area_exact(image, source, target, np.eye(3)).std())
    assert 0.8 * least < left < 1.35 * least
    assert ours.mean() == pytest.approx(image.mean(), abs=0.01)
    aliased, _ = remap(image, source, target, None, interpolation, antialias=False)
    assert left < 0.75 * float(aliased.std())


WHERE: dict[str, tuple[float, float]] = {  # yaw and pitch of the target on a whole sphere
    "front": (0.0, 0.0),
    "seam": (180.0, 0.0),
    "zenith": (0.0, 90.0),
    "nadir": (40.0, -90.0),
    "near a pole": (170.0, 78.0),
}
SPHERE = Equirectangular((600, 300))


@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize(("times", "interpolation"), [(2.5, "cubic"), (6.0, "linear"), (6.0, "lanczos3")])
def test_a_sphere_has_neither_seam_nor_poles(interpolation: Interpolation, times: float, where: str) -> None:
    """Footprints reach over the seam and round the poles, where a row of the source shrinks to a point."""
    target, turn = view(24, 600 / (2 * math.pi) / times), rotation_by_degrees(*WHERE[where], 0).T
    light, image = waves_on_a_sphere(times)
    truth = photographed(lambda rays: light(rays @ turn), target, 8)
    ours, weight = remap(image, SPHERE, target, turn, interpolation)
    assert (weight == 1).all()
    # as good as the average over areas; where footprints bend round a pole, to a thousandth of the scene's contrast
    best = decibels(area_exact(image, SPHERE, target, turn, wraps=True), truth[..., 0])
    assert decibels(ours, truth) > min(best - 1, 50)
    assert np.abs(ours - truth).max() < 0.02


@cache
def waves_on_a_sphere(times: float) -> tuple[Scene, NDArray[np.float32]]:
    light = random_waves(0.35 * 600 / (2 * math.pi) / times)
    return light, photographed(light, SPHERE, 3)


@pytest.mark.parametrize("layout", ["3x2", "cross"])
@pytest.mark.parametrize(("times", "interpolation"), [(1.5, "cubic"), (4.0, "linear"), (4.0, "lanczos3")])
def test_edges_of_a_cube_do_not_show(interpolation: Interpolation, times: float, layout: Any) -> None:
    """A view of an edge or a corner of the cube is as good as one of the middle of a face."""
    cube, light, image = waves_on_a_cube(layout, times)
    target = view(24, 60 / times)
    for yaw, pitch in ((0.0, 0.0), (45.0, 0.0), (45.0, 35.26), (0.0, 45.0), (180.0, -45.0)):
        turn = rotation_by_degrees(yaw, pitch, 0).T
        ours, weight = remap(image, cube, target, turn, interpolation)
        assert (weight == 1).all()
        truth = photographed(lambda rays, turn=turn: light(rays @ turn), target, 8)  # type: ignore[misc]
        assert decibels(ours, truth) > 38
        assert np.abs(ours - truth).max() < 0.05


@cache
def waves_on_a_cube(layout: Any, times: float) -> tuple[CubeMap, Scene, NDArray[np.float32]]:
    cube, light = CubeMap(120, layout), random_waves(0.3 * 60 / times)
    return cube, light, np.nan_to_num(photographed(light, cube, 3))


SOURCES: dict[str, tuple[Projection, Projection]] = {
    "fisheye": (fisheye(500), Equirectangular((160, 80))),
    "sphere": (Equirectangular((800, 400)), fisheye(90)),
    "cylinder": (Cylindrical((900, 200)), fisheye(90)),
    "cube": (CubeMap(150), Equirectangular((120, 60))),
    "view": (view(300, 200.0), view(50, 35.0)),
    "ellipse": (fisheye(500, 95, 0.7), fisheye(60, 90, 1.2)),
}


@pytest.mark.parametrize("name", SOURCES)
@pytest.mark.parametrize(("dtype", "channels"), [(np.uint8, 3), (np.uint16, 1), (np.uint8, 4)])
@every_interpolation
def test_a_constant_stays_constant(interpolation: Interpolation, dtype: Any, channels: int, name: str) -> None:
    """To the last pixel of a rim or border, with nothing of the dark beyond it."""
    source, target = SOURCES[name]
    seen = np.isfinite(pixel_rays(source)[..., :1])
    image = np.where(seen, np.full(channels, 201, dtype), np.zeros(channels, dtype))
    result, weight = remap(image, source, target, rotation(1), interpolation)
    assert weight.mean() > 0.05
    np.testing.assert_allclose(result[weight > 0], 201, rtol=0, atol=0)
    assert not result[weight == 0].any()


@every_interpolation
def test_a_rim_is_no_darker_than_what_is_beside_it(interpolation: Interpolation) -> None:
    """Whatever stands beyond the rim, dark or light, the coarse picture is the same."""
    source, target = fisheye(700), Equirectangular((200, 100))
    seen = np.isfinite(pixel_rays(source)[..., :1])
    scene = np.nan_to_num(smooth_light(pixel_rays(source))).astype(np.float32)
    results = [
        remap(np.where(seen, scene, np.float32(beyond)), source, target, rotation(2), interpolation)[0]
        for beyond in (0, 50)
    ]
    np.testing.assert_array_equal(results[0], results[1])
    _, weight = remap(scene, source, target, rotation(2), interpolation)
    truth = smooth_light(pixel_rays(target) @ rotation(2))
    np.testing.assert_allclose(results[0][weight > 0], truth[weight > 0], rtol=0, atol=0.02)


@every_interpolation
def test_nothing_jumps_where_averaging_begins(interpolation: Interpolation) -> None:
    """A zoom through 1.2 source pixels, the width from which a footprint is averaged: the picture follows evenly."""
    source = view(200, 200.0)
    image = np.random.default_rng(0).random((200, 200, 1)).astype(np.float32)
    zooms = np.array([1.19, 1.1925, 1.195, 1.1975, 1.2, 1.2025, 1.205, 1.2075, 1.21])
    frames = [remap(image, source, view(61, 200 / zoom), None, interpolation)[0] for zoom in zooms]
    # near the axis a zoom moves nothing: the change there is that of the averaging
    changes = [float(np.abs(a - b)[28:33, 28:33].max()) for a, b in itertools.pairwise(frames)]
    assert max(changes) < 0.05
    assert max(changes) < 6 * float(np.median(changes))


@pytest.mark.parametrize("across", [1.0, 6.0])
@every_interpolation
def test_a_footprint_may_be_long_one_way_and_short_the_other(interpolation: Interpolation, across: float) -> None:
    """Six times coarser one way only: detail along the other stays."""
    source = Equirectangular((600, 600), (-0.5, 0.5), (-0.5, 0.5))
    size = (int(600 / across), int(600 * across / 6))
    target = Equirectangular(size, (-0.5, 0.5), (-0.5, 0.5))
    image = np.random.default_rng(0).random((600, 600, 1)).astype(np.float32)
    result, _ = remap(image, source, target, None, interpolation)
    boxes = image.reshape(size[1], 600 // size[1], size[0], 600 // size[0]).mean((1, 3))
    assert float(result.std()) == pytest.approx(float(boxes.std()), rel=0.3)
    assert decibels(result[..., 0], boxes) > 20


@pytest.mark.parametrize("pair", ["fisheye to sphere", "sphere to view", "cube to view"])
@pytest.mark.parametrize(("dtype", "channels"), [(np.uint8, 3), (np.float32, 3)])
def test_a_finer_target_of_linear_needs_no_averaging(pair: str, dtype: Any, channels: int) -> None:
    """Bit for bit the same with and without."""
    pairs: dict[str, tuple[Projection, Projection]] = {
        "fisheye to sphere": (fisheye(300), Equirectangular((1400, 700))),
        "sphere to view": (Equirectangular((300, 150)), view(150, 140.0)),
        "cube to view": (CubeMap(70), view(150, 140.0)),
    }
    source, target = pairs[pair]
    image = (np.random.default_rng(0).random((source.size[1], source.size[0], channels)) * 255).astype(dtype)
    on, off = (remap(image, source, target, rotation(3), "linear", antialias=antialias) for antialias in (True, False))
    if pair == "sphere to view":  # near a pole a row of the sphere is finer than any view
        high = np.abs((pixel_rays(target) @ rotation(3))[..., 1]) > 0.7
        on[0][high] = off[0][high] = 0
    np.testing.assert_array_equal(on[0], off[0])
    np.testing.assert_array_equal(on[1], off[1])


@pytest.mark.parametrize("interpolation", ["cubic", "lanczos3"])
def test_a_finer_target_gets_the_contrast_that_larger_pixels_took(interpolation: Interpolation) -> None:
    """The truth are the target's own finer pixels; without `antialias` values are interpolated, and are further off."""
    source, target = view(100, 100.0), view(120, 200.0)
    light = random_waves(0.25 * 100)
    image, truth = photographed(light, source), photographed(light, target)
    on, off = (
        decibels(remap(image, source, target, None, interpolation, antialias=antialias)[0], truth)
        for antialias in (True, False)
    )
    assert on > off + 1


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_nearest_and_antialias_off_take_single_values(interpolation: Interpolation) -> None:
    """A checker of black and white seen from afar stays black and white with the nearest pixel, grey when averaged."""
    source, target = view(400, 400.0), view(40, 41.3)
    image = ((np.indices((400, 400)).sum(0) % 2) * 255).astype(np.uint8)[..., None].repeat(3, -1)
    averaged, _ = remap(image, source, target, None, interpolation)
    single, _ = remap(image, source, target, None, interpolation, antialias=False)
    if interpolation == "nearest":
        assert set(np.unique(averaged)) == {0, 255}
        np.testing.assert_array_equal(averaged, single)
    else:
        assert averaged.std() < 8
        assert single.std() > 40


def test_the_largest_footprints_stay_means() -> None:
    """A thousand source pixels in one of the target: sampled, not read whole, and still a constant's own value."""
    source, target = Equirectangular((4000, 2000)), Equirectangular((4, 2))
    image = np.full((2000, 4000, 3), 90, np.uint8)
    result, _ = remap(image, source, target)
    np.testing.assert_array_equal(result, 90)
    image[:, ::2] = 110
    result, _ = remap(image, source, target)
    assert np.abs(result.astype(int) - 100).max() <= 10
