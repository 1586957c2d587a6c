"""How far matches are from agreeing with orientations and cameras, in pixels, with derivatives.

A match (u_i, u_j) gives the residual project(R_j R_i^T unproject(u_i)) - u_j in pixels, whitened by the covariance
I + A A^T of two equally good keypoints, A = d project / d u_i.  Residual: Brown & Lowe, IJCV 2007, section 4.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray, angle_of_radius
from fullsphere.mosaic.match_kernels import turned, whiten
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig

_AS_FAR = 1.5  # times the image circle's radius: what lies further out is no match


class MatchArrays(NamedTuple):
    """Frame numbers (m,) and matched pixels (m, 2) of many links, one after the other."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    pixels_i: FloatArray
    pixels_j: FloatArray

    @classmethod
    def of(cls, links: Sequence[Link]) -> Self:
        """The matches of links that fits may use."""
        return cls._of(links, [(link.pixels_i, link.pixels_j) for link in links])

    @classmethod
    def held_back(cls, links: Sequence[Link]) -> Self:
        """The matches of links that no fit sees."""
        return cls._of(links, [(link.held_i, link.held_j) for link in links])

    @classmethod
    def _of(cls, links: Sequence[Link], pixels: Sequence[tuple[FloatArray, FloatArray]]) -> Self:
        count = [len(i) for i, _ in pixels]
        ends = np.array([[link.i, link.j] for link in links], np.intp).reshape(-1, 2)
        none = np.empty((0, 2))
        return cls(
            np.repeat(ends[:, 0], count),
            np.repeat(ends[:, 1], count),
            np.concatenate([none, *(i for i, _ in pixels)]),
            np.concatenate([none, *(j for _, j in pixels)]),
        )


class MatchErrors(NamedTuple):
    """Whitened residuals (m, 2), and derivatives by both rotations (m, 2, 3) and both cameras (m, 2, P).

    Rotations move by a small turn from the left, exp([w]x) R.  P is the largest number of parameters of a camera;
    columns that a camera does not have are zero.
    """

    residual: FloatArray
    by_i: FloatArray
    by_j: FloatArray
    by_camera_i: FloatArray
    by_camera_j: FloatArray


def match_errors(matches: MatchArrays, rotations: FloatArray, cameras: Sequence[Camera], rig: Rig) -> MatchErrors:
    """Residuals of matches under camera_from_world (n, 3, 3) and the cameras that took the frames.

    NaN where a ray leaves the domain of the camera's lens.
    """
    opened = [opened_camera(camera) for camera in cameras]
    parameters = max(len(camera.values) for camera in cameras)
    count = len(matches.i)
    errors = MatchErrors(*(np.zeros((count, 2, *last)) for last in ((), (3,), (3,), (parameters,), (parameters,))))
    combined = rig.camera_of[matches.i] * len(cameras) + rig.camera_of[matches.j]
    for pair in np.unique(combined):
        own = np.flatnonzero(combined == pair)
        some = MatchArrays(matches.i[own], matches.j[own], matches.pixels_i[own], matches.pixels_j[own])
        of_some = _errors(some, rotations, opened[pair // len(cameras)], opened[pair % len(cameras)])
        for array, part in zip(errors, of_some, strict=True):
            array[..., : part.shape[-1]][own] = part
    return errors


def held_out_px(links: Sequence[Link], rotations: FloatArray, cameras: Sequence[Camera], rig: Rig) -> FloatArray:
    """Distances (m,) on the sphere between the two rays of each match that no fit saw, in pixels."""
    distances = distances_px(MatchArrays.held_back(links), rotations, cameras, rig)
    return np.asarray(distances[np.isfinite(distances)])


def distances_px(matches: MatchArrays, rotations: FloatArray, cameras: Sequence[Camera], rig: Rig) -> FloatArray:
    """Distances (m,) on the sphere between the two rays of each match, in pixels; NaN where a camera sees nothing.

    An angle counts as many pixels as it spans in the picture on average, r(half_fov) / half_fov.
    """
    rays = []
    for frames, pixels in ((matches.i, matches.pixels_i), (matches.j, matches.pixels_j)):
        ray = np.full((len(frames), 3), np.nan)
        for k, camera in enumerate(cameras):
            own = rig.camera_of[frames] == k
            ray[own] = camera.unproject(pixels[own])
        rays.append((ray[:, None] @ rotations[frames])[:, 0])
    chord = np.linalg.norm(rays[0] - rays[1], axis=1)
    scale = np.array([camera.image_radius / camera.half_fov for camera in cameras])[rig.camera_of[matches.j]]
    return np.asarray(2 * np.arcsin(np.minimum(chord / 2, 1)) * scale)


def opened_camera(camera: Camera) -> Camera:
    """The camera with its field of view widened, so that a ray slightly past the rim still has a residual."""
    limit = min(camera.half_fov + 0.35, camera.lens.theta_max * (1 - 1e-6))
    if float(camera.lens.radius(limit)) > _AS_FAR * camera.image_radius:  # a lens near its pole reaches far out at once
        limit = float(angle_of_radius(camera.lens, _AS_FAR * camera.image_radius, limit))
    return dataclasses.replace(camera, half_fov=max(limit, camera.half_fov))


def _errors(matches: MatchArrays, rotations: FloatArray, camera_i: Camera, camera_j: Camera) -> MatchErrors:
    turn_of, firsts = _runs(matches.i, matches.j)
    turns = rotations[matches.j[firsts]] @ np.swapaxes(rotations[matches.i[firsts]], -1, -2)
    ray_i = camera_i.unproject(matches.pixels_i)
    at_i = camera_i.project_with_jacobians(ray_i)
    ray_j = np.empty_like(ray_i)
    turned(ray_i, turns, turn_of, ray_j)
    at_j = camera_j.project_with_jacobians(ray_j)
    count = len(ray_i)
    values = (len(camera_i.values), len(camera_j.values))
    errors = MatchErrors(*(np.empty((count, 2, *last)) for last in ((), (3,), (3,), values[:1], values[1:])))
    whiten(
        ray_i,
        ray_j,
        at_i.d_pixel_d_ray,
        at_j.d_pixel_d_ray,
        turns,
        turn_of,
        at_j.pixels - matches.pixels_j,
        at_i.d_pixel_d_parameter,
        at_j.d_pixel_d_parameter,
        *errors,
    )
    return errors


def _runs(i: NDArray[np.intp], j: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For each of pairs (m,) that come in runs the number of its run, and where each run begins."""
    begins = np.ones(len(i), bool)
    begins[1:] = (np.diff(i) != 0) | (np.diff(j) != 0)
    return np.cumsum(begins) - 1, np.flatnonzero(begins)
