"""Up from upright lines: edges known exactly, edges that deceive, and edges found in rendered frames."""

import math

import numpy as np
import pytest
from hypothesis import given
from turning import frame_of, frames_of, orientation, srgb8

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, Perspective
from fullsphere.mosaic.level import level
from fullsphere.mosaic.line_segments import Segments, find_segments
from fullsphere.mosaic.options import LevelFrom, Levelling
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.upright_lines import meeting_of, up_from_lines
from fullsphere.mosaic.worlds import environment, furnished_room, photograph
from laws import SEEDS, fisheye, law, rotation

UP = np.array([0.0, -1.0, 0.0])
REACH = math.radians(25)
CAMERA = fisheye(640)


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.rad2deg(np.arccos(np.clip(a @ b, -1, 1))))


def edges(rng: np.random.Generator, count: int, slant_deg: FloatArray | float, noise_deg: float = 0.3) -> Segments:
    """Edges all round, within 40 degrees of the horizon, that lean by `slant_deg` from the way up."""
    azimuth, height = rng.uniform(-np.pi, np.pi, count), rng.uniform(-0.7, 0.7, count)
    middles = np.stack([np.cos(height) * np.sin(azimuth), -np.sin(height), np.cos(height) * np.cos(azimuth)], -1)
    upwards = UP - (middles @ UP)[:, None] * middles
    upwards /= np.linalg.norm(upwards, axis=-1, keepdims=True)
    lean = np.deg2rad(slant_deg + rng.normal(0, noise_deg, count))[:, None]
    along = np.cos(lean) * upwards + np.sin(lean) * np.cross(upwards, middles)
    return Segments(middles, np.cross(middles, along), rng.uniform(0.05, 0.25, count))


def joined(*parts: Segments) -> Segments:
    return Segments(*(np.concatenate(of_all) for of_all in zip(*parts, strict=True)))


def turned(segments: Segments, world: FloatArray) -> Segments:
    return segments._replace(middles=segments.middles @ world, normals=segments.normals @ world)


@given(seed=SEEDS)
@law(15)
def test_uprights_among_horizontals_roofs_and_clutter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = rotation(seed)
    roofs = edges(rng, 80, rng.choice([-35.0, 35.0], 80), 3.0)
    segments = joined(
        edges(rng, 60, 0.0), edges(rng, 150, 90.0, 2.0), roofs, edges(rng, 200, rng.uniform(-90, 90, 200))
    )
    near = rotation(0) @ np.array([0.0, 0.0, 1.0])
    near = UP + 0.3 * (near - (near @ UP) * UP)
    meeting = meeting_of(turned(segments, world), world.T @ (near / np.linalg.norm(near)), REACH)
    assert meeting is not None
    assert meeting.certain
    error = angle_deg(meeting.upright.up, world.T @ UP)
    assert error < 0.3
    assert error < 5 * meeting.upright.sigma_deg


@given(seed=SEEDS)
@law(15)
def test_no_uprights_no_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    roofs = edges(rng, 80, rng.choice([-35.0, 35.0], 80), 3.0)
    trees = edges(rng, 60, 0.0, 8.0)
    segments = joined(edges(rng, 150, 90.0, 2.0), roofs, trees, edges(rng, 200, rng.uniform(-90, 90, 200)))
    meeting = meeting_of(segments, UP, REACH)
    assert meeting is not None
    assert not meeting.certain


def test_hardly_any_edges() -> None:
    assert meeting_of(edges(np.random.default_rng(0), 5, 0.0), UP, REACH) is None


def test_the_stated_error_is_the_true_one() -> None:
    """Lines that lean by themselves, and walls that lean as a whole."""
    errors, sigmas = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        segments = edges(rng, 60, 0.0, 0.2)
        azimuth = np.arctan2(segments.middles[:, 0], segments.middles[:, 2])
        walls = rng.normal(0, 0.2, 13)[np.floor(6 * (azimuth / np.pi + 1)).astype(int)]
        meeting = meeting_of(edges(np.random.default_rng(seed), 60, walls, 0.2), UP, REACH)
        assert meeting is not None
        errors.append(angle_deg(meeting.upright.up, UP))
        sigmas.append(meeting.upright.sigma_deg)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / np.median(sigmas) < 1.5


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    scene, world = environment(furnished_room()), rotation(11)
    shots = [orientation(90 * k + 3, 12 * (-1) ** k, 9 if k < 2 else -4) for k in range(4)]
    return [
        frame_of(f"{k}", photograph(scene, CAMERA, r, noise=0.004, seed=k, supersampling=1), r @ world)
        for k, r in enumerate(shots)
    ]


@pytest.mark.parametrize("off_deg", [0.0, 14.0])
def test_a_furnished_room(room: list[Frame], off_deg: float) -> None:
    world = rotation(11)
    near = world.T @ orientation(20, off_deg).T @ UP
    upright = up_from_lines(room, [CAMERA], near, 25.0)
    assert upright is not None
    assert angle_deg(upright.up, world.T @ UP) < 0.2


@pytest.mark.parametrize("source", ["auto", "verticals"])
def test_upright_lines_are_better_than_rolled_cameras(room: list[Frame], source: LevelFrom) -> None:
    lines = level(room, [CAMERA], Levelling(source))
    assert lines.source == "vertical-lines"
    down = rotation(11).T @ -UP
    assert angle_deg(lines.levelled_from_world @ down, -UP) < 0.2
    assert lines.sigma_deg is not None
    assert lines.sigma_deg < 0.4
    cameras = level(room, [CAMERA], Levelling("cameras"))
    assert angle_deg(cameras.levelled_from_world @ down, -UP) > 1


def test_frames_of_an_ordinary_lens() -> None:
    focal, scene = 520.0, environment(furnished_room())
    camera = Camera(Perspective(focal), (600, 420), (299.5, 209.5), half_fov=math.atan(math.hypot(300, 210) / focal))
    rotations = [orientation(8, 6, 5), orientation(38, -8, -3)]
    frames = [frame_of(str(k), photograph(scene, camera, r, supersampling=1), r) for k, r in enumerate(rotations)]
    upright = up_from_lines(frames, [camera], UP, 25.0)
    assert upright is not None
    assert angle_deg(upright.up, UP) < 0.2


def test_a_mask_takes_its_edges_away(room: list[Frame]) -> None:
    nothing = [
        Frame(f.id, f.image, f.size, f.load, camera_from_world=f.camera_from_world, mask=lambda: dark) for f in room
    ]
    dark = np.zeros(CAMERA.size[::-1], np.uint8)
    assert len(find_segments(nothing, [CAMERA], UP).lengths) == 0
    assert up_from_lines(nothing, [CAMERA], UP, 25.0) is None


def test_a_landscape_without_lines() -> None:
    """Blurred speckle, and a horizon: no answer."""

    def scene(rays: FloatArray) -> FloatArray:
        speckle = sum(np.sin(rays @ wave + k) for k, wave in enumerate(waves)) / np.sqrt(len(waves))
        return np.repeat(np.where(rays[:, 1] < 0, 0.6, 0.2 + 0.08 * speckle)[:, None], 3, axis=1)

    waves = np.random.default_rng(0).normal(0, 60, (40, 3))
    rotations = np.array([orientation(90 * k, 5, 2) for k in range(4)])
    frames = frames_of(scene, CAMERA, rotations, lambda _, light: srgb8(light))
    assert up_from_lines(frames, [CAMERA], UP, 25.0) is None
