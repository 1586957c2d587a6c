"""A cube map is six perspective views; its layouts, its edges, and the gutters round its faces."""

import dataclasses
import math
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.cube_map import FACES, LAYOUTS, CubeMap, Layout
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray, Perspective
from laws import SEEDS, law, pixel_rays, rotation, smooth_light

VIEWS_DEG = {"front": (0, 0), "right": (90, 0), "back": (180, 0), "left": (-90, 0), "up": (0, 90), "down": (0, -90)}
"""Yaw and pitch of each face."""

layouts = pytest.mark.parametrize("layout", LAYOUTS)


def face_rays(name: str, side: int, roll_deg: float = 0) -> FloatArray:
    """Rays (side, side, 3) of a face as those of a perspective camera of 90 degrees, turned."""
    camera = Camera(Perspective(side / 2), (side, side), ((side - 1) / 2,) * 2, half_fov=1.2)
    yaw, pitch = VIEWS_DEG[name]
    turn = Rotation.from_euler("YXZ", [yaw, pitch, roll_deg], degrees=True).as_matrix()
    return pixel_rays(camera) @ turn.T


@layouts
@pytest.mark.parametrize("gutter", [0, 3])
def test_each_face_is_a_perspective_view(layout: Layout, gutter: int) -> None:
    cube = CubeMap(12, layout, gutter)
    rays = pixel_rays(cube)
    assert set(cube.corners) == set(FACES)
    for name, (left, top) in cube.corners.items():
        upside_down = layout == "vertical-cross" and name == "back"
        expected = face_rays(name, 12, 180 if upside_down else 0)
        np.testing.assert_allclose(rays[top : top + 12, left : left + 12], expected, atol=1e-15)


