"""What turns with the camera is hidden, and the scene behind it comes from other frames."""

import math

import numpy as np
import pytest
from turning import frames_of, orientation, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.automatic_mask import without_turning_things
from fullsphere.mosaic.compose import compose
from fullsphere.mosaic.overview import overviews, working_sphere
from fullsphere.mosaic.planning import planned
from fullsphere.mosaic.project import Mosaic, Picture
from laws import pixel_rays

CAMERA = Camera(Equidistant(240 / math.radians(95)), (500, 500), (249.5, 249.5), half_fov=math.radians(95))
ROTATIONS = np.array([orientation(60 * k, 25 * (-1) ** k, 3 * k) for k in range(6)])
SURFACE = Equirectangular((512, 256))


def scene(rays: FloatArray) -> FloatArray:
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(50, 3)) * rng.uniform(1, 20, 50)[:, None]
    level = np.sin(rays @ waves.T + rng.uniform(0, 6, 50)) @ rng.normal(size=(50, 3)) * 0.15
    return np.asarray(np.clip(0.25 * np.exp(level), 0, 0.9))


def with_shoes(k: int, light: FloatArray) -> Picture:
    v, u = np.mgrid[:500, :500]
    shoes = ((np.abs(u - 205) / 26) ** 2 + ((v - 440) / 36) ** 2 < 1) | (np.hypot(u - 300, v - 440) < 28)
    return srgb8(np.where(shoes[..., None], [0.02, 0.02, 0.03], light))


@pytest.fixture(scope="module")
def shod() -> Mosaic:
    return Mosaic((CAMERA,), tuple(frames_of(scene, CAMERA, ROTATIONS, with_shoes)), ())


def test_shoes_are_hidden_and_only_they(shod: Mosaic) -> None:
    hidden = without_turning_things(shod, overviews(shod, working_sphere(shod)))
    assert 0.015 < hidden.share[0] < 0.08
    for frame in hidden.mosaic.registered:
        assert frame.mask is not None
        assert frame.mask()[440, 205] == 0
        assert frame.mask()[250, 250] == 255


def test_the_panorama_shows_what_is_behind_them(shod: Mosaic) -> None:
    plan = planned(shod)
    assert any("turns with the camera" in note for note in plan.notes)
    result = np.concatenate([b.rows for b in compose(plan.mosaic, SURFACE, np.float32, shares=plan.shares)])
    truth, covered = scene(pixel_rays(SURFACE).reshape(-1, 3)).reshape(256, 512, 3), result[..., 3] > 0
    assert covered.mean() > 0.93
    off = np.abs(result[..., :3] - truth).max(-1)[covered]
    assert np.mean(off > 0.08) < 0.01
    kept = planned(shod, hide_turning=False)
    assert not kept.notes
    assert all(frame.mask is None for frame in kept.mosaic.frames)


def test_where_nothing_turns_nothing_is_hidden() -> None:
    mosaic = Mosaic((CAMERA,), tuple(frames_of(scene, CAMERA, ROTATIONS, lambda k, light: srgb8(light))), ())
    hidden = without_turning_things(mosaic, overviews(mosaic, working_sphere(mosaic)))
    assert hidden.share == (0.0,)
    assert hidden.mosaic is mosaic
