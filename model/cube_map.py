"""The six faces of a cube round the camera, as one picture.

Each face is a perspective view of 90 by 90 degrees, turned by yaw and pitch as everywhere in fullsphere:

    face     front  right  back  left  up  down
    yaw          0     90   180   -90   0     0
    pitch        0      0     0     0  90   -90

so the lower edge of `up` and the upper edge of `down` meet `front`.  The layouts, each cell a face:

    strip                             3x2                cross                      vertical-cross
    right left up down front back     right left  up           up                         up
                                      down  front back   left  front right back     left  front right
                                                               down                       down
                                                                                          back (upside down)

`strip` and `3x2` are those of ffmpeg's v360 (c6x1, c3x2).  In the crosses neighbours on the cube are neighbours in the
picture as far as can be, and the cells without a face look nowhere.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model import surface_kernels as kernels
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import FloatArray
from fullsphere.model.separable import checked_rotation, checked_size, contiguous_rays

Layout = Literal["strip", "3x2", "cross", "vertical-cross"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
"""Where the faces stand in the picture, by name."""

FACES = ("right", "left", "up", "down", "front", "back")
"""The faces, in the order of the axes that they look along: +x, -x, -y, +y, +z, -z."""

_CELLS: dict[Layout, tuple[str, ...]] = {  # rows from the top; - looks nowhere, ~ stands upside down
    "strip": ("right left up down front back",),
    "3x2": ("right left up", "down front back"),
    "cross": ("- up - -", "left front right back", "- down - -"),
    "vertical-cross": ("- up -", "left front right", "- down -", "- ~back -"),
}

_VIEWS: dict[str, list[list[int]]] = {  # right, down and forward of each face, as columns
    "right": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "left": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "up": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "down": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "front": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "back": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
}


@dataclasses.dataclass(frozen=True)
class CubeMap:
    """Six perspective faces in one picture; a FastProjection.

    A direction belongs to one face: that of its longest component, and where two are equal that of x before y before
    z.  `project` answers the pixel there, between -0.5 and side - 0.5 of the face's first pixel, less than the latter.

    Attributes
    ----------
    side
        Side of a face in pixels.
    layout
        One of `LAYOUTS`.
    gutter
        Pixels round each face that go on past its 90 degrees, so that interpolation near an edge of the cube finds
        what is beyond it; the directions in the gutters are there several times.

    Raises
    ------
    UsageError
        If the layout is not known, or a number is out of range.
    """

    side: int
    layout: Layout = "3x2"
    gutter: int = 0

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            raise UsageError(f"cube map: layout {self.layout!r} is not one of {', '.join(LAYOUTS)}")
        object.__setattr__(self, "side", checked_size((self.side, self.side))[0])
        if not 0 <= self.gutter <= self.side or self.gutter != int(self.gutter):
            raise UsageError(f"cube map: a gutter of {self.gutter} px round faces of {self.side} px; at most the side")
        object.__setattr__(self, "gutter", int(self.gutter))
        checked_size(self.size)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        rows = _CELLS[self.layout]
        return len(rows[0].split()) * self.pitch, len(rows) * self.pitch

    @property
    def pitch(self) -> int:
        """Side of a cell: a face and its gutters."""
        return self.side + 2 * self.gutter

    @property
    def corners(self) -> dict[str, tuple[int, int]]:
        """Column and row of the first pixel of each face's square in the picture, without its gutter."""
        return {
            name: (i * self.pitch + self.gutter, j * self.pitch + self.gutter)
            for name, (i, j, _) in self._places.items()
        }

    def project(self, rays: ArrayLike, rotation: ArrayLike | None = None, dtype: type = np.float64) -> NDArray[Any]:
        """Rays (..., 3) of any length -> pixels (..., 2) of `dtype` in their faces; NaN for no direction.

        `rotation` (3, 3) takes the rays into the cube's frame first, in the same pass.
        """
        given = contiguous_rays(rays)
        pixels: NDArray[Any] = np.empty((*given.shape[:-1], 2), dtype)
        places, centre = self._places, (self.pitch - 1) / 2
        cells = [
            (places[name][0] * self.pitch + centre, places[name][1] * self.pitch + centre, places[name][2])
            for name in FACES
        ]
        inset = self.side / 2 - float(np.spacing(dtype(max(self.size))))
        kernels.project_cube(
            given.reshape(-1, 3),
            checked_rotation(rotation),
            np.array(cells, dtype),
            self.side / 2,
            inset,
            pixels.reshape(-1, 2),
        )
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Pixels (..., 2) -> unit rays (..., 3); NaN in cells without a face and beyond the picture."""
        given = np.ascontiguousarray(pixels, np.float64)
        rays = np.empty((*given.shape[:-1], 3))
        kernels.unproject_cube(given.reshape(-1, 2), self._views, self.side, self.pitch, rays.reshape(-1, 3))
        return rays

    def window_rays(self, columns: slice, rows: slice, dtype: type = np.float64) -> NDArray[Any]:
        """Unit rays (rows, columns, 3) of `dtype` of a rectangle of whole pixels; NaN where `unproject` is."""
        rays: NDArray[Any] = np.empty((rows.stop - rows.start, columns.stop - columns.start, 3), dtype)
        kernels.window_of_cube(columns.start, rows.start, self._views, self.side, self.pitch, rays)
        return rays

    def with_gutters(self, image: NDArray[Any], gutter: int) -> tuple[NDArray[Any], CubeMap]:
        """The picture (h, w) or (h, w, c) of this cube map with `gutter` pixels of its neighbours round each face.

        What lies in a gutter is interpolated linearly between the pixels of one face.  As a source for interpolation
        the result has no edges: `project` answers positions in the faces, and all that a kernel reaches is there.

        Raises
        ------
        UsageError
            If the picture is not of this size, or the gutter is wider than a face.
        """
        if image.shape[1::-1] != self.size:
            raise UsageError(f"cube map: the picture is {image.shape[1]} x {image.shape[0]}, not {self.size}")
        wide = dataclasses.replace(self, gutter=gutter)
        result = np.zeros((*wide.size[::-1], *image.shape[2:]), image.dtype)
        side, pitch = self.side, wide.pitch
        for name, (left, top) in wide.corners.items():
            i, j = self.corners[name]
            result[top : top + side, left : left + side] = image[j : j + side, i : i + side]
            rim, inner = slice(left - gutter, left - gutter + pitch), slice(top, top + side)
            for rows, columns in (
                (slice(top - gutter, top), rim),
                (slice(top + side, top + side + gutter), rim),
                (inner, slice(left - gutter, left)),
                (inner, slice(left + side, left + side + gutter)),
            ):
                result[rows, columns] = self._linear(image, self.project(wide.window_rays(columns, rows)))
        return result, wide

    def _linear(self, image: NDArray[Any], pixels: FloatArray) -> NDArray[Any]:
        """Values at pixels (..., 2) between the pixels of the face that each is in, in the type of the picture."""
        first = np.floor((pixels + 0.5) / self.pitch).astype(int) * self.pitch + self.gutter
        low = np.floor(pixels).astype(int)
        across, down = (part.reshape(*part.shape, *[1] * (image.ndim - 2)) for part in np.moveaxis(pixels - low, -1, 0))
        (u0, v0), (u1, v1) = (np.moveaxis(np.clip(at, first, first + self.side - 1), -1, 0) for at in (low, low + 1))
        upper = image[v0, u0] * (1 - across) + image[v0, u1] * across
        lower = image[v1, u0] * (1 - across) + image[v1, u1] * across
        values: NDArray[Any] = upper * (1 - down) + lower * down
        if np.issubdtype(image.dtype, np.integer):
            values = np.round(values)
        return values if values.dtype == image.dtype else values.astype(image.dtype)

    @property
    def _places(self) -> dict[str, tuple[int, int, int]]:
        """Column and row of each face's cell, and -1 where it stands upside down."""
        return {
            name.removeprefix("~"): (i, j, -1 if name[0] == "~" else 1)
            for j, row in enumerate(_CELLS[self.layout])
            for i, name in enumerate(row.split())
            if name != "-"
        }

    @property
    def _views(self) -> FloatArray:
        """For each cell what takes (right, down, 1) to a ray, (rows, columns, 3, 3); NaN without a face."""
        width, height = self.size
        views = np.full((height // self.pitch, width // self.pitch, 3, 3), np.nan)
        for name, (i, j, sign) in self._places.items():
            views[j, i] = np.array(_VIEWS[name]) * [sign, sign, 1]
        return views
