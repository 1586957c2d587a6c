"""What parallax leaves apart along a seam is drawn together, half by each frame."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, orientation, srgb8

from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.alignment import local_shifts
from fullsphere.mosaic.compose import plan
from fullsphere.mosaic.overview import overviews
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.shift import Shift
from laws import fisheye, pixel_rays

CAMERA = fisheye(500)
ROTATIONS = [orientation(yaw) for yaw in (0, 90, 180, 270)]
SPHERE = Equirectangular((256, 128))
APART = [orientation(0.5 * (-1) ** k, 0.2 * (-1) ** k) for k in range(4)]  # what each frame sees where it looks


def texture(rays: FloatArray) -> FloatArray:
    """Light (n, 3) with detail of some degrees everywhere."""
    rng = np.random.default_rng(5)
    waves = rng.normal(size=(40, 3))
    waves *= rng.uniform(15, 40, (40, 1)) / np.linalg.norm(waves, axis=1, keepdims=True)
    light = 0.4 + 0.05 * np.sin(rays @ waves.T + rng.uniform(0, 7, 40)).sum(-1)
    return np.repeat(np.clip(light, 0.02, 1)[:, None], 3, axis=1)


def mosaic_of(apart: list[FloatArray]) -> Mosaic:
    rays = pixel_rays(CAMERA)
    seen = np.isfinite(rays[..., 0])
    frames = []
    for k, (turn, other) in enumerate(zip(ROTATIONS, apart, strict=True)):
        light = np.zeros((*seen.shape, 3))
        light[seen] = texture(rays[seen] @ turn @ other.T)
        frames.append(frame_of(str(k), srgb8(light), turn))
    return Mosaic((CAMERA,), tuple(frames), ())


@pytest.fixture(scope="module")
def disagreeing() -> Mosaic:
    return mosaic_of(APART)


def owners_of(mosaic: Mosaic) -> NDArray[np.int16]:
    best: NDArray[np.int16] = np.argmax([one.quality for one in overviews(mosaic, SPHERE)], 0).astype(np.int16)
    return best


def shown(mosaic: Mosaic, k: int, shift: Shift | None, rays: FloatArray) -> FloatArray:
    """What of the scene (n, 3) frame k shows at directions (n, 3)."""
    turn = ROTATIONS[k]
    u, v = np.moveaxis(CAMERA.project(rays @ turn.T)[None], -1, 0)
    if shift is not None:
        u, v = shift.moved(u, v, CAMERA.size)
    return np.asarray(CAMERA.unproject(np.stack([u, v], -1)[0]) @ turn @ APART[k].T)


def test_frames_meet_at_their_seams(disagreeing: Mosaic) -> None:
    owners = owners_of(disagreeing)
    shifts = local_shifts(disagreeing, owners, SPHERE)
    assert all(shift is not None for shift in shifts)
    rays = pixel_rays(SPHERE)
    rows, columns = np.nonzero(owners != np.roll(owners, -1, 1))
    equator = np.abs(rows - 64) < 35
    before: list[float] = []
    after: list[float] = []
    for row, column in zip(rows[equator], columns[equator], strict=True):
        i, j = int(owners[row, column]), int(owners[row, (column + 1) % 256])
        ray = rays[row, column][None]
        for found, each in ((before, (None, None)), (after, (shifts[i], shifts[j]))):
            a, b = (shown(disagreeing, k, shift, ray) for k, shift in zip((i, j), each, strict=True))
            found.append(math.degrees(math.acos(min(float((a * b).sum()), 1))))
    assert np.median(before) > 0.9
    assert np.median(after) < 0.2
    assert np.percentile(after, 95) < 0.4


def test_shifts_fade_into_the_frames(disagreeing: Mosaic) -> None:
    for shift in local_shifts(disagreeing, owners_of(disagreeing), SPHERE):
        assert shift is not None
        middle = np.full((1, 1), 249.5)
        u, v = shift.moved(middle, middle, CAMERA.size)
        assert math.hypot(u[0, 0] - 249.5, v[0, 0] - 249.5) < 0.1
        assert np.linalg.norm(shift.values, axis=-1).max() < 2 * math.radians(0.6) * float(CAMERA.lens.slope(0.0))


def test_frames_that_agree_are_left_alone() -> None:
    """No picture of the bench of one scene is moved by more than a tenth of a pixel."""
    mosaic = mosaic_of([np.eye(3)] * 4)
    for shift in local_shifts(mosaic, owners_of(mosaic), SPHERE):
        assert shift is None or np.abs(shift.values).max() < 0.1


def test_where_matches_tell_that_frames_agree_nothing_is_looked_at(disagreeing: Mosaic) -> None:
    agreeing = dataclasses.replace(disagreeing, quality={"held_out_matches": 500, "held_out_median_px": 0.05})
    assert local_shifts(agreeing, owners_of(disagreeing), SPHERE) == (None,) * 4
    off = dataclasses.replace(disagreeing, quality={"held_out_matches": 500, "held_out_median_px": 1.0})
    assert any(local_shifts(off, owners_of(disagreeing), SPHERE))


def test_threads_change_nothing(disagreeing: Mosaic) -> None:
    owners = owners_of(disagreeing)
    alone = local_shifts(disagreeing, owners, SPHERE)
    with thread_pool(3) as pool:
        for one, other in zip(alone, local_shifts(disagreeing, owners, SPHERE, pool), strict=True):
            assert one is not None and other is not None
            np.testing.assert_array_equal(one.values, other.values)


def test_a_plan_holds_the_shifts(disagreeing: Mosaic) -> None:
    assert any(plan(disagreeing).shifts)
    assert not any(plan(disagreeing, blend="feather").shifts)


def test_what_is_moved_out_of_the_picture_is_nothing() -> None:
    shift = Shift(np.full((3, 4, 2), [5.0, -2.0], np.float32), 10.0)
    u, v = np.array([[0.0, 36.0, math.nan]]), np.array([[20.0, 20.0, math.nan]])
    moved_u, moved_v = shift.moved(u + 4, v + 4, (40, 30), border=4)
    np.testing.assert_allclose(moved_u, [[9.0, math.nan, math.nan]])
    np.testing.assert_allclose(moved_v, [[22.0, math.nan, math.nan]])
