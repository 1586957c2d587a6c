"""From photos of a target to its views: found, searched again with an interim camera, numbered alike.

Every photo is searched; from what is found a first camera follows; with it each photo is searched again, so that marks
are measured out to the rim and boards are found that the detectors missed.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.board import MarksFound
from fullsphere.model.calibration.boards import CirclesGrid
from fullsphere.model.calibration.calibrate import Calibration, Progress, calibrate, locate
from fullsphere.model.calibration.detect import find_marks
from fullsphere.model.calibration.diagnosis import diagnosed
from fullsphere.model.calibration.disc_images import centre_offset
from fullsphere.model.calibration.mark_order import aligned, equivalent_orders
from fullsphere.model.calibration.points import LeftOut, View
from fullsphere.model.calibration.search_again import find_rectified, search_again
from fullsphere.model.calibration.targets import Target
from fullsphere.model.circle import ImageCircle, brightest, find_circle
from fullsphere.model.errors import CameraError, GeometryError, InputError
from fullsphere.model.lens import FloatArray, KannalaBrandt

_LEAST_MARKS = 6  # that make a view
_SAME_PX = 0.02  # median distance of the marks in two pictures of one view
_DIAGNOSED = 4  # photos that are looked at for what is there instead of the target


@dataclasses.dataclass(frozen=True)
class Photo:
    """A photo by name; `read` loads its pixels (h, w[, 3]), uint8, sRGB, each time it is called."""

    name: str
    read: Callable[[], NDArray[np.uint8]]


@dataclasses.dataclass(frozen=True, eq=False)
class PhotoViews:
    """What photos show of a target.

    Attributes
    ----------
    views
        To calibrate from, in the order of the photos.
    image_size
        Width and height of the photos in pixels.
    found
        In how many photos the target was found, copies of others included.
    left_out
        Photos that make no view, with the reason.
    circle
        The image circle, where one is seen.
    """

    views: tuple[View, ...]
    image_size: tuple[int, int]
    found: int
    left_out: tuple[LeftOut, ...]
    circle: ImageCircle | None


class _Look(NamedTuple):
    """The first search of a photo."""

    photo: Photo
    size: tuple[int, int]
    digest: str
    found: MarksFound


def views_of_photos(photos: Sequence[Photo], target: Target, progress: Progress = iter) -> PhotoViews:
    """Find a target in photos taken with one camera.

    Parameters
    ----------
    photos
        One or more, of one size; they are read twice, one at a time.
    target
        What they show.
    progress
        Wraps the photos, once for each of the two searches.

    Raises
    ------
    InputError
        If the photos differ in size, or none shows the target; the message says what is seen instead.
    """
    looks, light = _first_looks(photos, target, progress)
    _check_sizes(looks)
    looks, copies = _without_copies(looks)
    if all(len(look.found.marks) < _LEAST_MARKS for look in looks):
        raise InputError(_not_found(looks, target))
    circle = find_circle(light)
    found = _searched_again(looks, target, circle, progress)
    views, without = [], []
    for look, marks in zip(looks, found, strict=True):
        if len(marks.marks) >= _LEAST_MARKS:
            views.append(View(look.photo.name, target.points[marks.marks], marks.pixels))
        else:
            without.append(LeftOut(look.photo.name, f"{_count(marks)} of {target.name} found in it"))
    return PhotoViews(tuple(views), looks[0].size, len(photos) - len(without), (*copies, *without), circle)


def _count(found: MarksFound) -> str:
    return f"only {len(found.marks)} marks" if len(found.marks) else "no marks"


def _first_looks(photos: Sequence[Photo], target: Target, progress: Progress) -> tuple[list[_Look], NDArray[np.uint8]]:
    """What is found in each photo, and the brightest value of each pixel over those of the first's size."""
    looks: list[_Look] = []
    light = np.zeros((0, 0), np.uint8)
    for photo in progress(photos):
        picture = photo.read()
        size = (picture.shape[1], picture.shape[0])
        digest = hashlib.sha256(picture.tobytes()).hexdigest()
        looks.append(_Look(photo, size, digest, find_marks(picture, target)))
        shown = brightest([picture.reshape(*picture.shape[:2], -1)])
        if light.size == 0:
            light = shown
        elif light.shape == shown.shape:
            np.maximum(light, shown, out=light)
    return looks, light


def _check_sizes(looks: Sequence[_Look]) -> None:
    sizes = Counter(look.size for look in looks)
    if len(sizes) > 1:
        usual = sizes.most_common(1)[0][0]
        odd = [look for look in looks if look.size != usual]
        raise InputError(
            f"{odd[0].photo.name}: {odd[0].size[0]} x {odd[0].size[1]} pixels, but most photos have {usual[0]} x "
            f"{usual[1]} ({len(odd)} of {len(looks)} differ); calibrate from photos of one camera, size and orientation"
        )


