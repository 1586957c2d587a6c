"""Finds the marks of a target in one photo, whatever its kind of board."""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import Board, MarksFound
from fullsphere.model.calibration.boards import Chessboard, CirclesGrid, CodedBoard
from fullsphere.model.calibration.detect_chessboard import find_chessboard
from fullsphere.model.calibration.detect_circles import find_circles
from fullsphere.model.calibration.detect_coded import find_coded
from fullsphere.model.calibration.targets import Target
from fullsphere.model.colour import linear_from_encoded
from fullsphere.model.errors import UsageError


def find_marks(picture: NDArray[Any], target: Target) -> MarksFound:
    """Find the marks of a target.

    Parameters
    ----------
    picture
        Photo (h, w) or (h, w, 3), uint8, sRGB.
    target
        What to look for.

    Returns
    -------
    The marks found, numbered as in `target.points`; none if there is no target.

    Raises
    ------
    UsageError
        If the picture is not 8-bit, or several boards without codes are to be told apart.
    """
    grey, light = grey_and_light(picture)
    boards = target.boards
    if isinstance(boards[0], CodedBoard):
        found = find_coded(grey, light, cast("tuple[CodedBoard, ...]", boards))
    elif len(boards) == 1:
        found = (_find_uncoded(grey, light, boards[0]),)
    else:
        raise UsageError(f"{target.name}: several boards in one photo need codes to be told apart; use ChArUco boards")
    marks = [first + part.marks for first, part in zip(target.first_marks, found, strict=True)]
    return MarksFound(np.concatenate(marks).astype(np.intp), np.concatenate([part.pixels for part in found]))


def _find_uncoded(grey: NDArray[np.uint8], light: NDArray[np.float32], board: Board) -> MarksFound:
    found = None
    if isinstance(board, Chessboard):
        found = find_chessboard(grey, light, board)
    elif isinstance(board, CirclesGrid):
        found = find_circles(grey, light, board)
    return found or MarksFound(np.zeros(0, np.intp), np.empty((0, 2)))


def grey_and_light(picture: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A photo (h, w[, c]), uint8, sRGB, as grey values (h, w) and as linear light (h, w), 0 to 1.

    Raises
    ------
    UsageError
        If it is no such picture.
    """
    if picture.dtype != np.uint8 or picture.ndim not in (2, 3):
        raise UsageError(f"marks are looked for in an 8-bit picture, not in {picture.dtype} {picture.shape}")
    grey = _grey(picture)
    return grey, linear_from_encoded(grey[..., None])[..., 0]  # blurred edges are symmetrical only in light


def _grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if picture.ndim == 2 or picture.shape[2] < 3:
        return np.ascontiguousarray(picture.reshape(*picture.shape[:2], -1)[..., 0])
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_RGB2GRAY), np.uint8)
