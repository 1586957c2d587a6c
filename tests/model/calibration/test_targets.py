"""What boards print is what OpenCV's own detectors read, and their marks are where those find them."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

from fullsphere.model.calibration.board import Artwork, Board, Placement
from fullsphere.model.calibration.boards import (
    APRILTAG_MARKS,
    AprilGrid,
    CharucoBoard,
    Chessboard,
    CirclesGrid,
    marker_dictionary,
    one_dictionary,
)
from fullsphere.model.calibration.cylinder import cylinder
from fullsphere.model.calibration.targets import Target
from fullsphere.model.errors import UsageError


class Print(NamedTuple):
    """An artwork as a picture."""

    picture: np.ndarray
    artwork: Artwork
    px_per_mm: float

    def on_paper(self, pixels: Any) -> np.ndarray:
        """Pixels (..., 2) -> mm on the board's paper."""
        return (np.asarray(pixels, float).reshape(-1, 2) + 0.5) / self.px_per_mm + self.artwork.lower


def printed(board: Board, px_per_mm: float = 6.0, fine: int = 4) -> Print:
    """The board's artwork: filled by OpenCV at a higher resolution, then averaged."""
    artwork, scale = board.artwork(), px_per_mm * fine
    width, height = (fine * np.ceil((np.array(artwork.upper) - artwork.lower) * px_per_mm).astype(int)).tolist()
    picture = np.full((height, width), 255, np.uint8)
    for polygon in artwork.polygons:
        corners = np.round((polygon - artwork.lower) * scale).astype(np.int32)
        # fillPoly paints the outline too, which would make a shape a pixel larger
        cv2.fillPoly(picture, [corners - (corners == corners.max(0))], 0)
    for x, y, radius in artwork.discs:
        centre = np.round(((np.array([x, y]) - artwork.lower) * scale - 0.5) * 256).astype(int).tolist()
        cv2.circle(picture, centre, round(radius * scale * 256), 0, -1, shift=8)
    small = cv2.resize(picture, (width // fine, height // fine), interpolation=cv2.INTER_AREA)
    return Print(cv2.GaussianBlur(small, (0, 0), 0.7), artwork, px_per_mm)


def test_charuco_board_is_read_by_opencv() -> None:
    board = CharucoBoard(7, 5, 30.0, 22.0, 40, "DICT_5X5_250")
    ids = np.arange(40, 40 + board.marker_count)
    theirs = cv2.aruco.CharucoBoard((7, 5), 30.0, 22.0, marker_dictionary("DICT_5X5_250"), ids)
    sheet = printed(board)
    corners, numbers, _, markers = cv2.aruco.CharucoDetector(theirs).detectBoard(sheet.picture)
    assert sorted(markers.ravel()) == ids.tolist()
    assert sorted(numbers.ravel()) == list(range(board.corner_count))
    np.testing.assert_allclose(sheet.on_paper(corners), board.marks_on_paper()[numbers.ravel()], atol=0.02)


@pytest.mark.parametrize("rows", [8, 9])
def test_chessboard_is_read_by_opencv(rows: int) -> None:
    board = Chessboard(6, rows, 30.0)
    sheet = printed(board)
    found, corners = cv2.findChessboardCornersSB(sheet.picture, (6, rows))
    assert found
    places = sheet.on_paper(corners)
    if places[0, 1] > places[-1, 1]:  # where the ends differ in colour, it begins at the white one
        places = places[::-1]
    np.testing.assert_allclose(places, board.marks_on_paper(), atol=0.02)
    first = (np.array([15.0, 15.0]) - sheet.artwork.lower) * sheet.px_per_mm
    assert sheet.picture[int(first[1]), int(first[0])] == 0


@pytest.mark.parametrize("asymmetric", [False, True])
def test_circles_are_read_by_opencv(asymmetric: bool) -> None:
    board = CirclesGrid(4, 11, 20.0, 12.0, asymmetric)
    sheet = printed(board)
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(sheet.picture, (4, 11), flags=kind)
    assert found
    np.testing.assert_allclose(sheet.on_paper(centres), board.marks_on_paper(), atol=0.02)


@pytest.mark.parametrize("border", [1, 2])
def test_april_tags_are_read_by_opencv(border: int) -> None:
    board = AprilGrid(4, 3, 50.0, 0.3, 5, border)
    sheet = printed(board)
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = border
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    outlines, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(board.dictionary), settings).detectMarkers(
        sheet.picture
    )
    assert sorted(ids.ravel()) == list(range(5, 17))
    marks = board.marks_on_paper().reshape(-1, 4, 2)[ids.ravel() - 5][:, APRILTAG_MARKS]
    np.testing.assert_allclose(sheet.on_paper(outlines), marks.reshape(-1, 2), atol=0.03)


def test_april_grid_is_laid_out_as_kalibr_does() -> None:
    """Its drawing: tag 36h11 number 0 upright (code d5d628584, first bit at the upper left), at the lower left."""
    board = AprilGrid(2, 2, 100.0, 0.3)
    sheet = printed(board, px_per_mm=1.0)
    x, y = np.meshgrid(np.arange(6) * 10 + 25.0, np.arange(6) * 10 - 75.0)
    at = ((np.stack([x, y], -1) - sheet.artwork.lower) * sheet.px_per_mm).astype(int)
    white = sheet.picture[at[..., 1], at[..., 0]] > 127
    assert int("".join("01"[int(bit)] for bit in white.ravel()), 2) == 0xD5D628584
    kalibr = board.marks_on_paper() * [1, -1]
    np.testing.assert_allclose(kalibr[:6], [[0, 0], [100, 0], [100, 100], [0, 100], [130, 0], [230, 0]])
    np.testing.assert_allclose(kalibr[8], [0, 130])


@pytest.mark.parametrize(
    "board",
    [
        CharucoBoard(4, 3, 30.0, 21.0),
        Chessboard(4, 3, 30.0),
        CirclesGrid(4, 3, 30.0, 20.0),
        CirclesGrid(4, 3, 30.0, 20.0, True),
        AprilGrid(4, 3, 30.0, 0.25),
        cylinder(50.0, 70.0, 20.0, 14.0),
    ],
    ids=lambda board: type(board).__name__,
)
def test_print_lies_on_its_paper(board: Board) -> None:
    artwork = board.artwork()
    discs, radii = artwork.discs[:, :2], artwork.discs[:, 2:]
    outline = np.concatenate([*artwork.polygons, discs - radii, discs + radii])
    assert (outline.min(0) >= artwork.lower).all()
    assert (outline.max(0) <= artwork.upper).all()


def test_layout_is_that_of_opencv() -> None:
    board = CharucoBoard(7, 5, 30.0, 21.0, 40, "DICT_5X5_250")
    ids = np.arange(40, 40 + board.marker_count)
    theirs = cv2.aruco.CharucoBoard((7, 5), 30.0, 21.0, marker_dictionary("DICT_5X5_250"), ids)
    np.testing.assert_allclose(board.marks_on_paper(), theirs.getChessboardCorners()[:, :2])
    corners = np.array(theirs.getObjPoints())[:, 0, :2]
    np.testing.assert_allclose(board.marker_squares() * 30.0 + 4.5, corners)


def test_corners_follow_the_pose() -> None:
    pose = np.array([[0, 0, 1, 10], [1, 0, 0, 20], [0, 1, 0, 30], [0, 0, 0, 1.0]])
    board = CharucoBoard(3, 3, 10.0, 7.0, placement=Placement(pose))
    np.testing.assert_allclose(board.marks_on_target()[1], [10, 40, 40])
    assert len(board.marks_on_target()) == board.corner_count == 4


@pytest.mark.parametrize(
    "wrong",
    [
        {"squares_x": 1},
        {"marker_mm": 30.0},
        {"marker_mm": float("nan")},
        {"dictionary": "DICT_NONE"},
        {"dictionary": "ArucoDetector"},
        {"first_id": 999},
        {"first_id": -1},
        {"placement": Placement(radius_mm=19.0)},  # 119.4 mm round
    ],
)
def test_values_that_make_no_charuco_board_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"board|dictionary"):
        CharucoBoard(**{"squares_x": 4, "squares_y": 4, "square_mm": 30.0, "marker_mm": 20.0} | wrong)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Chessboard, (2, 8, 30.0)),
        (Chessboard, (8, 2, 30.0)),
        (Chessboard, (8, 100000, 30.0)),
        (Chessboard, (8, 8, 0.0)),
        (Chessboard, (8, 8, float("nan"))),
        (Chessboard, (8, 8, float("inf"))),
        (CirclesGrid, (4, 4, 20.0, 20.0)),
        (CirclesGrid, (4, 4, 20.0, 28.5, True)),
        (CirclesGrid, (1, 4, 20.0, 10.0)),
        (AprilGrid, (0, 4, 20.0, 0.3)),
        (AprilGrid, (4, 4, 20.0, 0.0)),
        (AprilGrid, (4, 4, 20.0, 5.0)),
        (AprilGrid, (4, 4, 20.0, 0.3, 572)),
        (AprilGrid, (4, 4, 20.0, 0.3, 0, 3)),
    ],
)
def test_values_that_make_no_board_are_refused(kind: Any, values: tuple[Any, ...]) -> None:
    with pytest.raises(UsageError, match="board"):
        kind(*values)


