"""Bundle adjustment on the sphere: all rotations at once, and the camera too when it is not known.

A match (u_i, u_j) gives the residual project(R_j R_i^T unproject(u_i)) - u_j in pixels, whitened by the covariance
I + A A^T of two equally good keypoints, A = d project / d u_i.  Robust (Cauchy) iteratively reweighted least squares
by Levenberg-Marquardt; the normal equations are gathered link by link, so that memory does not grow with the number of
matches times the number of frames.  Residual: Brown & Lowe, IJCV 2007, section 4; weights: Holland & Welsch 1977.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray, angle_of_radius
from fullsphere.mosaic.project import Link

_MAX_STEPS = 60
_UNDETERMINED = 1e-10  # eigenvalue of the rotations' unit-diagonal Hessian: matches within a thousandth of a degree
_WIDEST = math.radians(140)  # half field of view that a camera may grow to while its lens is being found


class Adjustment(NamedTuple):
    """Rotations camera_from_world (n, 3, 3), the camera, and one standard deviation (n,) of each rotation in radians.

    `residuals_px` holds for each link the length (m,) of its matches' whitened residuals: the error of one keypoint.
    `cost` is the robust sum that was minimised, in square pixels.
    """

    rotations: FloatArray
    camera: Camera
    sigma: FloatArray
    residuals_px: tuple[FloatArray, ...]
    cost: float


class _Problem(NamedTuple):
    """What stays the same: links, place of each frame's unknowns (-1: none), free camera columns, robust scale.

    `matches` holds those of all links one after the other, with frame numbers (m,): one call of the camera for them
    all costs far less than one for each of hundreds of links.
    """

    links: Sequence[Link]
    matches: _Matches
    slot: dict[int, int]
    columns: list[int]
    scale: float

    @property
    def unknowns(self) -> int:
        return 3 * (len(self.slot) - 1) + len(self.columns)


class _Matches(NamedTuple):
    """Matched pixels (m, 2) in frames i and j, one pair of frames for all or (m,) of them."""

    i: Any
    j: Any
    pixels_i: FloatArray
    pixels_j: FloatArray

    @classmethod
    def of(cls, links: Sequence[Link]) -> Self:
        count = [len(link.pixels_i) for link in links]
        return cls(
            np.repeat([link.i for link in links], count),
            np.repeat([link.j for link in links], count),
            np.concatenate([link.pixels_i for link in links]),
            np.concatenate([link.pixels_j for link in links]),
        )


class _State(NamedTuple):
    """A point of the search, with cost, residual lengths, J^T W J and J^T W r there."""

    rotations: FloatArray
    camera: Camera
    cost: float
    residuals: list[FloatArray]
    hessian: FloatArray
    gradient: FloatArray


def adjust(
    links: Sequence[Link],
    rotations: FloatArray,
    group: NDArray[np.intp],
    camera: Camera,
    free: Sequence[str] = (),
    robust_scale_px: float = 1.0,
    tolerance: float = 1e-7,
) -> Adjustment:
    """Refine the rotations of a connected group, and the camera parameters named in `free`.

    Parameters
    ----------
    links
        Between frames of the group.
    rotations
        Starting camera_from_world (n, 3, 3) of all frames; the first of the group stays as it is.
    group
        Indices of the frames to adjust.
    camera
        Starting camera, shared by all frames.  Its field of view does not limit the fit; it keeps imaging the same
        circle, so that `half_fov` follows the lens.
    free
        Names out of `camera.parameter_names`.
    robust_scale_px
        Residual at which a match has half of its weight.  Keypoints are good to a third of a pixel.
    tolerance
        Relative fall of the cost that is no longer worth a step.

    Raises
    ------
    GeometryError
        If the matches do not determine the rotations.
    """
    slot = {int(frame): k - 1 for k, frame in enumerate(group)}  # the first frame holds the world: -1
    columns = [camera.parameter_names.index(name) for name in free]
    problem = _Problem(links, _Matches.of(links), slot, columns, robust_scale_px)
    state = _evaluate(problem, rotations, camera)
    damping = 1e-4
    for _ in range(_MAX_STEPS):
        following = _moved(problem, state, _damped_step(state, damping))
        if following is None or not following.cost < state.cost:
            damping *= 10
            if damping > 1e8:
                break
            continue
        gain = (state.cost - following.cost) / state.cost
        state, damping = following, max(damping / 10, 1e-12)
        if gain < tolerance:
            break
    return Adjustment(state.rotations, state.camera, _sigma(state, slot), tuple(state.residuals), state.cost)


def _evaluate(problem: _Problem, rotations: FloatArray, camera: Camera) -> _State:
    """Cost sum of scale^2 log(1 + (r/scale)^2), and the normal equations with its weights 1/(1 + (r/scale)^2)."""
    hessian, gradient = np.zeros((problem.unknowns, problem.unknowns)), np.zeros(problem.unknowns)
    shared = np.arange(problem.unknowns - len(problem.columns), problem.unknowns)
    linear = _linearise(problem.matches, rotations, camera)
    squared = (linear.residual**2).sum(1)
    relative = squared / problem.scale**2
    root = np.sqrt(1 / (1 + relative))
    residual = linear.residual * root[:, None]
    by_camera, by_i, by_j = (
        block * root[:, None, None] for block in (linear.by_camera[..., problem.columns], linear.by_i, linear.by_j)
    )
    ends = np.cumsum([len(link.pixels_i) for link in problem.links])
    for link, end in zip(problem.links, ends, strict=True):
        own = slice(end - len(link.pixels_i), end)
        blocks, places = [by_camera[own]], [shared]
        for frame, block in ((link.i, by_i), (link.j, by_j)):
            if problem.slot[frame] >= 0:
                blocks.append(block[own])
                places.append(np.arange(3) + 3 * problem.slot[frame])
        jacobian = np.concatenate(blocks, -1).reshape(-1, sum(map(len, places)))
        where = np.concatenate(places)
        hessian[np.ix_(where, where)] += jacobian.T @ jacobian
        gradient[where] += jacobian.T @ residual[own].ravel()
    cost = float(np.log1p(relative).sum()) * problem.scale**2
    return _State(rotations, camera, cost, np.split(np.sqrt(squared), ends[:-1]), hessian, gradient)


class _Linear(NamedTuple):
    """Whitened residuals (m, 2) and their derivatives by the two rotations (m, 2, 3) and the camera (m, 2, P)."""

    residual: FloatArray
    by_i: FloatArray
    by_j: FloatArray
    by_camera: FloatArray


def _linearise(matches: _Matches | Link, rotations: FloatArray, camera: Camera) -> _Linear:
    open_camera = _opened(camera)
    ray_i = open_camera.unproject(matches.pixels_i)
    at_i = open_camera.project_with_jacobians(ray_i)
    turn = rotations[matches.j] @ np.swapaxes(rotations[matches.i], -1, -2)
    ray_j = (turn @ ray_i[..., None])[..., 0]
    at_j = open_camera.project_with_jacobians(ray_j)
    # The ray of a fixed pixel: J is blind along the ray, so its pseudo-inverse moves the ray on the sphere only.
    ji = at_i.d_pixel_d_ray
    ji_transposed = np.swapaxes(ji, 1, 2)
    through = at_j.d_pixel_d_ray @ turn
    carried = through @ ji_transposed @ _inverse(ji @ ji_transposed)  # A = d u_j / d u_i
    whiten = _inverse_root(np.eye(2) + carried @ np.swapaxes(carried, 1, 2))
    return _Linear(
        (whiten @ (at_j.pixels - matches.pixels_j)[..., None])[..., 0],
        whiten @ through @ _cross_matrix(ray_i),
        -whiten @ at_j.d_pixel_d_ray @ _cross_matrix(ray_j),
        whiten @ (at_j.d_pixel_d_parameter - carried @ at_i.d_pixel_d_parameter),
    )


def _opened(camera: Camera) -> Camera:
    """The camera with its field of view widened, so that a ray slightly past the rim still has a residual."""
    limit = min(camera.half_fov + 0.35, camera.lens.theta_max * (1 - 1e-6))
    return dataclasses.replace(camera, half_fov=max(limit, camera.half_fov))


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


def _damped_step(state: _State, damping: float) -> FloatArray:
    """-(H + damping diag H)^-1 g, solved with unit diagonal."""
    scale = _unit_scale(state.hessian)
    scaled = state.hessian * scale * scale[:, None]
    scaled[np.diag_indices_from(scaled)] += damping + 1e-14
    try:
        return np.asarray(-scale * cho_solve(cho_factor(scaled), scale * state.gradient))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise GeometryError("the matches do not determine the frames' orientations") from error


def _unit_scale(hessian: FloatArray) -> FloatArray:
    """Scales (n,) that give the Hessian a unit diagonal; a parameter without any effect is left where it is."""
    diagonal = np.diag(hessian)
    return np.asarray(1 / np.sqrt(np.maximum(diagonal, 1e-14 * max(float(diagonal.max(initial=0.0)), 1e-300))))


def _moved(problem: _Problem, state: _State, step: FloatArray) -> _State | None:
    """The state after a step, or None where the step leaves the camera model's domain."""
    rotations = state.rotations.copy()
    for frame, k in problem.slot.items():
        if k >= 0:
            rotations[frame] = Rotation.from_rotvec(step[3 * k : 3 * k + 3]).as_matrix() @ rotations[frame]
    camera = state.camera
    if problem.columns:
        values = camera.values
        values[problem.columns] += step[len(step) - len(problem.columns) :]
        moved = with_same_circle(camera, values)
        if moved is None:
            return None
        camera = moved
    following = _evaluate(problem, rotations, camera)
    return following if math.isfinite(following.cost) else None


