"""Why no photo shows the target: mirrored photos, a board of other dimensions, other markers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.boards import AprilGrid, Chessboard, CodedBoard
from fullsphere.model.calibration.detect import find_marks, grey_and_light
from fullsphere.model.calibration.detect_chessboard import seen_chessboards
from fullsphere.model.calibration.detect_coded import border_modules, find_markers
from fullsphere.model.calibration.targets import Target

_DICTIONARIES = ("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_APRILTAG_36h11")
_ENOUGH = 4  # markers of another dictionary that are no chance reading


def diagnosed(pictures: Sequence[NDArray[np.uint8]], target: Target) -> str:
    """What is seen in photos (h, w[, 3]) instead of the target, and what to try, in half a sentence each.

    The photos are those in which nothing was found; a few are enough.
    """
    board = target.boards[0]
    if isinstance(board, CodedBoard):
        return _of_codes(pictures, target)
    if isinstance(board, Chessboard):
        return _of_chessboard(pictures, board)
    return "a grid of circles has to be wholly in the picture, dark on white; check its rows and columns"


def _of_chessboard(pictures: Sequence[NDArray[np.uint8]], board: Chessboard) -> str:
    seen = Counter(size for picture in pictures for size in seen_chessboards(grey_and_light(picture)[0]))
    if seen:
        (columns, rows), _ = seen.most_common(1)[0]
        if {columns, rows} != {board.columns, board.rows}:
            return (
                f"a chessboard of {columns} x {rows} inner corners is seen, not {board.columns} x {board.rows}; "
                "count the crossings inside the board, not the squares"
            )
    return (
        "the whole board has to be in the picture, with a white margin; check the number of inner corners "
        f"({board.columns} x {board.rows})"
    )


def _of_codes(pictures: Sequence[NDArray[np.uint8]], target: Target) -> str:
    boards = cast("tuple[CodedBoard, ...]", target.boards)
    for picture in pictures:
        if len(find_marks(np.ascontiguousarray(picture[:, ::-1]), target).marks):
            return "the photos are mirrored; save them as the camera takes them"
    own = {board.first_id + k for board in boards for k in range(board.marker_count)}
    readings = _readings(pictures, boards[0].dictionary, border_modules(boards[0]))
    if len(readings) >= _ENOUGH and len(readings & own) < len(readings):
        return (
            f"markers {_listed(readings)} are seen, but the target has {min(own)} to {max(own)}; "
            "check the dimensions of the board and the number of its first marker"
        )
    if len(readings) >= _ENOUGH:
        return "its markers are seen, but not side by side as on this board; check the number of squares in a row"
    if isinstance(boards[0], AprilGrid):
        other = 3 - boards[0].border_modules
        if len(_readings(pictures, boards[0].dictionary, other)) >= _ENOUGH:
            return f"the tags seen have a border of {other} modules, not {boards[0].border_modules}"
    counts = {name: len(_readings(pictures, name, 1)) for name in _DICTIONARIES if name != boards[0].dictionary}
    likely = max(counts, key=lambda name: counts[name])
    if counts[likely] >= 2 * _ENOUGH:
        return f"markers of {likely} are seen, not of {boards[0].dictionary}; check the dictionary"
    return "check that the photos show it, sharp and not too small"


def _readings(pictures: Sequence[NDArray[np.uint8]], dictionary: str, border: int) -> set[int]:
    return {number for picture in pictures for number in find_markers(grey_and_light(picture)[0], dictionary, border)}


def _listed(numbers: set[int]) -> str:
    few = sorted(numbers)
    return ", ".join(map(str, few)) if len(few) <= 6 else f"{few[0]}, {few[1]}, {few[2]} ... {few[-1]}"
