"""The image circle of rendered frames is found; where there is none, none is claimed."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle, brightest, find_circle, within_circle
from fullsphere.model.lens import Equidistant

WIDTH, HEIGHT = 900, 700


def disc(
    centre: tuple[float, float] = (455.3, 344.6),
    radius: float = 301.7,
    light: float = 150.0,
    glow: float = 0.0,
    dark_sector_deg: float = 0.0,
) -> NDArray[np.uint8]:
    """A lit disc with uneven light, a soft rim a pixel wide, light scattered beyond it, and sensor noise."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    r = np.hypot(u - centre[0], v - centre[1])
    phi = np.arctan2(v - centre[1], u - centre[0])
    scene = light * (1 + 0.3 * np.sin(u / 37) * np.cos(v / 51)) * (1 - 0.3 * (r / radius) ** 2)
    scene[np.abs(phi) < math.radians(dark_sector_deg) / 2] *= 0.02
    inside = np.clip(radius + 0.5 - r, 0, 1)
    beyond = glow * light * np.exp(-np.maximum(r - radius, 0) / 15)
    seen = inside * scene + (1 - inside) * beyond + rng.normal(2, 1, r.shape)
    return np.asarray(np.clip(seen, 0, 255), np.uint8)


@pytest.mark.parametrize(
    "shown",
    [
        {},
        {"light": 40.0},
        {"light": 20.0},
        {"glow": 0.15},
        {"dark_sector_deg": 60.0},
        {"dark_sector_deg": 120.0},
        {"centre": (455.3, 344.6), "radius": 420.0},
        {"centre": (430.0, 250.0), "radius": 330.0},
        {"centre": (600.2, 344.6), "radius": 340.0},
        {"radius": 180.4},
    ],
    ids=str,
)
def test_the_circle_is_found(shown: dict[str, float | tuple[float, float]]) -> None:
    truth = ImageCircle((455.3, 344.6), 301.7)._replace(**{k: v for k, v in shown.items() if k in ImageCircle._fields})  # type: ignore[arg-type]
    found = find_circle(disc(**shown))  # type: ignore[arg-type]
    assert found is not None
    assert math.dist(found.centre, truth.centre) < 0.5
    assert found.radius == pytest.approx(truth.radius, rel=0.005)


def test_the_circle_of_a_large_picture_is_found_in_its_own_pixels() -> None:
    small = disc()
    large = np.repeat(np.repeat(small, 3, axis=0), 3, axis=1)
    found = find_circle(large)
    assert found is not None
    assert math.dist(found.centre, (455.3 * 3 + 1, 344.6 * 3 + 1)) < 1.5
    assert found.radius == pytest.approx(3 * 301.7, rel=0.005)


def ordinary() -> NDArray[np.uint8]:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(120 + 60 * np.sin(u / 40) * np.cos(v / 30), np.uint8)


def rectangle() -> NDArray[np.uint8]:
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    image[120:580, 150:750] = 160
    return image


def noise() -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 12, (HEIGHT, WIDTH)).astype(np.uint8)


@pytest.mark.parametrize(
    "image",
    [
        ordinary(),
        np.zeros((HEIGHT, WIDTH), np.uint8),
        np.full((HEIGHT, WIDTH), 255, np.uint8),
        rectangle(),
        noise(),
        np.zeros((5, 7), np.uint8),
        disc(radius=4000.0),
    ],
    ids=["ordinary", "black", "white", "rectangle", "noise", "tiny", "full frame"],
)
def test_none_where_there_is_no_circle(image: NDArray[np.uint8]) -> None:
    assert find_circle(image) is None


def test_brightest_is_the_largest_over_pictures_and_channels() -> None:
    pictures = [np.random.default_rng(k).integers(0, 256, (6, 7, 3)).astype(np.uint8) for k in range(4)]
    before = [p.copy() for p in pictures]
    np.testing.assert_array_equal(brightest(pictures), np.max(pictures, axis=(0, -1)))
    np.testing.assert_array_equal(pictures, before)


def test_a_thing_at_the_rim_of_one_frame_is_outshone_by_another() -> None:
    blocked = disc(dark_sector_deg=200.0)
    turned = np.ascontiguousarray(disc(dark_sector_deg=200.0, centre=(WIDTH - 1 - 455.3, 344.6))[:, ::-1])
    found = find_circle(brightest([blocked[..., None], turned[..., None]]))
    assert found is not None
    assert math.dist(found.centre, (455.3, 344.6)) < 0.5


def test_a_camera_ends_at_the_circle_and_never_reaches_further() -> None:
    camera = Camera(Equidistant(200.0), (900, 700), (450.0, 350.0), half_fov=1.7)
    assert within_circle(camera, ImageCircle((450.0, 350.0), 310.0)).half_fov == pytest.approx(310 / 200)
    assert within_circle(camera, ImageCircle((450.0, 350.0), 345.0)) == camera
    assert within_circle(camera, None) == camera
