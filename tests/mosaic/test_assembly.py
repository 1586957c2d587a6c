"""The 360 x 360 mosaic of a turn whose frames, angles and world are known: here a sphere of colours, far or near."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear, linear_from_encoded
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.model.surface import Mosaic360
from fullsphere.mosaic.arm import ArmTurn, mount_of, positions
from fullsphere.mosaic.assembly import assemble, reach_of
from fullsphere.mosaic.even_light import even_light
from fullsphere.mosaic.eyes import eyes_of, mosaic_of
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.turn_pictures import TurnPictures
from fullsphere.mosaic.turn_reader import TurnReader

HALF_FOV = math.radians(92.5)
CAMERA = Camera(Equidistant(70.0), (230, 230), (114.6, 113.8), half_fov=HALF_FOV)
WIDTH = 128


def colours(towards: FloatArray) -> FloatArray:
    """Smooth linear light (..., 3) in a direction."""
    unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    waves = unit @ np.array([[3.0, -1, 4], [1, 5, -2], [-4, 2, 3]]).T
    return np.asarray(0.45 + 0.3 * np.sin(waves))


def met(origin: FloatArray, rays: FloatArray, radius: float) -> FloatArray:
    """Where rays from inside meet a sphere around the turning axis; the rays themselves if it is infinite."""
    if math.isinf(radius):
        return rays
    along = (origin * rays).sum(-1)
    reach = -along + np.sqrt(along**2 + radius**2 - (origin**2).sum(-1))
    return np.asarray(origin + reach[..., None] * rays)


def photographed(angles: FloatArray, mount: FloatArray, radius: float, ev: FloatArray) -> ArmTurn:
    pixels = np.stack(np.meshgrid(np.arange(230.0), np.arange(230.0)), -1)
    own = CAMERA.unproject(pixels)
    turn = ArmTurn(CAMERA, tuple(_frame(k) for k in range(len(angles))), angles, mount)
    frames = []
    for frame, rotation, place, more in zip(
        turn.frames, turn.camera_from_world(angles), positions(angles), ev, strict=True
    ):
        light = np.nan_to_num(colours(met(place, own @ rotation, radius))) * 2.0**more
        codes = encoded_from_linear(light.astype(np.float32), np.uint16)
        frames.append(Frame(frame.id, "", CAMERA.size, lambda codes=codes: codes))  # type: ignore[misc]
    return ArmTurn(CAMERA, tuple(frames), angles, mount)


def _frame(k: int) -> Frame:
    return Frame(f"frame {k}", "", CAMERA.size, lambda: np.zeros((230, 230, 3), np.uint8))


def opened(turn: ArmTurn, kept_bytes: int = 1 << 30) -> TurnPictures:
    pictures = TurnPictures(CAMERA, math.radians(40), kept_bytes)
    for frame in turn.frames:
        pictures.read(frame)
    return pictures


def assembled(
    turn: ArmTurn, pictures: TurnPictures, guide: NDArray[np.float32] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    light, seen = np.zeros((WIDTH, WIDTH, 3), np.float32), np.zeros((WIDTH, WIDTH), bool)
    reader = TurnReader(turn, pictures, Mosaic360((WIDTH, WIDTH)), guide)
    for part in assemble(reader, even_light(reader), np.float32):
        here = slice(part.left, part.left + part.seen.shape[1])
        light[:, here], seen[:, here] = part.codes, part.seen
    return light, seen


def truth(radius: float) -> FloatArray:
    surface = Mosaic360((WIDTH, WIDTH))
    alphas = (np.arange(WIDTH) + 0.5) * 2 * np.pi / WIDTH
    return colours(met(positions(alphas)[None], surface.window_rays(slice(0, WIDTH), slice(0, WIDTH)), radius))


def nearness(radius: float) -> NDArray[np.float32]:
    return np.full((32, 32), 1 / math.sqrt(radius**2 - 1), np.float32)


def worst(light: NDArray[np.float32], radius: float) -> float:
    return float(np.abs(light - truth(radius)).max())


EVEN = np.arange(48) * 2 * np.pi / 48
STILL = np.zeros(48)


def test_far_things_are_where_they_are() -> None:
    turn = photographed(EVEN, np.eye(3), math.inf, STILL)
    light, seen = assembled(turn, opened(turn))
    assert seen.all()
    assert worst(light, math.inf) < 0.004


def test_near_things_are_where_they_are_with_a_guide_and_smear_without() -> None:
    turn = photographed(EVEN, mount_of(0.004, -0.012, 0.009), 3.0, STILL)
    pictures = opened(turn)
    guided, _ = assembled(turn, pictures, nearness(3.0))
    plain, _ = assembled(turn, pictures)
    assert worst(guided, 3.0) < 0.006
    assert worst(plain, 3.0) > 3 * worst(guided, 3.0)


def test_uneven_angles_and_a_wide_gap_leave_no_hole() -> None:
    angles = np.delete(EVEN + 0.02 * np.sin(7 * EVEN), [10, 30])
    turn = photographed(angles, np.eye(3), 4.0, np.zeros(46))
    light, seen = assembled(turn, opened(turn), nearness(4.0))
    assert seen.all()
    assert worst(light, 4.0) < 0.008


def test_flicker_is_evened_out() -> None:
    ev = np.random.default_rng(4).normal(0, 0.3, 48)
    turn = photographed(EVEN, np.eye(3), math.inf, ev - ev.mean() - 0.4)
    light, _ = assembled(turn, opened(turn))
    level = np.median(light / truth(math.inf))
    assert level == pytest.approx(2**-0.4, rel=0.02)
    assert np.abs(light / level - truth(math.inf)).max() < 0.03


def test_flicker_of_less_than_a_code_is_found() -> None:
    ev = np.random.default_rng(6).normal(0, 0.01, 48)
    turn = photographed(EVEN, np.eye(3), math.inf, ev)
    frames = [dataclasses.replace(f, load=lambda f=f: (f.load() >> 8).astype(np.uint8)) for f in turn.frames]  # type: ignore[misc]
    coarse = dataclasses.replace(turn, frames=tuple(frames))
    gains = even_light(TurnReader(coarse, opened(coarse), Mosaic360((WIDTH, WIDTH)), None))
    off = -np.log2(gains).mean(1) - (ev - ev.mean())
    assert off.std() < 0.7 * ev.std()


def test_frames_that_are_not_kept_are_opened_again_and_give_the_same() -> None:
    turn = photographed(EVEN, np.eye(3), math.inf, STILL)
    kept, _ = assembled(turn, opened(turn))
    again, _ = assembled(turn, opened(turn, kept_bytes=0))
    np.testing.assert_array_equal(kept, again)


def test_a_lens_tilted_further_than_it_sees_leaves_holes_that_are_not_seen() -> None:
    turn = photographed(EVEN, mount_of(0, math.radians(20), 0), math.inf, STILL)
    _, seen = assembled(turn, opened(turn))
    assert 0 < np.mean(~seen) < 0.5


def test_close_frames_are_averaged_more() -> None:
    assert reach_of(ArmTurn(CAMERA, tuple(_frame(k) for k in range(48)), EVEN)) == 1
    assert reach_of(ArmTurn(CAMERA, tuple(_frame(k) for k in range(180)), np.arange(180) * np.pi / 90)) == 2


def test_eyes_are_the_mosaics_halves() -> None:
    mosaic = linear_from_encoded(np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8))
    np.testing.assert_array_equal(mosaic_of(*eyes_of(mosaic)), mosaic)


def test_both_eyes_see_far_things_in_one_direction() -> None:
    left, right = eyes_of(truth(math.inf))
    np.testing.assert_allclose(left, right, atol=1e-6)
    height, width = left.shape[:2]
    lon, lat = (
        (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi,
        0.5 * np.pi - (np.arange(height) + 0.5) / height * np.pi,
    )
    ahead = np.stack(
        np.broadcast_arrays(
            np.cos(lat)[:, None] * np.sin(lon), -np.sin(lat)[:, None], np.cos(lat)[:, None] * np.cos(lon)
        ),
        -1,
    )
    np.testing.assert_allclose(left, colours(ahead), atol=1e-6)
