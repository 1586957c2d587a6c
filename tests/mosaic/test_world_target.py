"""Printed targets are shown where they are, as measured here without the program's own detectors."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.board import Artwork, Board, Placement
from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
from fullsphere.model.calibration.cylinder import cylinder
from fullsphere.model.calibration.targets import Target
from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, FloatArray
from fullsphere.mosaic.world_sheets import INK, PAPER, SheetScene, inked
from fullsphere.mosaic.worlds import charuco_box, photograph, photograph_target, pose_before_camera, target_scene

CHESS: list[tuple[Board, float]] = [
    (Chessboard(9, 6, 30.0), 10.0),
    (CharucoBoard(10, 7, 30.0, 20.0), 60.0),
    (AprilGrid(5, 4, 44.0, 0.3), 75.0),
]


def wide_camera(side: int = 1000, half_fov_deg: float = 95.0) -> Camera:
    half = math.radians(half_fov_deg)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    lens = lens.scaled(0.48 * side / float(lens.radius(half)))
    return Camera(lens, (side, side), (side / 2 + 2.3, side / 2 - 1.7), half_fov=half, aspect=1.002)


def linear(photo: NDArray[np.uint8]) -> NDArray[np.float32]:
    x = photo[..., 1] / np.float32(255)
    return np.asarray(np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), np.float32)


def true_pixels(points: FloatArray, camera: Camera, turn: FloatArray, shift: FloatArray) -> FloatArray:
    pixels = camera.project(points @ turn.T + shift)
    u, v = pixels.T
    clear = (u > 10) & (u < camera.size[0] - 11) & (v > 10) & (v < camera.size[1] - 11)
    return np.asarray(pixels[clear], float)


def crossings(photo: NDArray[np.uint8], near: FloatArray) -> FloatArray:
    """OpenCV's own search for the crossing of two edges."""
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    start = near[:, None].astype(np.float32)
    found = cv2.cornerSubPix(np.ascontiguousarray(photo[..., 1]), start, (4, 4), (-1, -1), stop)
    return np.asarray(found, float).reshape(-1, 2)


@pytest.mark.parametrize(("board", "theta_deg"), CHESS, ids=lambda value: type(value).__name__)
def test_crossings_are_where_the_exact_camera_puts_them(board: Board, theta_deg: float) -> None:
    camera = wide_camera()
    turn, shift = pose_before_camera(board, 150.0, theta_deg=theta_deg, phi_deg=25.0, tilt_deg=(12, -9), roll_deg=7)
    photo = photograph_target(Target("one", (board,)), camera, turn, shift, blur_px=0.8, noise=0.002)
    expected = true_pixels(board.marks_on_target(), camera, turn, shift)
    assert len(expected) > 30
    off = crossings(photo, expected) - expected
    assert np.median(np.hypot(*off.T)) < 0.05
    assert np.all(np.abs(np.median(off, 0)) < 0.02)


def test_discs_are_where_the_exact_camera_puts_them() -> None:
    camera = wide_camera()
    board = CirclesGrid(6, 5, 25.0, 12.0, asymmetric=True)
    turn, shift = pose_before_camera(board, 170.0, theta_deg=55.0, phi_deg=200.0, tilt_deg=(10, 15))
    photo = linear(photograph_target([board], camera, turn, shift))
    radius, angle = np.meshgrid(6.0 * np.sqrt((np.arange(40) + 0.5) / 40), np.arange(0, 2 * math.pi, 0.05))
    disc = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).reshape(-1, 2)  # equal areas of paper
    for centre in board.marks_on_paper():
        image = camera.project(board.placement.lift(centre + disc) @ turn.T + shift)
        step = 1e-3 * np.eye(2)  # the camera's magnification varies over the disc: a part counts by its image's area
        sides = [camera.project(board.placement.lift(centre + disc + s) @ turn.T + shift) - image for s in step]
        area = np.abs(sides[0][:, 0] * sides[1][:, 1] - sides[0][:, 1] * sides[1][:, 0])
        expected = np.average(image, axis=0, weights=area)
        left, top = np.floor(image.min(0)).astype(int) - 3
        right, bottom = np.ceil(image.max(0)).astype(int) + 4
        window = photo[top:bottom, left:right]
        dark = np.maximum(np.percentile(window, 90) * 0.9 - window, 0)
        v, u = np.mgrid[top:bottom, left:right]
        found = np.array([np.average(u, weights=dark), np.average(v, weights=dark)])
        assert np.hypot(*(found - expected)) < 0.05, centre


def test_a_strip_in_a_tube_is_where_the_exact_camera_puts_it() -> None:
    camera, board = wide_camera(1400), cylinder(150.0, 420.0, 45.0, 32.0)
    turn = Rotation.from_euler("YXZ", [1.5, -1.0, 8.0], degrees=True).as_matrix()
    shift = -turn @ np.array([3.0, -2.0, 15.0])
    expected = true_pixels(board.marks_on_target(), camera, turn, shift)
    photo = photograph_target([board], camera, turn, shift, texel_mm=0.2, blur_px=0.6, noise=0.002)
    middle = np.hypot(*(expected - camera.centre).T) > 0.35 * 700  # further in the squares are narrower than the window
    off = (crossings(photo, expected) - expected)[middle]
    assert len(off) > 60
    assert np.median(np.hypot(*off.T)) < 0.05
    assert np.all(np.abs(np.median(off, 0)) < 0.02)