def _without_copies(looks: Sequence[_Look]) -> tuple[list[_Look], list[LeftOut]]:
    """The photos without those that show just what another shows."""
    kept: list[_Look] = []
    copies: list[LeftOut] = []
    for look in looks:
        original = next((other for other in kept if _is_copy(look, other)), None)
        if original is None:
            kept.append(look)
        else:
            copies.append(LeftOut(look.photo.name, f"it is the same picture as {original.photo.name}"))
    return kept, copies


def _is_copy(look: _Look, other: _Look) -> bool:
    if look.digest == other.digest:
        return True
    if len(look.found.marks) < _LEAST_MARKS or not np.array_equal(look.found.marks, other.found.marks):
        return False
    return float(np.median(np.linalg.norm(look.found.pixels - other.found.pixels, axis=-1))) < _SAME_PX


def _not_found(looks: Sequence[_Look], target: Target) -> str:
    pictures = [look.photo.read() for look in looks[:_DIAGNOSED]]
    where = looks[0].photo.name if len(looks) == 1 else f"{looks[0].photo.name} and {len(looks) - 1} more photos"
    return f"{where}: no {target.name} found; {diagnosed(pictures, target)}"


def _searched_again(
    looks: Sequence[_Look], target: Target, circle: ImageCircle | None, progress: Progress
) -> list[MarksFound]:
    """The marks of each photo after the second search; those of the first where no interim camera follows from it."""
    views = [
        View(str(k), target.points[look.found.marks], look.found.pixels)
        for k, look in enumerate(looks)
        if len(look.found.marks) >= _LEAST_MARKS
    ]
    try:
        centre = circle.centre if circle else None
        interim = calibrate(views, looks[0].size, KannalaBrandt, centre=centre).within(circle)
    except (GeometryError, CameraError):
        return [look.found for look in looks]
    placed = dict(_placed(interim))
    found = []
    for k, look in enumerate(progress(looks)):
        again = _again(look, target, interim, placed.get(k))
        found.append(again or look.found)
    return _numbered_alike(found, target, interim)


def _placed(interim: Calibration) -> Iterator[tuple[int, tuple[FloatArray, FloatArray]]]:
    poses = interim.poses
    for view, turn, shift in zip(interim.views, poses.camera_from_target, poses.translation, strict=True):
        yield int(view.image), (turn, shift)


def _again(
    look: _Look, target: Target, interim: Calibration, pose: tuple[FloatArray, FloatArray] | None
) -> MarksFound | None:
    """The second search of one photo; None where it shows nothing that the interim camera explains."""
    picture, found = look.photo.read(), look.found
    if pose is None:
        if len(found.marks) < _LEAST_MARKS:
            found = find_rectified(picture, target, interim.camera)
        pose = _pose(found, target, interim)
        if pose is None:
            return None
    board = target.boards[0]
    if isinstance(board, CirclesGrid):
        offset = centre_offset(interim.camera, *pose, board, found.marks)
        whole = np.isfinite(offset).all(1)
        return MarksFound(found.marks[whole], (found.pixels - offset)[whole])
    return search_again(picture, target, interim.camera, *pose, found)


def _pose(found: MarksFound, target: Target, interim: Calibration) -> tuple[FloatArray, FloatArray] | None:
    if len(found.marks) < _LEAST_MARKS:
        return None
    try:
        poses, residuals = locate([View("", target.points[found.marks], found.pixels)], interim.camera)
    except GeometryError:
        return None
    if float(np.median(np.hypot(*residuals[0].T))) > max(2.0, 10 * interim.sigma_px):
        return None
    return poses.camera_from_target[0], poses.translation[0]


def _numbered_alike(found: Sequence[MarksFound], target: Target, interim: Calibration) -> list[MarksFound]:
    """The marks of boards that look the same after a turn, numbered in every view as in the others."""
    board = target.boards[0]
    orders = equivalent_orders(board)
    seen = [k for k, marks in enumerate(found) if len(marks.marks) >= _LEAST_MARKS]
    if len(orders) == 1:
        return list(found)
    rotations: dict[int, FloatArray] = {}
    for k in seen:
        pose = _pose(found[k], target, interim)
        if pose is not None:
            rotations[k] = pose[0]
    result = list(found)
    rows = aligned(board, np.array(list(rotations.values())).reshape(-1, 3, 3))
    for k, row in zip(rotations, rows, strict=True):
        whole = np.full((len(target.points), 2), np.nan)
        whole[found[k].marks] = found[k].pixels
        turned = whole[orders[row]]
        marks = np.flatnonzero(np.isfinite(turned).all(1))
        result[k] = MarksFound(marks, turned[marks])
    return result
