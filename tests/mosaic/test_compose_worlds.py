"""Panoramas of photographed worlds: what moved, what is hidden or clipped, and the edge of a picture of the sphere."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from turning import frame_of, orientation

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.compose import compose
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.worlds import Scene, environment, furnished_room, panorama, photograph
from laws import fisheye, pixel_rays, smooth_light

CAMERA = fisheye(440)
SURFACE = Equirectangular((800, 400))
RAYS = pixel_rays(SURFACE)
RED = (0.8, 0.02, 0.02)


class Ball(NamedTuple):
    """A ball of plain colour before a scene: its direction (3,), its radius in degrees."""

    behind: Scene
    towards: FloatArray
    radius_deg: float

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        light = self.behind.radiance(rays)
        light[np.asarray(rays) @ self.towards > math.cos(math.radians(self.radius_deg))] = RED
        return light


def direction(lon_deg: float, lat_deg: float = 0.0) -> FloatArray:
    lon, lat = math.radians(lon_deg), math.radians(lat_deg)
    return np.array([math.cos(lat) * math.sin(lon), -math.sin(lat), math.cos(lat) * math.cos(lon)])


@pytest.fixture(scope="module")
def room() -> Scene:
    return environment(furnished_room(texel_mm=8.0), 700)


def shots(
    scenes: Sequence[Scene], rotations: Sequence[FloatArray], exposures_ev: Sequence[float] = (), noise: float = 0.004
) -> Mosaic:
    """One frame of each scene as a camera records it, with what was done to it in the mosaic."""
    exposures = exposures_ev or [0.0] * len(scenes)
    frames = []
    for k, (scene, rotation, ev) in enumerate(zip(scenes, rotations, exposures, strict=True)):
        picture = photograph(scene, CAMERA, rotation, exposure_ev=ev, noise=noise, seed=k)
        frames.append(dataclasses.replace(frame_of(f"frame {k}", picture, rotation), exposure_ev=ev))
    return Mosaic((CAMERA,), tuple(frames), ())


def whole(mosaic: Mosaic) -> NDArray[Any]:
    return np.concatenate([band.rows for band in compose(mosaic, SURFACE, np.float32)])


def looking_around(count: int) -> list[FloatArray]:
    return [orientation(360 * k / count, 12 * (-1) ** k) for k in range(count)]


ARRANGEMENTS: dict[str, list[tuple[float, float, float]]] = {
    "apart": [(60, 0, 7), (100, 20, 7), (140, -20, 7)],
    "small": [(10, -40, 3), (40, -35, 3), (25, -10, 3)],
    "large": [(-90, 10, 14), (-40, -20, 14), (-130, -30, 14)],
    "side by side": [(0, 0, 6), (14, 0, 6), (28, 0, 6)],
    "overlapping": [(90, 5, 8), (97, 5, 8), (104, 5, 8)],
    "at the 360 degree edge": [(180, 10, 6), (165, 0, 6), (195, -10, 6)],
    "at a pole": [(0, 88, 8), (30, 60, 8), (200, 65, 8)],
}


class Found(NamedTuple):
    """The panorama of frames that saw balls, the room without them, both soft, and where each ball was."""

    panorama: NDArray[Any]
    empty: NDArray[Any]
    places: Sequence[tuple[float, float, float]]


@pytest.fixture(
    scope="module",
    params=[
        ("apart", 3),
        ("small", 6),
        ("large", 3),
        ("side by side", 6),
        ("overlapping", 3),
        ("at the 360 degree edge", 6),
        ("at a pole", 3),
    ],
    ids=lambda param: f"{param[0]}, {param[1]} frames",
)
def moved(room: Scene, request: pytest.FixtureRequest) -> Found:
    """Three frames of three or six show the ball, each elsewhere; the others were taken when it was gone."""
    where, count = request.param
    balls: list[Scene] = [Ball(room, direction(lon, lat), radius) for lon, lat, radius in ARRANGEMENTS[where]]
    found = whole(shots(balls + [room] * (count - 3), looking_around(count)))[..., :3]
    return Found(cv2.blur(found, (5, 5)), cv2.blur(panorama(room, SURFACE.size[0]), (5, 5)), ARRANGEMENTS[where])


def test_a_ball_that_moved_is_seen_once_and_whole_or_not_at_all(moved: Found) -> None:
    red = redness(moved)
    shares = []
    for place in moved.places:
        elsewhere = [within(other, 1.5) for other in moved.places if other != place]
        own = red[within(place, -1.5) & ~np.any(elsewhere, axis=0)]
        if not own.size:
            continue  # the ball between two others that touch it: what they show is all there is to see
        assert own.min() > 0.7 or own.max() < 0.3
        shares.append(float(own.mean()))
    assert sum(share > 0.5 for share in shares) <= 1


def test_what_moved_does_not_tint_what_is_around_it(moved: Found) -> None:
    beyond = ~np.any([within(place, 1.5) for place in moved.places], axis=0)
    assert np.abs(redness(moved))[beyond].max() < 0.1


def within(place: tuple[float, float, float], more_deg: float) -> NDArray[np.bool_]:
    """The pixels of a ball at (longitude, latitude) of a radius, all in degrees, made larger by some."""
    lon, lat, radius = place
    return np.asarray(RAYS @ direction(lon, lat) > math.cos(math.radians(radius + more_deg)))


def redness(found: Found) -> NDArray[np.float64]:
    """How far from the empty scene (0) to the ball (1) each pixel is."""
    towards = np.array(RED) - found.empty
    return np.asarray(np.sum((found.panorama - found.empty) * towards, -1) / np.sum(towards**2, -1))


EXPOSURES = (0.4, -0.3, 0.0, 0.25, -0.4, 0.1)


class Smooth:
    """A scene without any edge."""

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        return np.asarray(smooth_light(np.asarray(rays)), np.float32)


@pytest.fixture(scope="module")
def off() -> NDArray[np.float32]:
    """By how many grey levels (of 255) a panorama is off whose frames' exposures the mosaic knows to 0.1 EV only."""
    rotations = [*looking_around(4), orientation(20, 85), orientation(-50, -85)]
    mosaic = shots([Smooth()] * 6, rotations, EXPOSURES, noise=0.0)
    frames = [
        dataclasses.replace(frame, exposure_ev=frame.exposure_ev + 0.1 * (-1) ** k)
        for k, frame in enumerate(mosaic.frames)
    ]
    found = whole(dataclasses.replace(mosaic, frames=tuple(frames)))
    assert np.all(found[..., 3] == 1)
    return grey_levels(found[..., :3]) - grey_levels(panorama(Smooth(), SURFACE.size[0]))


