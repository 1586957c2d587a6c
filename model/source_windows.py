"""A picture larger than memory, made ready to be sampled a window at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Projection
from fullsphere.model.picture_file import PictureFile
from fullsphere.model.source_picture import BORDER, Pixels, Places, Samples, SourcePicture, meeting, source_window

WINDOW_BYTES = 64 << 20
"""Memory for the window of one tile; what needs more is sampled in smaller tiles."""


class WindowedPicture:
    """A picture file of which each tile reads the window that it needs; asked as a `SourcePicture` is."""

    def __init__(self, file: PictureFile, projection: Projection, samples: Samples) -> None:
        self.samples = samples
        self._file, self._projection = file, projection
        self._meets = meeting(projection)

    def sampled(self, u: Places, v: Places, kind: int, shape: tuple[int, int]) -> Pixels:
        """As `SourcePicture.sampled`.

        Raises
        ------
        InputError
            If a part of the file that is needed is damaged.
        """
        height, width = shape
        halo = (u.shape[0] - height) // 2
        inner = (slice(halo, halo + height), slice(halo, halo + width))
        seen = u[inner] == u[inner]
        if not seen.any():
            return np.zeros((height, width, self.samples.channels), self.samples.dtype)
        margin = BORDER + (math.ceil(self._largest_step(u, v) / 2) if halo else 0)
        across, down = u[inner][seen], v[inner][seen]
        left, right = int(across.min()) - margin, int(across.max()) + margin + 1
        top, bottom = int(down.min()) - margin, int(down.max()) + margin + 1
        depth = self.samples.working.itemsize * (4 if self.samples.packed else self.samples.channels)
        if (right - left) * (bottom - top) * depth > WINDOW_BYTES and height * width > 1:
            return self._in_halves(u, v, kind, shape, halo)
        return self._window(left, top, right, bottom).sampled(u, v, kind, shape)

    def sample_into(self, u: Places, v: Places, kind: int, out: Pixels, columns: slice) -> None:
        """As `SourcePicture.sample_into`; errors as `sampled`."""
        out[:, columns] = self.sampled(u, v, kind, (len(out), columns.stop - columns.start))

    def _in_halves(self, u: Places, v: Places, kind: int, shape: tuple[int, int], halo: int) -> Pixels:
        height, width = shape
        if height >= width:
            half = height // 2
            first = self.sampled(u[: half + 2 * halo], v[: half + 2 * halo], kind, (half, width))
            second = self.sampled(u[half:], v[half:], kind, (height - half, width))
            return np.concatenate([first, second])
        half = width // 2
        first = self.sampled(*_columns(u, v, slice(0, half + 2 * halo)), kind, (height, half))
        second = self.sampled(*_columns(u, v, slice(half, None)), kind, (height, width - half))
        return np.concatenate([first, second], axis=1)

    def _largest_step(self, u: Places, v: Places) -> float:
        """The largest footprint in pixels; of two steps the shorter, as in the kernel."""
        steps = []
        for axis in (0, 1):
            du, dv = np.diff(u, axis=axis), np.diff(v, axis=axis)
            if self._meets:
                du = du - self._file.size[0] * np.round(du / self._file.size[0])
            length = np.abs(du) + np.abs(dv)
            first, last = np.delete(length, -1, axis), np.delete(length, 0, axis)
            steps.append(float(np.nanmax(np.fmin(first, last), initial=0.0)))
        return sum(steps)

    def _window(self, left: int, top: int, right: int, bottom: int) -> SourcePicture:
        """Columns and rows of the bordered picture, which may go past its border."""
        height = self._file.size[1]
        rows, columns = np.arange(top, bottom) - BORDER, np.arange(left, right) - BORDER
        above, below = rows < 0, rows >= height
        if self._meets > 1:  # past a pole the rows come down on the other side
            within = np.where(above, -1 - rows, np.where(below, 2 * height - 1 - rows, rows))
            pixels = self._read(np.clip(within, 0, height - 1), columns)
            if (above | below).any():
                pixels[above | below] = self._read(within[above | below], columns + self._file.size[0] // 2)
        else:
            pixels = self._read(np.clip(rows, 0, height - 1), columns)
        return source_window(pixels, (left, top), self._projection, self.samples)

    def _read(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Pixels:
        """The pixels at rows, all within the picture, and columns, which go round it or end at its border."""
        width = self._file.size[0]
        columns = columns % width if self._meets else np.clip(columns, 0, width - 1)
        top, bottom = int(rows.min()), int(rows.max()) + 1
        breaks = np.flatnonzero(np.diff(columns) < 0) + 1
        parts = []
        for part in np.split(columns, breaks):
            left, right = int(part.min()), int(part.max()) + 1
            window = self._file.window(left, top, right - left, bottom - top)
            parts.append(window[rows - top][:, part - left])
        return np.concatenate(parts, axis=1)


def _columns(u: Places, v: Places, columns: slice) -> tuple[Places, Places]:
    return np.ascontiguousarray(u[:, columns]), np.ascontiguousarray(v[:, columns])
