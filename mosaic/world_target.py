"""Calibration targets with known truth: any target's boards as they are printed, a box of boards, photos of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration.board import Artwork, Board, Placement
from fullsphere.model.calibration.boards import CharucoBoard
from fullsphere.model.calibration.targets import Target
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.photographer import photograph
from fullsphere.mosaic.world_sheets import Sheet, SheetScene, inked

_TEXELS = 1300  # along the longer side of a sheet, unless another size is asked for


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


def target_scene(
    target: Target | Sequence[Board], camera_position_mm: ArrayLike, *, texel_mm: float | None = None
) -> SheetScene:
    """The boards of a target under slightly uneven light, seen from a place (3,) in the target's frame.

    `texel_mm` should be about the spacing of the photo's samples on the nearest sheet: coarser blurs the print, finer
    gives steps in its edges.  By default the longer side of a sheet has about 1300 texels.
    """
    boards = target.boards if isinstance(target, Target) else target
    return SheetScene(tuple(_sheet(board, n, texel_mm) for n, board in enumerate(boards))).seen_from(camera_position_mm)


def photograph_target(
    target: Target | Sequence[Board],
    camera: Camera,
    camera_from_target: ArrayLike,
    translation_mm: ArrayLike,
    *,
    texel_mm: float | None = None,
    **photo: Any,
) -> NDArray[np.uint8]:
    """A photo of a target standing before the camera.

    The pose is that of `Poses`: a point of the target has the ray  camera_from_target @ point + translation  in the
    camera's frame, so its true pixel is `camera.project` of that.  `photo`: what `photograph` takes besides.
    """
    turn = np.asarray(camera_from_target, float)
    scene = target_scene(target, -turn.T @ np.asarray(translation_mm, float), texel_mm=texel_mm)
    return photograph(scene, camera, turn, **photo)


def pose_before_camera(
    board: Board,
    distance_mm: float,
    *,
    theta_deg: float = 0.0,
    phi_deg: float = 0.0,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    roll_deg: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """The pose (3, 3), (3,) that puts the middle of a board's paper at a distance in a direction, facing the camera.

    The direction is theta from the optical axis, phi from the picture's right to its bottom.  Facing means that the ray
    to the middle meets the paper squarely; the board is then turned by `tilt_deg` about its x and y axes and by
    `roll_deg` about that ray.  Meant for a flat board that is the whole target.
    """
    print_ = board.artwork()
    middle = board.placement.lift((np.array(print_.lower) + print_.upper) / 2)
    theta, phi = math.radians(theta_deg), math.radians(phi_deg)
    to_direction = Rotation.from_rotvec(theta * np.array([-math.sin(phi), math.cos(phi), 0.0]))
    turned = to_direction * Rotation.from_euler("ZYX", [roll_deg, tilt_deg[1], tilt_deg[0]], degrees=True)
    camera_from_target = turned.as_matrix() @ board.placement.target_from_board[:3, :3].T
    return camera_from_target, to_direction.apply([0.0, 0.0, distance_mm]) - camera_from_target @ middle


def _sheet(board: Board, number: int, texel_mm: float | None) -> Sheet:
    artwork = board.artwork()
    sides = np.subtract(artwork.upper, artwork.lower)
    texel = _dividing(artwork, float(sides.max()) / _TEXELS if texel_mm is None else texel_mm)
    return Sheet(board.placement, artwork.lower, artwork.upper, inked(artwork, texel), texel, _lamp(number))


def _dividing(artwork: Artwork, texel_mm: float) -> float:
    """The texel nearest to the one wanted of which the shortest edge has a whole number: edges fall between texels."""
    edges = [np.hypot(*(polygon - np.roll(polygon, 1, 0)).T) for polygon in artwork.polygons]
    shortest = float(min((edge.min() for edge in edges), default=texel_mm))
    return shortest / max(1, round(shortest / texel_mm))


def _lamp(number: int) -> FloatArray:
    """A slow ramp and a soft pool of light, of its own on each board."""
    random = np.random.default_rng(number)
    return np.concatenate([random.uniform(-0.12, 0.12, 2), random.uniform(-0.5, 0.5, 2), [0.14]])