def test_black_and_white_alternate_across_the_seam_of_a_tube() -> None:
    board = cylinder(100.0, 100.0, 25.0, 18.0)
    scene = target_scene([board], (0.0, 0.0, 0.0), texel_mm=0.5)
    angle, height = np.arange(board.squares_x) * board.square_mm / 100.0, np.array([1.03, 2.03]) * board.square_mm

    def light(turned: float) -> NDArray[np.float32]:
        a, z = np.meshgrid(angle + turned / 100.0, height)
        return scene.radiance(np.stack([100 * np.cos(a), 100 * np.sin(a), z], -1))[..., 1]

    ends = np.stack([light(0.8), light(board.square_mm - 0.8)])  # just inside a square: no marker is there
    dark = ends < (PAPER + INK) / 2 * 0.7
    assert np.array_equal(dark[0], dark[1])
    assert np.array_equal(dark[0, 0], np.arange(board.squares_x) % 2 == 1)
    assert np.array_equal(dark[0, 1], np.arange(board.squares_x) % 2 == 0)


def test_every_mark_of_the_box_meets_four_alternating_quarters() -> None:
    boards = charuco_box()
    eye = np.array([25.0, -18.0, 12.0])
    scene = target_scene(boards, eye)
    for board in boards:
        marks = board.marks_on_paper()
        quarters = [
            scene.radiance(board.placement.lift(marks + np.array([x, y])) - eye)[:, 1]
            for x, y in [(2, 2), (-2, 2), (-2, -2), (2, -2)]
        ]
        black = np.array(quarters) < 0.3
        assert np.mean(np.all(black[0] == black[2], 0) & (black[0] != black[1]) & (black[1] == black[3])) > 0.98


@pytest.mark.parametrize("step", [0.1, 0.37, 1.3])
def test_ink_covers_each_texel_exactly_its_share(step: float) -> None:
    """Rectangles against the product of one-dimensional overlaps; a triangle and a disc against area and centroid."""
    corners = np.array([[3.17, 2.05], [11.61, 9.42]])
    rectangle = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (corners[1] - corners[0]) + corners[0]
    for polygon in (rectangle, rectangle[::-1]):
        ink = inked(Artwork((0.0, 0.0), (20.0, 15.0), (polygon,)), step)
        shares = []
        for count, low, high in zip(ink.shape[::-1], *corners, strict=True):
            edges = np.arange(count + 1) * step
            shares.append(np.diff(np.clip(edges, low, high)) / step)
        np.testing.assert_allclose(ink / 255, np.outer(shares[1], shares[0]), atol=0.0025)
    triangle = np.array([[2.1, 1.3], [17.7, 4.9], [6.2, 13.3]])
    (ax, ay), (bx, by) = triangle[1] - triangle[0], triangle[2] - triangle[0]
    shapes = [
        (Artwork((0.0, 0.0), (20.0, 15.0), (triangle,)), abs(ax * by - ay * bx) / 2, triangle.mean(0)),
        (Artwork((0.0, 0.0), (20.0, 15.0), (), np.array([[9.3, 7.1, 4.6]])), math.pi * 4.6**2, np.array([9.3, 7.1])),
    ]
    for artwork, area, centroid in shapes:
        cover = inked(artwork, step) / 255
        v, u = (np.indices(cover.shape) + 0.5) * step
        assert cover.sum() * step**2 == pytest.approx(area, rel=1e-3)
        np.testing.assert_allclose([np.average(u, weights=cover), np.average(v, weights=cover)], centroid, atol=3e-3)


