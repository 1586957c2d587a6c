"""Known points of a rigid target and where pictures show them: the measurements that a calibration starts from."""

from __future__ import annotations

import csv
import dataclasses
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TextIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import GeometryError, InputError
from fullsphere.model.lens import FloatArray

COLUMNS = ("image", "x_mm", "y_mm", "z_mm", "u_px", "v_px")
"""The columns that `read_points` needs; others are ignored."""

_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_Scalar = TypeVar("_Scalar", bound=np.generic)
_THIN = 1e-3  # extents below this share of the largest one are taken for zero: no target is made more exactly


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """One picture of the target.

    Attributes
    ----------
    image
        Name of the picture, for messages and reports.
    points_on_target
        (n, 3) in the target's own frame and unit (the poses found are in that unit).
    pixels
        (n, 2) where the picture shows them; the centre of the first pixel is (0, 0).

    Raises
    ------
    GeometryError
        If the two arrays do not belong together, or hold values that are not finite.
    """

    image: str
    points_on_target: FloatArray
    pixels: FloatArray

    def __post_init__(self) -> None:
        points, pixels = np.asarray(self.points_on_target, float), np.asarray(self.pixels, float)
        if points.ndim != 2 or points.shape[1:] != (3,) or pixels.shape != (len(points), 2):
            raise GeometryError(
                f"{self.image}: points on the target of shape {points.shape} and pixels of shape {pixels.shape}; "
                "(n, 3) and (n, 2) are needed"
            )
        if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
            raise GeometryError(f"{self.image}: a coordinate is NaN or infinite; leave that point out")
        object.__setattr__(self, "points_on_target", points)
        object.__setattr__(self, "pixels", pixels)


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """A view that takes no part: the picture's name and why."""

    image: str
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class Poses:
    """Where the target stands before the camera, view by view: ray = camera_from_target @ point + translation.

    Attributes
    ----------
    camera_from_target
        (V, 3, 3) rotations.
    translation
        (V, 3) the target's origin in the camera frame, in the target's unit.
    """

    camera_from_target: FloatArray
    translation: FloatArray

    def only(self, views: Sequence[int] | NDArray[np.intp]) -> Poses:
        """Those of the views with the given numbers."""
        chosen = np.asarray(views, np.intp)
        return Poses(self.camera_from_target[chosen], self.translation[chosen])

    def replaced(self, views: NDArray[np.intp], by: Poses) -> Poses:
        """The poses with those of the views with the given numbers replaced."""
        rotation, translation = self.camera_from_target.copy(), self.translation.copy()
        rotation[views], translation[views] = by.camera_from_target, by.translation
        return Poses(rotation, translation)


@dataclasses.dataclass(frozen=True, eq=False)
class Sightings:
    """Several views of one rigid target, as flat arrays: `points` (N, 3), `pixels` (N, 2), `view` (N,), ascending."""

    images: tuple[str, ...]
    points: FloatArray
    pixels: FloatArray
    view: NDArray[np.intp]

    @classmethod
    def of(cls, views: Iterable[View]) -> Sightings:
        """The views one after the other; GeometryError if there is none or one of them cannot fix a pose."""
        listed = tuple(views)
        if not listed:
            raise GeometryError("calibration: no view of the target was given")
        for view in listed:
            _check_spread(view)
        return cls(
            tuple(view.image for view in listed),
            np.concatenate([view.points_on_target for view in listed]),
            np.concatenate([view.pixels for view in listed]),
            np.repeat(np.arange(len(listed)), [len(view.pixels) for view in listed]),
        )

    @property
    def count(self) -> int:
        """Number of points, over all views."""
        return len(self.pixels)

    def only(self, chosen: NDArray[np.bool_]) -> Sightings:
        """The points marked in `chosen` (N,); a view that keeps none is gone, and the others are numbered anew."""
        kept, view = np.unique(self.view[chosen], return_inverse=True)
        images = tuple(self.images[k] for k in kept)
        return Sightings(images, self.points[chosen], self.pixels[chosen], view.astype(np.intp))

    def rays(self, poses: Poses) -> FloatArray:
        """The points in the camera frames of their views, (N, 3)."""
        turned = np.einsum("nij,nj->ni", poses.camera_from_target[self.view], self.points)
        rays: FloatArray = turned + poses.translation[self.view]
        return rays

    def split(self, values: NDArray[_Scalar]) -> tuple[NDArray[_Scalar], ...]:
        """An array (N, ...) with one entry per point, cut into one array per view."""
        return tuple(np.split(values, np.searchsorted(self.view, np.arange(1, len(self.images)))))

    def median_by_view(self, values: FloatArray) -> FloatArray:
        """The median of `values` (N,) in each view, (V,)."""
        return np.array([np.median(part) for part in self.split(values)])


