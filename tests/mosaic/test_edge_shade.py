"""What the edge of a lens takes of the light, measured where other frames see inside their edges."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.mosaic.edge_shade import KNOTS, edge_shade, shade_at

TRUE = (-0.1, -0.3, -0.7, -1.2, -1.9)


def told(
    noise: float, moved: float, shade: tuple[float, ...] = TRUE
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What four frames of one camera tell of 20 000 directions, a share of them of things that have moved, and s."""
    rng = np.random.default_rng(2)
    s = rng.random((4, 20_000))
    scene = rng.normal(0, 2, (20_000, 3)) + shade_at(s, shade)[..., None] + rng.normal(0, noise, (4, 20_000, 3))
    scene[rng.random((4, 20_000)) < moved] += 1.5
    scene[rng.random((4, 20_000)) < 0.3] = np.nan
    return scene.astype(np.float32), s.astype(np.float32)


def test_the_shade_is_found_though_things_moved() -> None:
    (found,) = edge_shade(*told(0.05, 0.05), np.zeros(4, np.intp), 1)
    at = np.linspace(0, 1, 101)
    assert np.abs(shade_at(at, found) - shade_at(at, TRUE)).max() < 0.06
    assert (shade_at(at[at <= KNOTS[0]], found) == 0).all()


def test_each_camera_has_its_own() -> None:
    scene, s = told(0.05, 0.0)
    plain, _ = told(0.05, 0.0, ())
    shaded, none = edge_shade(np.concatenate([scene[:2], plain[2:]]), s, np.array([0, 0, 1, 1]), 2)
    assert shaded[-1] == pytest.approx(TRUE[-1], abs=0.1)
    assert none == ()


def test_noise_alone_is_no_shade_and_nothing_brightens_outwards() -> None:
    assert edge_shade(*told(0.1, 0.0, ()), np.zeros(4, np.intp), 1) == ((),)
    (found,) = edge_shade(*told(0.01, 0.0, (0.5, 0.2, -0.1, -0.6, -0.5)), np.zeros(4, np.intp), 1)
    assert (np.diff((0.0, *found)) <= 0).all()


def test_edges_that_only_meet_edges_say_nothing() -> None:
    scene, s = told(0.01, 0.0)
    assert edge_shade(scene, np.maximum(s, np.float32(0.91)), np.zeros(4, np.intp), 1) == ((),)
