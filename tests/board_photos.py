"""Photos of a flat printed board with known truth: each pixel's rays are followed to the paper."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.board import Board
from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.lens import BaksteinPajdla, FloatArray

_SAMPLES = 3  # of each pixel, in each direction
_PAPER, _INK, _ROOM = 0.75, 0.03, 0.2  # how bright, linear light


def wide_camera(width: int = 800, height: int = 640) -> Camera:
    """A lens of 183 degrees whose circle just fits the height."""
    half = math.radians(91.5)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    lens = lens.scaled(0.485 * height / float(lens.radius(half)))
    return Camera(lens, (width, height), (width / 2 + 2.3, height / 2 - 1.6), half_fov=half)


def board_pose(
    board: Board, theta_deg: float, phi_deg: float, distance: float, tilt_deg: float = 0.0, roll_deg: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) of a board that faces the camera, seen theta off the axis.

    With `tilt_deg` it is turned about its own y, and with `roll_deg` about its normal.
    """
    theta, phi = math.radians(theta_deg), math.radians(phi_deg)
    ray = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
    off_axis = Rotation.from_rotvec(theta * np.array([-math.sin(phi), math.cos(phi), 0.0]))
    own = Rotation.from_euler("YZ", [tilt_deg, roll_deg], degrees=True)
    turn = (off_axis * own).as_matrix()
    middle = board.marks_on_target().mean(0)
    return turn, distance * ray - turn @ middle


def photograph_board(
    board: Board,
    camera: Camera,
    pose: tuple[FloatArray, FloatArray],
    *,
    noise: float = 0.005,
    blur_px: float = 0.5,
    shade: float = 0.0,
) -> NDArray[np.uint8]:
    """The photo (h, w), sRGB codes; with `shade` the light falls off to (1 - shade) from left to right."""
    turn, translation = pose
    width, height = camera.size
    paper, scale, lower = _paper(board)
    sub = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    start = -turn.T @ translation
    (left, top), (right, bottom) = _box(board, camera, pose)
    light = np.full((height, width), _ROOM * _SAMPLES**2)
    for dv in sub:
        for du in sub:
            u, v = np.meshgrid(np.arange(left, right) + du, np.arange(top, bottom) + dv)
            rays = camera.unproject(np.stack([u, v], -1)) @ turn  # in the board's frame
            with np.errstate(invalid="ignore", divide="ignore"):
                distance = -start[2] / rays[..., 2]
                place = start[:2] + distance[..., None] * rays[..., :2]
                at = np.where((distance > 0)[..., None], (place - lower) * scale - 0.5, -1e4)
            at = np.nan_to_num(at, nan=-1e4).clip(-1e4, 3e4).astype(np.float32)
            light[top:bottom, left:right] += cv2.remap(
                paper, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=_ROOM
            ) - np.float32(_ROOM)
    light /= _SAMPLES**2
    light *= 1 - shade * np.linspace(0, 1, width)
    if blur_px:
        light = cv2.GaussianBlur(light, (0, 0), blur_px)
    light += np.random.default_rng(0).normal(0, noise, light.shape)
    return np.asarray(encoded_from_linear(light[..., None].clip(0, 1), np.uint8)[..., 0])


def truth(board: Board, camera: Camera, pose: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Where the marks (n, 2) are in the photo."""
    turn, translation = pose
    return camera.project(board.marks_on_target() @ turn.T + translation)


def _paper(board: Board) -> tuple[NDArray[np.float32], float, FloatArray]:
    """The print as a picture, its pixels per mm, and the corner of the paper where it begins."""
    art = board.artwork()
    lower, upper = np.array(art.lower), np.array(art.upper)
    scale = 1600 / float(np.max(upper - lower))
    size = np.ceil((upper - lower) * scale).astype(int)
    ink = np.zeros((size[1], size[0]), np.uint8)
    shift = 6
    for polygon in art.polygons:
        corners = np.rint(((polygon - lower) * scale - 0.5) * 2**shift).astype(np.int32)
        cv2.fillConvexPoly(ink, corners, 255, cv2.LINE_AA, shift)
    for x, y, radius in art.discs:
        turn = np.linspace(0, 2 * np.pi, 400)
        outline = np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], -1)
        corners = np.rint(((outline - lower) * scale - 0.5) * 2**shift).astype(np.int32)
        cv2.fillConvexPoly(ink, corners, 255, cv2.LINE_AA, shift)
    share = ink.astype(np.float32) / 255
    return np.asarray(_PAPER + (_INK - _PAPER) * share, np.float32), scale, lower


def _box(board: Board, camera: Camera, pose: tuple[FloatArray, FloatArray]) -> tuple[tuple[int, int], tuple[int, int]]:
    """First and last pixels, and one more, that may show the paper."""
    art = board.artwork()
    x, y = np.meshgrid(*(np.linspace(a, b, 40) for a, b in zip(art.lower, art.upper, strict=True)))
    turn, translation = pose
    points = board.placement.lift(np.stack([x, y], -1).reshape(-1, 2))
    pixels = camera.project(points @ turn.T + translation)
    if np.isnan(pixels).any():
        return (0, 0), camera.size
    lower = np.clip(np.floor(pixels.min(0)) - 3, 0, camera.size).astype(int)
    upper = np.clip(np.ceil(pixels.max(0)) + 4, 0, camera.size).astype(int)
    return (int(lower[0]), int(lower[1])), (int(upper[0]), int(upper[1]))