def with_same_circle(camera: Camera, values: FloatArray) -> Camera | None:
    """The camera with other intrinsic values, its half_fov such that the circle it images keeps its radius.

    None where the values describe no lens that reaches that radius.
    """
    try:
        lens = camera.lens.with_values(values[: len(camera.lens.values)])
        half_fov = float(angle_of_radius(lens, camera.image_radius, min(lens.theta_max * (1 - 1e-6), _WIDEST)))
        return camera.with_values(values, half_fov=half_fov) if half_fov > 0 else None
    except CameraError:
        return None


def _sigma(state: _State, slot: dict[int, int]) -> FloatArray:
    """One standard deviation of each rotation's angle (root mean square over its axes), from the inverse Hessian."""
    # Lengths of whitened residuals are Rayleigh distributed: their median is sigma sqrt(2 ln 2), outliers or not.
    spread = float(np.median(np.concatenate(state.residuals))) / math.sqrt(2 * math.log(2))
    scale = _unit_scale(state.hessian)
    scaled = state.hessian * scale * scale[:, None]
    turns = 3 * (len(slot) - 1)
    if turns and np.linalg.eigvalsh(scaled[:turns, :turns])[0] < _UNDETERMINED:
        raise GeometryError("the matches do not determine the frames' orientations")
    variance = np.diag(np.linalg.pinv(scaled, hermitian=True)) * scale**2 * spread**2
    sigma = np.zeros(len(state.rotations))
    for frame, k in slot.items():
        if k >= 0:
            sigma[frame] = math.sqrt(max(float(variance[3 * k : 3 * k + 3].mean()), 0.0))
    return sigma
