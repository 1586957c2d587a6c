"""A known three-dimensional calibration target: ChArUco boards on the inside of an open box round the camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from fullsphere.model.calibration.board import Placement
from fullsphere.model.calibration.boards import CharucoBoard, marker_dictionary
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.world_panels import Light, Panel, PanelScene

PAPER, INK = 0.8, 0.05
"""Reflectance of the boards' paper and ink."""

_TEXELS = 80  # along a square: somewhat finer than the pixels of the photos it is made for
_MARGIN = 0.25  # of a square: white paper round the chessboard


def charuco_box() -> tuple[CharucoBoard, ...]:
    """Five boards: in front, left, right, above and below, the last four reaching behind the camera's plane.

    In the target's frame (mm; x right, y down, z to the front) a camera near the origin that looks along +z sees all
    of them, and sees corners beyond 90 degrees from its axis.  Distances and square sizes differ from board to board.
    """
    dictionary = "DICT_5X5_1000"
    walls = [  # squares in a row and column, square (mm), origin, direction of x, direction of y
        (16, 14, 74.0, (-600.0, -530.0, 640.0), (1, 0, 0), (0, 1, 0)),
        (13, 15, 66.0, (-610.0, -500.0, -240.0), (0, 0, 1), (0, 1, 0)),
        (12, 14, 72.0, (640.0, -515.0, 620.0), (0, 0, -1), (0, 1, 0)),
        (17, 12, 68.0, (-585.0, -560.0, -220.0), (1, 0, 0), (0, 0, 1)),
        (16, 13, 70.0, (-570.0, 545.0, 610.0), (1, 0, 0), (0, 0, -1)),
    ]
    boards: list[CharucoBoard] = []
    for squares_x, squares_y, square, origin, x_axis, y_axis in walls:
        pose = np.eye(4)
        pose[:3] = np.stack([x_axis, y_axis, np.cross(x_axis, y_axis), origin], -1)
        first_id = boards[-1].first_id + boards[-1].marker_count if boards else 0
        boards.append(CharucoBoard(squares_x, squares_y, square, 0.7 * square, first_id, dictionary, Placement(pose)))
    return tuple(boards)


def target_scene(boards: tuple[CharucoBoard, ...], camera_position_mm: ArrayLike) -> PanelScene:
    """The boards under slightly uneven light, seen from a place (3,) in the target's frame."""
    return PanelScene(tuple(_panel(board) for board in boards)).seen_from(camera_position_mm)


def _panel(board: CharucoBoard) -> Panel:
    texture = _printed(board)
    texel_mm = board.square_mm / _TEXELS
    sides = np.array(texture.shape[1::-1]) * texel_mm
    corner = board.placement.lift(np.full(2, -_margin_texels() * texel_mm))
    axes = board.placement.target_from_board[:3, :2]
    return Panel(corner, axes[:, 0] * sides[0], axes[:, 1] * sides[1], texture * _uneven_light(board, texture.shape))


def _margin_texels() -> int:
    return round(_MARGIN * _TEXELS)


def _printed(board: CharucoBoard) -> Light:
    """Reflectance (h, w, 3) of the printed board with its margin; square borders fall between texels."""
    dictionary = marker_dictionary(board.dictionary)
    row, column = np.indices((board.squares_y, board.squares_x))
    white = np.kron((row + column) % 2, np.ones((_TEXELS, _TEXELS))) > 0
    side = round(_TEXELS * board.marker_mm / board.square_mm)
    gap = (_TEXELS - side) // 2
    for number, (i, j) in enumerate(board.marker_squares()):
        marker = cv2.aruco.generateImageMarker(dictionary, board.first_id + number, side)
        top, left = j * _TEXELS + gap, i * _TEXELS + gap
        white[top : top + side, left : left + side] = marker > 127
    reflectance = np.where(np.pad(white, _margin_texels(), constant_values=True), PAPER, INK)
    return np.asarray(np.repeat(reflectance[..., None], 3, -1), np.float32)


def _uneven_light(board: CharucoBoard, shape: tuple[int, ...]) -> Light:
    """Light (h, w, 3) on a board: a slow ramp and a soft pool of light, a little warm, of its own on each board."""
    random = np.random.default_rng(board.first_id)
    v, u = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
    slope: FloatArray = random.uniform(-0.12, 0.12, 2)
    pool_u, pool_v = random.uniform(-0.5, 0.5, 2)
    level = 0.82 + slope[0] * u + slope[1] * v + 0.14 * np.exp(-((u - pool_u) ** 2) - (v - pool_v) ** 2)
    return np.asarray(level[..., None] * [1.02, 1.0, 0.95], np.float32)
