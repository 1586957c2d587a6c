"""A conformal view shows what the frame shows, where it says, and keypoints in it lie more exactly."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, Equisolid, Perspective
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.conformal import conformal_view, is_wide
from fullsphere.mosaic.features import find_features
from fullsphere.mosaic.matching import match_features

HALF = math.radians(91)
CAMERA = Camera(Equisolid(200.0), (600, 580), (303.0, 286.5), aspect=1.01, half_fov=HALF)


@pytest.fixture(scope="module")
def world() -> NDArray[np.uint8]:
    """An equirectangular picture (1024, 2048, 3) with texture of several sizes."""
    rng = np.random.default_rng(0)
    total = np.zeros((1024, 2048, 3), np.float32)
    for cells in (16, 48, 130, 300, 512):
        small = rng.random((cells, 2 * cells, 3), np.float32)
        total += cv2.resize(small, (2048, 1024), interpolation=cv2.INTER_CUBIC) / cells**0.4
    picture: NDArray[np.uint8] = np.round(255 * (total - total.min()) / np.ptp(total)).astype(np.uint8)
    return picture


def taken(world: NDArray[np.uint8], camera: Camera, yaw_deg: float) -> NDArray[np.uint8]:
    turn = Rotation.from_rotvec([0, math.radians(yaw_deg), 0]).as_matrix()
    picture: NDArray[np.uint8] = remap(world, Equirectangular((2048, 1024)), camera, turn)[0]
    return picture


@pytest.mark.parametrize("camera", [CAMERA, dataclasses.replace(CAMERA, size=(500, 300), centre=(240.0, 155.0))])
def test_a_view_shows_what_the_frame_shows(camera: Camera) -> None:
    height, width = camera.size[::-1]
    v, u = np.mgrid[:height, :width].astype(np.float32)
    for values, coordinate in ((u, 0), (v, 1)):
        view = conformal_view(values, None, camera, 1e9)
        assert view is not None
        at = np.argwhere(view.inside)[::97, ::-1].astype(float)
        pixels, _ = view.in_frame(at)
        shown = view.light[at[:, 1].astype(int), at[:, 0].astype(int)]
        away = np.all((pixels > 3) & (pixels < np.array(camera.size) - 4), axis=1)
        away &= camera.unproject(pixels)[:, 2] > 0.03  # at the rim itself values are those from further inside
        assert away.sum() > 500
        np.testing.assert_allclose(shown[away], pixels[away, coordinate], atol=0.05)


def test_a_view_has_about_the_pixels_asked_for() -> None:
    light = np.ones(CAMERA.size[::-1], np.float32)
    allowed = np.zeros(CAMERA.size[::-1], np.uint8)
    cv2.circle(allowed, (303, 286), 270, 255, -1)
    for most in (20_000, 60_000, 1e9):
        view = conformal_view(light, allowed, CAMERA, most)
        assert view is not None
        expected = min(most, float(cv2.countNonZero(allowed)))
        assert 0.85 * expected < cv2.countNonZero(view.inside) < 1.1 * expected


def test_a_view_keeps_what_is_not_allowed_out() -> None:
    allowed = np.zeros(CAMERA.size[::-1], np.uint8)
    allowed[200:400, 100:300] = 255
    view = conformal_view(np.ones(CAMERA.size[::-1], np.float32), allowed, CAMERA, 1e9)
    assert view is not None
    pixels, _ = view.in_frame(np.argwhere(view.inside)[:, ::-1].astype(float))
    assert np.all(pixels > [98.9, 198.9])
    assert np.all(pixels < [300.1, 400.1])
    assert conformal_view(np.ones(CAMERA.size[::-1], np.float32), np.zeros_like(allowed), CAMERA, 1e9) is None
    assert len(find_features(np.ones((580, 600, 3), np.uint8), np.zeros_like(allowed), 100, CAMERA)) == 0


def test_scale_is_that_of_the_frame_over_that_of_the_view() -> None:
    view = conformal_view(np.ones(CAMERA.size[::-1], np.float32), None, CAMERA, 40_000)
    assert view is not None
    middle = np.array(view.camera.centre)
    steps = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]]) + middle
    pixels, scale = view.in_frame(steps)
    moved = np.linalg.norm(pixels[1:] - pixels[0], axis=1) / 0.5
    np.testing.assert_allclose(moved, scale[0], rtol=0.02)


def test_keypoints_near_the_rim_are_found_again_and_more_exactly(world: NDArray[np.uint8]) -> None:
    """Frames turned by 70 degrees: more of the same things are found, nearer to where they are."""
    camera = dataclasses.replace(CAMERA, aspect=1.0)
    turn = Rotation.from_rotvec([0, math.radians(70), 0]).as_matrix()
    frames = [taken(world, camera, yaw) for yaw in (0, 70)]
    found = {}
    for name, seen_by in (("as it is", None), ("conformal", camera)):
        a, b = (find_features(picture, None, 2000, seen_by) for picture in frames)
        pairs = match_features(a, b)
        expected = camera.project(camera.unproject(a.pixels[pairs.first]) @ turn.T)
        error = np.linalg.norm(expected - b.pixels[pairs.second], axis=1)
        right = error < 2
        found[name] = (int(right.sum()), float(np.median(error[right])))
    assert found["conformal"][0] > 1.1 * found["as it is"][0], found
    assert found["conformal"][1] < 0.9 * found["as it is"][1], found


def test_narrow_pictures_are_looked_at_as_they_are() -> None:
    assert is_wide(CAMERA)
    assert not is_wide(Camera(Perspective(800.0), (600, 400), (299.5, 199.5), half_fov=math.radians(25)))
    assert not is_wide(Camera(Equidistant(100.0), (600, 600), (299.5, 299.5), half_fov=math.radians(130)))
