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
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig


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
    """Distances (m,) on the sphere between the two rays of each match that no fit saw, in pixels.

    An angle counts as many pixels as it spans in the picture on average, r(half_fov) / half_fov.
    """
    matches = MatchArrays.held_back(links)
    rays = []
    for frames, pixels in ((matches.i, matches.pixels_i), (matches.j, matches.pixels_j)):
        ray = np.full((len(frames), 3), np.nan)
        for k, camera in enumerate(cameras):
            own = rig.camera_of[frames] == k
            ray[own] = camera.unproject(pixels[own])
        rays.append((ray[:, None] @ rotations[frames])[:, 0])
    chord = np.linalg.norm(rays[0] - rays[1], axis=1)
    scale = np.array([camera.image_radius / camera.half_fov for camera in cameras])[rig.camera_of[matches.j]]
    distances = 2 * np.arcsin(np.minimum(chord / 2, 1)) * scale
    return np.asarray(distances[np.isfinite(distances)])


def opened_camera(camera: Camera) -> Camera:
    """The camera with its field of view widened, so that a ray slightly past the rim still has a residual."""
    limit = min(camera.half_fov + 0.35, camera.lens.theta_max * (1 - 1e-6))
    return dataclasses.replace(camera, half_fov=max(limit, camera.half_fov))


def _errors(matches: MatchArrays, rotations: FloatArray, camera_i: Camera, camera_j: Camera) -> MatchErrors:
    ray_i = camera_i.unproject(matches.pixels_i)
    at_i = camera_i.project_with_jacobians(ray_i)
    turn = rotations[matches.j] @ np.swapaxes(rotations[matches.i], -1, -2)
    ray_j = (turn @ ray_i[..., None])[..., 0]
    at_j = camera_j.project_with_jacobians(ray_j)
    # The ray of a fixed pixel: J is blind along the ray, so its pseudo-inverse moves the ray on the sphere only.
    ji = at_i.d_pixel_d_ray
    ji_transposed = np.swapaxes(ji, 1, 2)
    through = at_j.d_pixel_d_ray @ turn
    carried = through @ ji_transposed @ _inverse(ji @ ji_transposed)  # A = d u_j / d u_i
    whiten = _inverse_root(np.eye(2) + carried @ np.swapaxes(carried, 1, 2))
    return MatchErrors(
        (whiten @ (at_j.pixels - matches.pixels_j)[..., None])[..., 0],
        whiten @ through @ _cross_matrix(ray_i),
        -whiten @ at_j.d_pixel_d_ray @ _cross_matrix(ray_j),
        -whiten @ carried @ at_i.d_pixel_d_parameter,
        whiten @ at_j.d_pixel_d_parameter,
    )


def _inverse(m: FloatArray) -> FloatArray:
    """Inverses of 2 x 2 matrices (n, 2, 2)."""
    a, b, c, d = m[:, 0, 0], m[:, 0, 1], m[:, 1, 0], m[:, 1, 1]
    return np.stack([d, -b, -c, a], -1).reshape(-1, 2, 2) / (a * d - b * c)[:, None, None]


def _inverse_root(m: FloatArray) -> FloatArray:
    """Lower triangular W (n, 2, 2) with W m W^T = I of positive m (n, 2, 2): the inverse Cholesky factor."""
    first = np.sqrt(m[:, 0, 0])
    mixed = m[:, 1, 0] / first
    second = np.sqrt(m[:, 1, 1] - mixed**2)
    return np.stack([1 / first, np.zeros_like(first), -mixed / (first * second), 1 / second], -1).reshape(-1, 2, 2)


def _cross_matrix(v: FloatArray) -> FloatArray:
    """[v]x (m, 3, 3) of vectors (m, 3)."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