def grey_levels(light: NDArray[Any]) -> NDArray[np.float32]:
    """Light as codes of sRGB, unrounded."""
    return (encoded_from_linear(np.ascontiguousarray(light, np.float32), np.uint16) / 257).astype(np.float32)


def test_rolled_by_half_its_width_it_shows_no_line(off: NDArray[np.float32]) -> None:
    """The mean step from one column to the next is no larger at the edge than elsewhere."""
    across = np.diff(np.roll(off, SURFACE.size[0] // 2, axis=1), axis=1)
    edge = SURFACE.size[0] // 2 - 1
    assert np.abs(off).max() > 1
    for steps in (np.abs(across).mean((0, 2)), np.abs(across.mean((0, 2)))):
        assert steps[edge] <= np.percentile(steps, 95)


@pytest.mark.parametrize("pitch", [90, -90])
def test_a_pole_seen_by_an_ordinary_camera_shows_nothing(off: NDArray[np.float32], pitch: float) -> None:
    """Neither a point where the rows end nor a line where the columns do: errors there are those of elsewhere."""
    view = Camera(Perspective(SURFACE.size[0] / (2 * math.pi)), (161, 161), (80.0, 80.0), half_fov=math.radians(60))
    seen = cv2.GaussianBlur(remap(off, SURFACE, view, orientation(0, pitch))[0], (0, 0), 1.0)
    gradient = np.max([np.abs(np.gradient(seen, axis=axis)).max(-1) for axis in (0, 1)], axis=0)
    assert gradient[78:83, 78:83].max() <= np.percentile(gradient, 95)
    columns = gradient[:, 5:-5]
    for line in (columns[:75], columns[86:]):  # the edge of the picture is the middle column of one of them
        assert line[:, 75].mean() <= np.percentile(line.mean(0), 95)


def test_nothing_under_a_mask_bleeds_in(room: Scene) -> None:
    """Whatever a frame holds where its alpha is empty, the panorama is the same."""
    mosaic = shots([room] * 4, looking_around(4))
    counts = np.ones(CAMERA.size[::-1], bool)
    counts[230:420, 150:300] = False
    results = []
    for hidden in (0, 255):
        frames = []
        for frame in mosaic.frames:
            picture = np.dstack([np.where(counts[..., None], frame.load(), hidden), 255 * counts]).astype(np.uint8)
            frames.append(frame_of(frame.id, picture, frame.camera_from_world))
        results.append(whole(dataclasses.replace(mosaic, frames=tuple(frames))))
    np.testing.assert_array_equal(results[0], results[1])
    assert results[0][..., 3].mean() > 0.8


class Lamp(NamedTuple):
    """A lamp before a scene, many times brighter than white."""

    behind: Scene
    towards: FloatArray

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        light = self.behind.radiance(rays)
        light[np.asarray(rays) @ self.towards > math.cos(math.radians(4))] = 2.0
        return light


def test_nothing_of_a_clipped_lamp_bleeds_in(room: Scene) -> None:
    """Clipped by a long exposure, recorded by a short one: as bright as that one says, and so is what is around it."""
    towards = direction(45, 10)
    rotations, exposures = looking_around(4), [0.6, -1.5, 0.6, -1.5]
    lit = whole(shots([Lamp(room, towards)] * 4, rotations, exposures))[..., :3]
    dark = whole(shots([room] * 4, rotations, exposures))[..., :3]
    angle = np.degrees(np.arccos(np.clip(RAYS @ towards, -1, 1)))
    np.testing.assert_allclose(lit[angle < 3], 2.0, atol=0.1)
    around = (angle > 5.5) & (angle < 30)
    assert np.abs(cv2.blur(lit - dark, (5, 5))[around]).max() < 0.03


def test_a_lamp_that_all_clip_is_white(room: Scene) -> None:
    """In frames of long exposures too, whose white is the grey of shorter ones."""
    towards = direction(45, 10)
    mosaic = shots([Lamp(room, towards)] * 4, looking_around(4), [0.65, 0.65, 0.3, 0.3])
    codes = np.concatenate([band.rows for band in compose(mosaic, SURFACE, np.uint8)])
    assert codes[RAYS @ towards > math.cos(math.radians(3))].min() >= 254
