import math

import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.colour import linear_from_encoded
from fullsphere.model.lens import Equidistant
from fullsphere.model.sampling import sample
from fullsphere.mosaic.arm import mount_of
from fullsphere.mosaic.eyes import eyes_of
from fullsphere.mosaic.world_panels import Panel, PanelScene
from fullsphere.mosaic.world_turn import photograph_on_arm, true_mosaic

ARM = 0.2
CAMERA = Camera(Equidistant(60.0), (200, 200), (99.5, 99.5), half_fov=math.radians(92))


def box(half: float = 1.5) -> PanelScene:
    """A cube round the axis, each wall with its own smooth texture."""
    walls = []
    waves = np.linspace(0, 3, 64)
    for k, (right, down) in enumerate(
        [((1, 0, 0), (0, 1, 0)), ((0, 0, -1), (0, 1, 0)), ((-1, 0, 0), (0, 1, 0)), ((0, 0, 1), (0, 1, 0)),
         ((1, 0, 0), (0, 0, -1)), ((1, 0, 0), (0, 0, 1))]
    ):  # fmt: skip
        across, along = np.array(right, float), np.array(down, float)
        outward = np.cross(across, along)
        texture = 0.4 + 0.2 * np.stack([np.outer(np.sin(waves + k), np.cos(waves))] * 3, -1)
        corner = half * (outward - across - along)
        walls.append(Panel(corner, 2 * half * across, 2 * half * along, texture.astype(np.float32)))
    return PanelScene(tuple(walls))


def test_a_room_keeps_its_walls_from_wherever_it_is_seen() -> None:
    room, ray = box(), np.array([0.3, 0.2, 1.0])
    place = np.array([0.2, -0.1, 0.4])
    reach = room.seen_from(place).distance(ray)
    assert reach == pytest.approx(1.5 - 0.4)
    ahead = room.distance(place + reach * ray)  # the same point from the middle
    assert ahead == pytest.approx(1)
    np.testing.assert_allclose(room.seen_from(place).radiance(ray), room.radiance(place + reach * ray), atol=1e-5)


def test_nothing_is_met_where_nothing_is() -> None:
    wall = PanelScene(box().panels[:1])
    assert np.isinf(wall.distance(np.array([0.0, 0, -1])))


def test_frames_show_on_their_circle_what_the_mosaic_shows_in_their_column() -> None:
    width, column, room = 64, 13, box()
    angle = (column + 0.5) / width * 2 * np.pi
    mount = mount_of(0.01, 0.012, -0.02)
    frame = photograph_on_arm(room, CAMERA, angle, ARM, mount=mount, supersampling=4)
    truth = true_mosaic(room, ARM, width, supersampling=3).light[:, column]
    psi = np.pi - (np.arange(width) + 0.5) / width * 2 * np.pi
    rays = np.stack([np.cos(psi), -np.sin(psi), np.zeros(width)], -1)
    pixels = CAMERA.project(rays @ mount.T)
    seen = sample(linear_from_encoded(frame), pixels[None].astype(np.float32), "linear")[0]
    assert np.quantile(np.abs(seen - truth), 0.9) < 0.006  # walls meet in sharp edges


def test_both_eyes_see_a_thing_at_the_range_where_it_is() -> None:
    width, room = 128, box()
    rho = true_mosaic(room, ARM, width, supersampling=1).rho
    left, right = eyes_of(rho)
    middle = len(left) // 2
    assert left[middle].min() == pytest.approx(1.5 / ARM, rel=0.01)  # a wall's nearest point
    np.testing.assert_allclose(np.sort(left[middle]), np.sort(right[middle]), rtol=1e-6)