def is_flat(points: FloatArray) -> bool:
    """Whether the points (n, 3) lie on a plane, to 1 % of their extent: the linear pose then needs another form."""
    extents = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(extents[2] < 0.01 * extents[0])


def _check_spread(view: View) -> None:
    points = view.points_on_target
    if len(points) < 4:
        raise GeometryError(
            f"{view.image}: {len(points)} points; a view needs at least 4 (6 unless they lie on a plane)"
        )
    extents = np.linalg.svd(points - points.mean(0), compute_uv=False)
    if extents[1] <= _THIN * extents[0]:
        raise GeometryError(
            f"{view.image}: its {len(points)} points lie on one line and fix no pose; "
            "use points that span a plane or a space"
        )
    if len(points) < 6 and not is_flat(points):
        raise GeometryError(f"{view.image}: {len(points)} points; a view of points in space needs at least 6")


def read_points(path: str | os.PathLike[str]) -> tuple[View, ...]:
    """Read 3D-2D points from a CSV file.

    The first line names the columns; `image`, `x_mm`, `y_mm`, `z_mm`, `u_px`, `v_px` are needed, in any order, others
    are ignored.  Rows with the same `image` make one view; views come in the order of their first row.

    Raises
    ------
    InputError
        If the file is missing, empty, not such a table, or holds a value that is no finite number; the message names
        the file, the line and the column.
    """
    rows: dict[str, list[list[float]]] = {}
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:  # a byte order mark is accepted
            for image, numbers in _rows(file, str(path)):
                rows.setdefault(image, []).append(numbers)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; give a CSV file of 3D-2D points") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a text table ({error}); save it as CSV in UTF-8") from error
    if not rows:
        raise InputError(f"{path}: no rows below the line of column names; add one row per point")
    table = {image: np.array(numbers) for image, numbers in rows.items()}
    return tuple(View(image, numbers[:, :3], numbers[:, 3:]) for image, numbers in table.items())


def _rows(file: TextIO, name: str) -> Iterator[tuple[str, list[float]]]:
    """Image name and x, y, z, u, v of each row."""
    reader = csv.reader(file, strict=True)
    header = next(reader, None)
    if header is None:
        raise InputError(f"{name}: the file is empty; its first line must be {','.join(COLUMNS)}")
    place = _columns(header, name)
    for row in reader:
        if not any(field.strip() for field in row):
            continue
        if len(row) != len(header):
            raise InputError(
                f"{name}: line {reader.line_num} has {len(row)} fields, the first line has {len(header)}; "
                "write numbers with a decimal point and separate fields by commas"
            )
        image = row[place["image"]].strip()
        if not image:
            raise InputError(f"{name}: line {reader.line_num}, column image: empty; name the picture")
        yield image, [_number(row[place[c]], f"{name}: line {reader.line_num}, column {c}") for c in COLUMNS[1:]]


def _columns(header: Sequence[str], name: str) -> dict[str, int]:
    """Position of each needed column."""
    found = [field.strip() for field in header]
    missing = [column for column in COLUMNS if column not in found]
    line = ",".join(header)
    for separator, plural in _SEPARATORS.items():
        if missing and separator in line:
            raise InputError(f"{name}: the columns look separated by {plural}; separate them by commas")
    if missing:
        raise InputError(
            f"{name}: no column {', '.join(missing)}; found {', '.join(map(repr, found)) or 'none'}. "
            f"Name the columns in the first line: {','.join(COLUMNS)}"
        )
    doubled = [column for column in COLUMNS if found.count(column) > 1]
    if doubled:
        raise InputError(f"{name}: column {', '.join(doubled)} appears twice; keep one")
    return {column: found.index(column) for column in COLUMNS}


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
        shown = f"{text.strip()!r} is not a number"
    else:
        shown = f"{text.strip()} is not finite"
    if not math.isfinite(value):
        raise InputError(f"{where}: {shown}; correct it or leave the row out")
    return value