def seen_by_hand(scene: SheetScene, ray: FloatArray) -> float:
    """The light along one ray, from the formulas of `Placement` and the ink's picture, without the kernel's algebra."""
    best, light = math.inf, 0.02
    for sheet in scene.sheets:
        pose, radius = sheet.placement.target_from_board, sheet.placement.radius_mm
        eye, d = pose[:3, :3].T @ (np.array(scene.position) - pose[:3, 3]), pose[:3, :3].T @ ray
        if math.isinf(radius):
            distances = [-eye[2] / d[2]]
        else:
            height = eye[2] + radius
            roots = np.roots(
                [d[0] ** 2 + d[2] ** 2, 2 * (eye[0] * d[0] + height * d[2]), eye[0] ** 2 + height**2 - radius**2]
            )
            distances = sorted(roots.real) if np.isreal(roots).all() else []
        for distance in distances:
            x, y, z = eye + distance * d
            if math.isinf(radius):
                across, behind = x, d[2] < 0
            else:
                across = radius * math.atan2(x, z + radius)
                behind = x * d[0] + (z + radius) * d[2] < 0
                middle = (sheet.lower[0] + sheet.upper[0]) / 2
                while across < middle - math.pi * radius:
                    across += 2 * math.pi * radius
                while across > middle + math.pi * radius:
                    across -= 2 * math.pi * radius
            on_paper = sheet.lower[0] <= across <= sheet.upper[0] and sheet.lower[1] <= y <= sheet.upper[1]
            if 0 < distance < best and on_paper:
                texel = (np.array([across, y]) - sheet.lower) / sheet.texel_mm - 0.5
                u, v = np.clip(texel, 0, np.array(sheet.ink.shape[::-1]) - 1.0)
                picture = cv2.copyMakeBorder(sheet.ink, 0, 1, 0, 1, cv2.BORDER_REPLICATE)
                j, i = int(u), int(v)
                (a, b), (c, e) = picture[i : i + 2, j : j + 2] / 255.0
                share = (a * (j + 1 - u) + b * (u - j)) * (i + 1 - v) + (c * (j + 1 - u) + e * (u - j)) * (v - i)
                p, q = 2 * (np.array([across, y]) - sheet.lower) / np.subtract(sheet.upper, sheet.lower) - 1
                p = p if math.isinf(radius) else math.sin(across / radius)
                lamp = sheet.lamp
                level = 0.82 + lamp[0] * p + lamp[1] * q
                level += lamp[4] * math.exp(-((p - lamp[2]) ** 2) - (q - lamp[3]) ** 2)
                best, light = distance, level * (PAPER + (INK - PAPER) * (0.0 if behind else share))
    return light


def test_kernel_agrees_with_its_twin_on_flat_and_rolled_sheets_that_hide_each_other() -> None:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.4, -0.3, 0.2]).as_matrix()
    pose[:3, 3] = (30.0, 20.0, 260.0)
    flat = CharucoBoard(6, 5, 40.0, 30.0, placement=Placement(pose))
    half = cylinder(180.0, 300.0, 40.0, 30.0, part=0.5)
    for eye in ((0.0, 0.0, 0.0), (400.0, 80.0, 90.0), (-60.0, -250.0, 150.0)):
        scene = target_scene([flat, half, cylinder(150.0, 90.0, 40.0, 30.0)], eye, texel_mm=1.0)
        rays = np.random.default_rng(3).standard_normal((400, 3))
        got = scene.radiance(rays)
        expected = np.array([seen_by_hand(scene, ray) for ray in rays])
        np.testing.assert_allclose(got[:, 1], expected, rtol=1e-4, atol=1e-5)
        assert np.unique(np.round(expected, 3)).size > 20
        np.testing.assert_allclose(got[:, 0] / got[:, 2], 1.02 / 0.95, rtol=1e-5)
    assert target_scene([flat], (0, 0, 0)).radiance([np.nan, 0.0, 1.0]).tolist() == [0.0, 0.0, 0.0]
    assert target_scene([], (0, 0, 0)).radiance([0.0, 0.0, 1.0])[1] == pytest.approx(0.02)


def test_the_back_of_a_board_is_blank() -> None:
    board = Chessboard(4, 4, 20.0)
    x, y = np.meshgrid(np.linspace(1, 99, 60), np.linspace(1, 99, 60))
    paper = np.stack([x, y, np.zeros_like(x)], -1)
    front, back = (target_scene([board], eye).radiance(paper - eye) for eye in ((50, 50, -300), (50, 50, 300)))
    assert np.mean(front < 0.2) > 0.4 and back.min() > 0.5


def test_a_board_stands_before_the_camera_as_asked() -> None:
    board = AprilGrid(4, 3, 30.0, 0.3, placement=Placement(charuco_box()[2].placement.target_from_board))
    artwork = board.artwork()
    middle = board.placement.lift((np.array(artwork.lower) + artwork.upper) / 2)
    turn, shift = pose_before_camera(board, 321.0, theta_deg=100.0, phi_deg=90.0)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    down = np.array([0.0, math.sin(math.radians(100)), math.cos(math.radians(100))])
    np.testing.assert_allclose(turn @ middle + shift, 321.0 * down, atol=1e-9)
    np.testing.assert_allclose(turn @ board.placement.target_from_board[:3, 2], down, atol=1e-12)


def test_blur_is_that_of_the_whole_picture_in_linear_light() -> None:
    camera = wide_camera(700)  # several strips
    board = Chessboard(7, 7, 40.0)
    turn, shift = pose_before_camera(board, 90.0)
    sharp, blurred = (linear(photograph_target([board], camera, turn, shift, blur_px=blur)) for blur in (0.0, 1.3))
    expected = cv2.GaussianBlur(sharp, (0, 0), 1.3)
    assert np.abs(blurred - expected).max() < 0.01
    assert np.abs(blurred - sharp).max() > 0.1


def test_one_photo_is_the_other_one_s_verb() -> None:
    camera, boards = wide_camera(200), charuco_box()
    turn = Rotation.from_euler("YXZ", [3, -2, 1], degrees=True).as_matrix()
    eye = np.array([5.0, 6.0, -7.0])
    assert np.array_equal(
        photograph_target(boards, camera, turn, -turn @ eye, noise=0.01),
        photograph(target_scene(boards, eye), camera, turn, noise=0.01),
    )
