"""Hugin projects (.pto) as frames, cameras and control points; `docs/file-formats.md` says what is taken over."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.circle import within_circle
from fullsphere.model.errors import InputError
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.frames import read_files
from fullsphere.mosaic.project import Frame, Link, Mosaic
from fullsphere.mosaic.pto_images import read_images
from fullsphere.mosaic.pto_lens import PanoToolsLens
from fullsphere.mosaic.pto_text import PtoLine, read_lines
from fullsphere.mosaic.rim import common_circle

NORMAL, VERTICAL, HORIZONTAL = 0, 1, 2
"""Kinds of control points: the same thing in two pictures; two points of a line that is vertical, or horizontal."""

_FARTHEST_PX = 1e7
_ALIKE = 1e-9
_FEWEST = 2  # matches that determine a rotation
_MOST_NOTES = 20
_KNOWN = "pmickvo*"  # o and what follows * is what an optimiser reported; the rest of p and m is about output


class ControlPoints(NamedTuple):
    """Index of both frames (n,), pixels in both (n, 2), and kind (n,)."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    pixels_i: FloatArray
    pixels_j: FloatArray
    kind: NDArray[np.intp]

    def where(self, keep: NDArray[np.bool_]) -> ControlPoints:
        """Those marked in `keep` (n,)."""
        i, j, pixels_i, pixels_j, kind = self
        return ControlPoints(i[keep], j[keep], pixels_i[keep], pixels_j[keep], kind[keep])


@dataclasses.dataclass(frozen=True)
class Project:
    """What a Hugin project says.

    Attributes
    ----------
    frames
        Its pictures, in order, with the project's orientation as `prior` and not registered yet.  Two parts of one
        file are frames of one shot.
    cameras
        Those of the frames, as near to the project's lenses as ours come.
    error_px
        How far each camera is off its lens at most, pixels; 0 where the formula is the same.
    points
        Control points, of all kinds, in pixels of the frames.
    lenses
        The lens of each frame exactly as Hugin has it, for the whole of its file.
    recorded
        Whether the camera of each frame is the one that `write_pto` left in a comment.
    vignetting_ev
        Of each camera, as in `Mosaic`.
    missing
        Paths of pictures that are not there.
    notes
        What was not taken over, in plain sentences.
    """

    frames: tuple[Frame, ...]
    cameras: tuple[Camera, ...]
    error_px: tuple[float, ...]
    points: ControlPoints = dataclasses.field(repr=False)
    lenses: tuple[PanoToolsLens, ...] = dataclasses.field(repr=False)
    recorded: tuple[bool, ...] = dataclasses.field(repr=False)
    vignetting_ev: tuple[tuple[float, float], ...] = ()
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def rotations(self) -> FloatArray:
        """camera_from_world (n, 3, 3) of the frames as the project has them."""
        return np.array([frame.prior for frame in self.frames])

    @property
    def calibrated(self) -> bool:
        """Whether the lenses were ever adjusted, or written here; a new project has no more than a field of view."""
        return all(
            recorded or lens.a != 0 or lens.b != 0 or lens.c != 0
            for lens, recorded in zip(self.lenses, self.recorded, strict=True)
        )

    def opened(self, executor: Executor | None = None, progress: Callable[..., Any] | None = None) -> Project:
        """The project with its pictures looked at: ready to be registered.

        Frames whose picture is missing, damaged or of another size are left out with the reason; the others know what
        their files tell of them.  Orientations that are all alike are those of a new project, and no priors.  A project
        need not say where a circular fisheye ends: fields of view are ended at the image circles that pictures show.

        Parameters
        ----------
        executor
            Where files are read side by side.
        progress
            Wraps the loop over the files.
        """
        paths = list(dict.fromkeys(Path(frame.image) for frame in self.frames if frame.image not in self.missing))
        files = {str(path): file for path, file in zip(paths, read_files(paths, executor, progress), strict=True)}
        frames = tuple(
            _checked(frame, files.get(frame.image), lens.size)
            for frame, lens in zip(self.frames, self.lenses, strict=True)
        )
        if len(frames) > 1 and np.abs(self.rotations - self.rotations[0]).max() < _ALIKE:
            frames = tuple(dataclasses.replace(frame, prior=None) for frame in frames)
        cameras = tuple(
            within_circle(camera, common_circle([f for f in frames if f.camera == k and not f.reason]))
            for k, camera in enumerate(self.cameras)
        )
        return dataclasses.replace(self, frames=frames, cameras=cameras)

    def as_mosaic(self) -> Mosaic:
        """The project as it stands: its orientations, its control points as links."""
        frames = tuple(dataclasses.replace(frame, camera_from_world=frame.prior) for frame in self.frames)
        links = tuple(links_of(self.points, self.cameras, frames, self.rotations))
        return Mosaic(self.cameras, frames, links, vignetting_ev=self.vignetting_ev, level="hugin")