@pytest.mark.parametrize("pose", [np.diag([1.0, 1, -1, 1]), np.eye(3)])
def test_placement_is_rigid(pose: np.ndarray) -> None:
    with pytest.raises(UsageError):
        Placement(pose)


def test_rolled_paper_keeps_its_lengths_and_touches_the_flat_one() -> None:
    paper = np.stack([np.linspace(-200, 200, 4001), np.full(4001, 7.0)], -1)
    flat, rolled = Placement().lift(paper), Placement(radius_mm=150.0).lift(paper)
    np.testing.assert_allclose(np.linalg.norm(np.diff(rolled, axis=0), axis=1), 0.1, rtol=1e-6)
    np.testing.assert_allclose(np.hypot(rolled[:, 0], rolled[:, 2] + 150.0), 150.0)
    np.testing.assert_allclose(rolled[2000], flat[2000])
    assert (rolled[:, 2] <= 1e-12).all()  # towards the viewer


def test_cylinder_closes_and_has_its_axis_along_z() -> None:
    board = cylinder(150.0, 420.0, 36.0, 26.0)
    assert (board.squares_x, board.squares_y, board.is_closed) == (26, 11, True)
    assert board.squares_x * board.square_mm == pytest.approx(2 * np.pi * 150)
    assert board.marker_mm / board.square_mm == pytest.approx(26 / 36)
    x, y = board.marks_on_paper().T
    around = np.stack([150 * np.cos(x / 150), 150 * np.sin(x / 150), y], -1)
    np.testing.assert_allclose(board.marks_on_target(), around, atol=1e-9)


