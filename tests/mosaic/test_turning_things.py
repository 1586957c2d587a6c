"""What turns with the camera is found in a rendered world, and only that."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from turning import orientation, ring

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.overview import Overview
from fullsphere.mosaic.turning_things import turning_things

SPHERE = Equirectangular((512, 256))
RAYS = SPHERE.window_rays(slice(0, 512), slice(0, 256))
CAMERA = Camera(Equidistant(400 / math.radians(95)), (840, 830), (421.0, 413.0), half_fov=math.radians(95))
HAND = np.array([*ring(6, seed=2)])


def world(rng: np.random.Generator) -> NDArray[np.float32]:
    """Random waves on the sphere, as light; the upper half fades to plain sky."""
    waves = rng.normal(size=(50, 3)) * rng.uniform(1, 20, 50)[:, None]
    level = np.sin(RAYS @ waves.T + rng.uniform(0, 6, 50)) @ rng.normal(size=(50, 3)) * 0.2
    return np.asarray(0.2 * np.exp(level * np.clip(RAYS[..., 1:2] * 3 + 1, 0, 1)), np.float32)


def thing(pixels: FloatArray) -> NDArray[np.bool_]:
    """Two shoes at the lower rim, in pixels of the camera (..., 2)."""
    u, v = pixels[..., 0], pixels[..., 1]
    with np.errstate(invalid="ignore"):
        return np.asarray(((np.abs(u - 340) / 40) ** 2 + ((v - 740) / 60) ** 2 < 1) | (np.hypot(u - 500, v - 740) < 45))


def frames(
    light: NDArray[np.float32],
    rotations: FloatArray,
    colour: tuple[float, ...] | None = None,
    vignetting_ev: float = 0.0,
) -> list[Overview]:
    rng = np.random.default_rng(1)
    made = []
    for rotation in rotations:
        pixels = CAMERA.project(RAYS @ rotation.T)
        seen = np.isfinite(pixels[..., 0])
        theta = np.arccos(np.clip(RAYS @ rotation[2], -1, 1))
        one = light * (1 + 0.02 * rng.standard_normal(light.shape)) * 2 ** (0.03 * rng.standard_normal())
        one = one * 2 ** (-vignetting_ev * (theta / math.radians(95)) ** 4)[..., None]
        if colour is not None:
            one[thing(pixels)] = colour
        quality = np.where(seen, 1 - 0.5 * theta / math.pi, 0).astype(np.float32)
        made.append(Overview(np.where(seen[..., None], one, 0).astype(np.float32), quality))
    return made


def truth() -> NDArray[np.bool_]:
    v, u = np.mgrid[:830, :840]
    return thing(np.stack([u, v], -1))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("colour", [(0.02, 0.015, 0.01), (0.9, 0.9, 0.8)])
def test_shoes_are_found_and_nothing_else(seed: int, colour: tuple[float, ...]) -> None:
    found = turning_things(frames(world(np.random.default_rng(seed)), HAND, colour), HAND, CAMERA)
    assert found is not None
    assert found.shape == (830, 840)
    assert found[truth()].mean() > 0.95
    assert found.sum() < 1.8 * truth().sum()  # it reaches a little over the edge


def test_shoes_before_a_plain_floor_are_found() -> None:
    found = turning_things(frames(np.full((256, 512, 3), 0.3, np.float32), HAND, (0.02, 0.02, 0.02)), HAND, CAMERA)
    assert found is not None
    assert found[truth()].mean() > 0.95


@pytest.mark.parametrize("vignetting_ev", [0.0, 0.4])
def test_neither_a_scene_nor_a_plain_wall_is_a_thing(vignetting_ev: float) -> None:
    """Not even where some vignetting was left in the frames."""
    for seed in range(3):
        light = world(np.random.default_rng(seed))
        assert turning_things(frames(light, HAND, None, vignetting_ev), HAND, CAMERA) is None
    wall = np.full((256, 512, 3), 0.3, np.float32)
    assert turning_things(frames(wall, HAND, None, vignetting_ev), HAND, CAMERA) is None


def test_it_takes_three_frames_that_overlap() -> None:
    light = world(np.random.default_rng(0))
    apart = np.array([orientation(0), orientation(180)])
    assert turning_things(frames(light, apart, (0.02, 0.02, 0.02)), apart, CAMERA) is None
    still = np.array([orientation(0)] * 4)  # the camera did not turn: who could tell?
    assert turning_things(frames(light, still, (0.02, 0.02, 0.02)), still, CAMERA) is None
    blind = [Overview(np.zeros((256, 512, 3), np.float32), np.zeros((256, 512), np.float32))] * 4
    assert turning_things(blind, still, CAMERA) is None


def test_threads_change_nothing() -> None:
    overviews = frames(world(np.random.default_rng(4)), HAND, (0.02, 0.02, 0.02))
    found = turning_things(overviews, HAND, CAMERA)
    assert found is not None
    with thread_pool(2) as pool:
        again = turning_things(overviews, HAND, CAMERA, pool)
    assert again is not None
    np.testing.assert_array_equal(again, found)
