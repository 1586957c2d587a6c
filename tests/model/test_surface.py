"""The equirectangular picture is the whole sphere, as docs/conventions.md has it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.model.camera import Projection
from fullsphere.model.errors import UsageError
from fullsphere.model.surface import Equirectangular
from laws import SEEDS, angle_between, law

WHOLE = Equirectangular((400, 200))


@given(half=st.integers(1, 4000), seed=SEEDS)
@law()
def test_project_inverts_unproject(half: int, seed: int) -> None:
    surface = Equirectangular((2 * half, half))
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([-0.5, -0.5 + 1e-6 * half], [2 * half - 0.5, half * (1 - 1e-6) - 0.5], (200, 2))
    rays = surface.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose(surface.project(rays), pixels, rtol=0, atol=1e-5)


@given(seed=SEEDS)
@law()
def test_unproject_inverts_project_for_rays_of_any_length(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(200, 3)) * 10 ** rng.uniform(-3, 3, (200, 1))
    rays[:6] = np.array([[0, 1, 0], [0, -1, 0], [0, 0, -1], [1e-13, 0, -1], [-1e-13, 0, -1], [1e-9, -5, 0]])
    pixels = WHOLE.project(rays)
    assert np.all((pixels >= -0.5) & (pixels <= [399.5, 199.5]))
    assert np.all(pixels[:, 0] < 399.5)
    np.testing.assert_allclose(angle_between(WHOLE.unproject(pixels), rays), 0, atol=1e-13)


def test_conventions() -> None:
    """The middle looks along +z, the right quarter along +x, the top row up (-y)."""
    np.testing.assert_allclose(WHOLE.project([0, 0, 1]), [199.5, 99.5])
    np.testing.assert_allclose(WHOLE.project([1, 0, 0]), [299.5, 99.5])
    np.testing.assert_allclose(WHOLE.project([0, -1, 1]), [199.5, 49.5])
    np.testing.assert_allclose(WHOLE.unproject([199.5, -0.5]), [0, -1, 0], atol=1e-15)
    assert WHOLE.project([0, 0, -1])[0] == WHOLE.project([-0.0, 0, -1])[0] == -0.5
    assert isinstance(WHOLE, Projection)


def test_the_sphere_goes_on_past_the_border() -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 400, 100), rng.uniform(0, 10, 100)
    inside = WHOLE.unproject(np.stack([u, v], -1))
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 400, v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u - 400, v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 200, -1 - v], -1)), inside, atol=1e-12)
    np.testing.assert_allclose(WHOLE.unproject(np.stack([u + 200, 400 - 1 - v], -1)), inside, atol=1e-12)


def test_window_rays_are_those_of_its_pixels() -> None:
    window = WHOLE.window_rays(slice(-3, 20), slice(190, 205))
    u, v = np.meshgrid(np.arange(-3, 20), np.arange(190, 205))
    np.testing.assert_array_equal(window, WHOLE.unproject(np.stack([u, v], -1)))


def test_no_direction_is_nan() -> None:
    assert np.all(np.isnan(WHOLE.project([0.0, 0.0, 0.0])))
    assert np.all(np.isnan(WHOLE.project([0.0, math.nan, 1.0])))


@pytest.mark.parametrize("size", [(400, 199), (0, 0), (-4, -2), (1 << 21, 1 << 20), (200, 400)])
def test_a_size_that_is_no_whole_sphere_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(UsageError, match="twice as wide"):
        Equirectangular(size)