def test_half_cylinder_is_half() -> None:
    board = cylinder(150.0, 420.0, 36.0, 26.0, part=0.5)
    assert board.squares_x * board.square_mm == pytest.approx(np.pi * 150)
    assert not board.is_closed


def test_cylinder_is_seen_from_inside_as_it_is_printed() -> None:
    """To an eye on the axis, x of the paper turns to the right where y of the paper is down."""
    board = cylinder(150.0, 420.0, 36.0, 26.0)
    at, right, down = board.placement.lift([[100.0, 200.0], [101.0, 200.0], [100.0, 201.0]])
    ahead = at - [0, 0, at[2]]
    assert np.dot(np.cross(right - at, down - at), ahead) > 0


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ((150.0, 420.0, 10.0, 7.0), "larger squares"),
        ((15.0, 420.0, 60.0, 40.0), "too large"),
        ((150.0, 40.0, 36.0, 26.0), "two rows"),
        ((-1.0, 40.0, 36.0, 26.0), "radius"),
        ((150.0, float("nan"), 36.0, 26.0), "length"),
        ((150.0, 420.0, 36.0, 36.0), "fit"),
        ((150.0, 420.0, 36.0, 26.0, "DICT_4X4_50"), "DICT_4X4_50"),
        ((150.0, 420.0, 36.0, 26.0, None, 1.5), "turn"),
    ],
)
def test_impossible_cylinders_are_refused(values: tuple[Any, ...], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        cylinder(*values)


def test_boards_of_one_target_share_a_dictionary_and_no_marker() -> None:
    first, second = CharucoBoard(4, 4, 30.0, 20.0), CharucoBoard(4, 4, 30.0, 20.0, 8)
    assert one_dictionary([second, first]) == "DICT_5X5_1000"
    assert Target("two", (first, second)).first_marks.tolist() == [0, 9]
    for wrong in ([], [first, first], [first, CharucoBoard(4, 4, 30.0, 20.0, 8, "DICT_4X4_100")]):
        with pytest.raises(UsageError):
            one_dictionary(wrong)
        with pytest.raises(UsageError, match="wrong"):
            Target("wrong", tuple(wrong))
    with pytest.raises(UsageError, match="one kind"):
        Target("mixed", (first, Chessboard(4, 4, 30.0)))