def read_pto(path: Path) -> Project:
    """Read a Hugin project.

    Raises
    ------
    InputError
        If the file cannot be read, holds no picture, or a value of a picture or control point is missing, no number
        or out of range; the message names the line.
    """
    path = Path(path)
    lines = read_lines(path)
    images = read_images(lines, path)
    frames = tuple(images.frames)
    missing = tuple(sorted({frame.image for frame in frames if not frame.sha256}))
    notes = [f"{line.where}: not understood, and skipped" for line in lines if line.kind not in _KNOWN] + images.notes
    if len(notes) > _MOST_NOTES:
        notes = [*notes[:_MOST_NOTES], f"{len(notes) - _MOST_NOTES} more of the kind"]
    return Project(
        frames=frames,
        cameras=tuple(fitted.camera for fitted in images.cameras),
        error_px=tuple(fitted.error_px for fitted in images.cameras),
        points=_points([line for line in lines if line.kind == "c"], frames),
        lenses=tuple(images.lenses),
        recorded=tuple(images.recorded),
        vignetting_ev=images.vignetting_ev,
        missing=missing,
        notes=tuple(notes),
    )


def links_of(
    points: ControlPoints, cameras: Sequence[Camera], frames: Sequence[Frame], rotations: FloatArray
) -> list[Link]:
    """Links of the pairs of frames that control points join, without those outside the field of view.

    `j_from_i` is the rotation that the points of the pair agree with best (Kabsch 1976), and where they do not
    determine one, the one between `rotations` (n, 3, 3), camera_from_world.
    """
    own = points.where((points.kind == NORMAL) & (points.i != points.j))
    swap = own.i > own.j
    i, j = np.minimum(own.i, own.j), np.maximum(own.i, own.j)
    a = np.where(swap[:, None], own.pixels_j, own.pixels_i)
    b = np.where(swap[:, None], own.pixels_i, own.pixels_j)
    links = []
    for first, second in sorted(Counter(zip(i.tolist(), j.tolist(), strict=True))):
        of_pair = (i == first) & (j == second)
        rays_i = cameras[frames[first].camera].unproject(a[of_pair])
        rays_j = cameras[frames[second].camera].unproject(b[of_pair])
        seen = np.isfinite(rays_i[:, 0]) & np.isfinite(rays_j[:, 0])
        if not seen.any():
            continue
        j_from_i = rotations[second] @ rotations[first].T
        if seen.sum() >= _FEWEST and not _on_one_axis(rays_i[seen]):
            j_from_i = np.asarray(Rotation.align_vectors(rays_j[seen], rays_i[seen])[0].as_matrix())
        links.append(Link(first, second, a[of_pair][seen], b[of_pair][seen], j_from_i))
    return links


def _checked(frame: Frame, file: Frame | None, size: tuple[int, int]) -> Frame:
    """The frame with what its file tells, or left out; `size` is that of the file by the project."""
    if file is None:
        return frame.left_out(f"there is no file {frame.image}")
    if file.reason:
        return frame.left_out(file.reason)
    if file.size != size:
        this, that = (f"{width} x {height}" for width, height in (file.size, size))
        return frame.left_out(f"is {this} pixels, the project is for {that}")
    return dataclasses.replace(
        frame, quarter_turns=file.quarter_turns, gravity=file.gravity, told_ev=file.told_ev, profile=file.profile
    )


def _on_one_axis(rays: FloatArray) -> bool:
    """Whether all rays have one direction, so that a turn about it is not seen."""
    return float(np.linalg.svd(rays, compute_uv=False)[1]) < 1e-3


def _points(lines: Sequence[PtoLine], frames: Sequence[Frame]) -> ControlPoints:
    ends, pixels, kinds = [], [], []
    for line in lines:
        pair = [line.whole(key) for key in ("n", "N")]
        for key, index in zip(("n", "N"), pair, strict=True):
            if index >= len(frames):
                raise InputError(f"{line.where}: {key}{index} is the number of no picture; there are {len(frames)}")
        ends.append(pair)
        pixels.append([line.number(key, most=_FARTHEST_PX) for key in ("x", "y", "X", "Y")])
        kinds.append(line.whole("t", NORMAL))
    of = np.array(ends, np.intp).reshape(-1, 2)
    corner = np.array([(frame.crop_px or (0, 0))[:2] for frame in frames], float)
    at = np.array(pixels, float).reshape(-1, 4)
    return ControlPoints(
        of[:, 0], of[:, 1], at[:, :2] - corner[of[:, 0]], at[:, 2:] - corner[of[:, 1]], np.array(kinds, np.intp)
    )
