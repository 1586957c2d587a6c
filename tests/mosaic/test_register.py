"""Registration of a small known scene: with the camera, without it, and with frames that do not belong."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, orientation, turn_between

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.register import register
from laws import fisheye

CAMERA = fisheye(360)
WORLD = Equirectangular((2048, 1024))
ROTATIONS = np.array([orientation(yaw, pitch) for yaw, pitch in ((0, 0), (70, 12), (145, -8), (215, 5), (290, -12))])


def textured(seed: int) -> NDArray[np.uint8]:
    """A panorama with detail of every size and no repeats, continuous over the seam."""
    rng = np.random.default_rng(seed)
    total = np.zeros((1024, 2048, 3), np.float32)
    for sigma in (2.0, 5.0, 12.0, 30.0):
        noise = rng.normal(size=(1024, 2048, 3)).astype(np.float32)
        wrapped = np.concatenate([noise[:, -150:], noise, noise[:, :150]], axis=1)
        total += sigma * 1.6 * cv2.GaussianBlur(wrapped, (0, 0), sigma)[:, 150:-150]
    return np.asarray(np.clip(125 + 45 * total, 0, 255), np.uint8)


def taken(panorama: NDArray[np.uint8], rotations: FloatArray, camera: Camera = CAMERA, name: str = "") -> list[Frame]:
    """Unregistered frames of a panorama, black beyond the field of view, with some noise."""
    frames = []
    for k, rotation in enumerate(rotations):
        picture, weight = remap(panorama, WORLD, camera, rotation, "linear")
        noise = np.random.default_rng(k).normal(0, 1, picture.shape)
        picture = np.where(weight[..., None] > 0, np.clip(picture + noise, 0, 255), 0).astype(np.uint8)
        frames.append(frame_of(f"{name}{k}", picture))
    return frames


@pytest.fixture(scope="module")
def scene() -> NDArray[np.uint8]:
    return textured(0)


@pytest.fixture(scope="module")
def frames(scene: NDArray[np.uint8]) -> list[Frame]:
    return taken(scene, ROTATIONS)


@pytest.fixture(scope="module")
def mosaic(frames: list[Frame]) -> Mosaic:
    return register(frames, CAMERA)


def errors_deg(mosaic: Mosaic, truth: FloatArray, names: str = "01234") -> FloatArray:
    """How far each frame is turned from where it should be, the world's own freedom taken out by the first frame."""
    found = {frame.id: np.asarray(frame.camera_from_world) for frame in mosaic.registered}
    relative = np.array([found[name] @ found[names[0]].T for name in names])
    return np.asarray(np.rad2deg(turn_between(relative, truth @ truth[0].T)))


def test_with_the_camera_the_orientations_come_back(mosaic: Mosaic, frames: list[Frame]) -> None:
    assert [frame.id for frame in mosaic.frames] == [frame.id for frame in frames]
    assert all(frame.registered for frame in mosaic.frames)
    assert errors_deg(mosaic, ROTATIONS).max() < 0.05  # a pixel is half a degree
    assert mosaic.camera == CAMERA
    assert not mosaic.self_calibrated
    assert 0 < mosaic.quality["residual_median_px"] < 0.5
    assert mosaic.quality["matches"] == sum(len(link.pixels_i) for link in mosaic.links)


def test_the_stated_sigma_covers_the_error(mosaic: Mosaic) -> None:
    sigma = np.array([frame.sigma_deg for frame in mosaic.frames], float)
    assert np.all(sigma > 0)
    assert np.all(errors_deg(mosaic, ROTATIONS)[1:] < 5 * np.hypot(sigma[0], sigma[1:]) + 0.01)


def test_the_world_is_level_and_looks_along_the_first_frame(mosaic: Mosaic) -> None:
    first = mosaic.frames[0].camera_from_world
    assert first is not None
    assert mosaic.level == "camera-x-axes"
    assert np.rad2deg(turn_between(first, orientation(0))) < 0.1  # all were level: nothing but yaw and pitch


def test_links_are_between_registered_frames_and_agree_with_them(mosaic: Mosaic) -> None:
    assert len(mosaic.links) >= 5
    for link in mosaic.links:
        i, j = mosaic.frames[link.i].camera_from_world, mosaic.frames[link.j].camera_from_world
        assert i is not None
        assert j is not None
        assert np.rad2deg(turn_between(link.j_from_i, j @ i.T)) < 1.0


def test_the_result_does_not_depend_on_threads(mosaic: Mosaic, frames: list[Frame]) -> None:
    with thread_pool(3) as pool:
        again = register(frames, CAMERA, executor=pool)
    for one, two in zip(mosaic.frames, again.frames, strict=True):
        np.testing.assert_array_equal(one.camera_from_world, two.camera_from_world)


def test_without_the_camera_it_is_found_too(frames: list[Frame]) -> None:
    mosaic = register(frames)
    assert mosaic.self_calibrated
    assert len(mosaic.registered) == 5
    assert errors_deg(mosaic, ROTATIONS).max() < 0.3
    theta = np.linspace(0, math.radians(88), 40)
    assert np.abs(mosaic.camera.lens.radius(theta) - CAMERA.lens.radius(theta)).max() < 1.5
    assert math.dist(mosaic.camera.centre, CAMERA.centre) < 1.0


def test_frames_that_do_not_belong_are_left_out_with_the_reason(scene: NDArray[np.uint8], frames: list[Frame]) -> None:
    blank = frame_of("blank", np.full((360, 360, 3), 90, np.uint8))
    (stranger,) = taken(textured(7), ROTATIONS[:1], name="stranger ")
    before = Frame("unreadable", "unreadable", (360, 360), lambda: 1 / 0).left_out("cannot be read")  # type: ignore[arg-type, return-value]
    mosaic = register([before, frames[0], blank, frames[1], stranger, frames[2]], CAMERA)
    reasons = {frame.id: frame.reason for frame in mosaic.frames if not frame.registered}
    assert set(reasons) == {"unreadable", "blank", "stranger 0"}
    assert reasons["unreadable"] == "cannot be read"
    assert "blank" in reasons["blank"]
    assert "another place" in reasons["stranger 0"]
    assert errors_deg(mosaic, ROTATIONS[:3], "012").max() < 0.05
    assert all(frame.camera_from_world is None for frame in mosaic.frames if frame.reason)


def test_frames_that_do_not_overlap_are_no_mosaic(scene: NDArray[np.uint8]) -> None:
    narrow = Camera(Perspective(400.0), (400, 300), (199.5, 149.5), half_fov=math.radians(33))
    apart = taken(scene, np.array([orientation(yaw) for yaw in (0, 90, 180)]), narrow)
    with pytest.raises(GeometryError, match="overlap"):
        register(apart, narrow)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_frames_are_no_mosaic(frames: list[Frame], count: int) -> None:
    with pytest.raises(GeometryError):
        register(frames[:count], CAMERA)


def test_all_frames_left_out_are_no_mosaic(frames: list[Frame]) -> None:
    with pytest.raises(GeometryError):
        register([dataclasses.replace(frame, reason="cannot be read") for frame in frames])