def test_layouts() -> None:
    """Columns and rows of cells, from the left and the top."""
    cells = {
        layout: {name: (u // 7, v // 7) for name, (u, v) in CubeMap(7, layout).corners.items()} for layout in LAYOUTS
    }
    assert cells["strip"] == {name: (k, 0) for k, name in enumerate(FACES)}
    assert cells["3x2"] == {name: (k % 3, k // 3) for k, name in enumerate(FACES)}
    ring = {"left": (0, 1), "front": (1, 1), "right": (2, 1), "up": (1, 0), "down": (1, 2)}
    assert cells["cross"] == {**ring, "back": (3, 1)}
    assert cells["vertical-cross"] == {**ring, "back": (1, 3)}
    sizes = {layout: CubeMap(7, layout).size for layout in LAYOUTS}
    assert sizes == {"strip": (42, 7), "3x2": (21, 14), "cross": (28, 21), "vertical-cross": (21, 28)}
    assert get_args(Layout) == LAYOUTS


@pytest.mark.parametrize("layout", ["cross", "vertical-cross"])
def test_a_cross_looks_nowhere_outside_its_faces(layout: Layout) -> None:
    cube = CubeMap(10, layout)
    seen = np.isfinite(pixel_rays(cube)[..., 0])
    assert seen.sum() == 600
    beyond = cube.window_rays(slice(-5, 0), slice(0, 40))
    assert np.all(np.isnan(beyond))
    width, height = cube.size
    outside = [[-0.6, 12.0], [width - 0.4, 12.0], [12.0, -0.6], [12.0, height - 0.4], [2.0, 2.0]]
    assert np.all(np.isnan(cube.unproject(outside)))


def test_neighbours_of_a_cross_are_neighbours_on_the_cube() -> None:
    """Where two faces touch in the picture, rays go on across the edge by the step of a pixel."""
    for layout in ("cross", "vertical-cross"):
        rays = pixel_rays(CubeMap(50, layout))
        for axis in (0, 1):
            step = np.linalg.norm(np.diff(rays, axis=axis), axis=-1)
            np.testing.assert_array_less(step[np.isfinite(step)], 1.01 * 2 / 50)


def edge_rays() -> FloatArray:
    """Directions at all edges and corners of the cube, exactly."""
    along = np.linspace(-1, 1, 9)
    rays = []
    for axis in range(3):
        for a in (-1.0, 1.0):
            for b in (-1.0, 1.0):
                ray = np.empty((9, 3))
                ray[:, axis], ray[:, axis - 1], ray[:, axis - 2] = along, a, b
                rays.append(ray)
    return np.concatenate(rays)


@layouts
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("side", [16, 1001, 4096])
def test_an_edge_belongs_to_one_face(layout: Layout, dtype: Any, side: int) -> None:
    """A position rounds to a pixel of the face of the longest component: x before y before z."""
    cube = CubeMap(side, layout)
    rng = np.random.default_rng(0)
    exact = edge_rays()
    near = exact * (1 + rng.choice([-1e-16, 0, 1e-16, 1e-9, -1e-9], exact.shape))
    for rays in (exact, exact * 0.3, exact / 7, near):
        pixels = cube.project(rays, None, dtype)
        longest = np.argmax(np.abs(rays.astype(dtype)), axis=-1)
        sign = np.take_along_axis(rays, longest[:, None], -1)[:, 0] > 0
        names = np.array([["left", "up", "back"], ["right", "down", "front"]])[sign.astype(int), longest]
        corners = np.array([cube.corners[name] for name in names])
        inside = np.floor(pixels.astype(float) + 0.5) - corners
        assert np.all(pixels >= corners - 0.5)
        assert np.all(pixels < corners + side - 0.5)
        assert np.all((inside >= 0) & (inside < side))


@given(side=st.integers(1, 3000), seed=SEEDS, layout=st.sampled_from(LAYOUTS), gutter=st.integers(0, 1))
@law()
def test_there_and_back(side: int, seed: int, layout: Layout, gutter: int) -> None:
    cube = CubeMap(side, layout, gutter)
    rays = np.random.default_rng(seed).normal(size=(300, 3))
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    turn = rotation(seed)
    np.testing.assert_allclose(cube.unproject(cube.project(rays)), unit, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cube.unproject(cube.project(rays, turn)), unit @ turn.T, rtol=0, atol=1e-12)


@layouts
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_gutters_hold_what_lies_round_the_corner(layout: Layout, dtype: Any) -> None:
    cube, gutter, full = CubeMap(48, layout), 5, 1.0 if dtype is np.float32 else float(np.iinfo(dtype).max)
    light = np.nan_to_num(smooth_light(pixel_rays(cube))) * full
    image = (light if full == 1 else np.round(light)).astype(dtype)
    wide_image, wide = cube.with_gutters(image, gutter)
    assert wide == dataclasses.replace(cube, gutter=gutter)
    assert wide_image.dtype == dtype
    assert wide_image.shape == (*wide.size[::-1], 3)
    rays = pixel_rays(wide)
    seen = np.isfinite(rays[..., 0])
    off = wide_image.astype(float) - np.nan_to_num(smooth_light(rays)) * full
    rounding = 0 if full == 1 else 1
    assert np.abs(off[seen]).max() <= 0.006 * full + rounding  # linear interpolation at 48 pixels to 90 degrees
    assert not wide_image[~seen].any()
    for name, (left, top) in cube.corners.items():
        i, j = wide.corners[name]
        np.testing.assert_array_equal(wide_image[j : j + 48, i : i + 48], image[top : top + 48, left : left + 48])
    grey, _ = cube.with_gutters(image[..., 0], gutter)
    np.testing.assert_array_equal(grey, wide_image[..., 0])


def test_a_picture_of_another_size_gets_no_gutters() -> None:
    with pytest.raises(UsageError, match="30 x 20, not"):
        CubeMap(11).with_gutters(np.zeros((20, 30)), 2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"side": 0}, "whole number of pixels"),
        ({"side": 1 << 20, "layout": "strip"}, "whole number of pixels"),
        ({"side": 10, "layout": "star"}, "strip, 3x2, cross, vertical-cross"),
        ({"side": 10, "gutter": -1}, "gutter"),
        ({"side": 10, "gutter": 11}, "gutter"),
        ({"side": 10, "gutter": 1.5}, "gutter"),
        ({"side": 10, "gutter": math.nan}, "gutter"),
        ({"side": math.nan}, "whole number of pixels"),
    ],
)
def test_a_cube_that_is_none_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        CubeMap(**values)
