"""Bundle adjustment on the sphere: all orientations at once, and the cameras too where they are not known.

The residuals are those of `match_errors`.  Robust (Cauchy) iteratively reweighted least squares by
Levenberg-Marquardt; the normal equations are gathered link by link, a link touching the blocks of its two frames and
cameras only, so that memory does not grow with the number of matches times the number of frames.  Weights: Holland &
Welsch 1977.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray, angle_of_radius
from fullsphere.mosaic.lens_step import lens_moved
from fullsphere.mosaic.match_errors import MatchArrays, match_errors, opened_camera
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Poses, Rig, poses_of
from fullsphere.mosaic.uncertainty import Scores, Uncertainty, neighbourhoods, unit_scale
from fullsphere.mosaic.unknowns import Unknowns, free_columns

_MAX_STEPS = 60
_NOTHING = 0.01  # variances of a keypoint: who gains less moves by less than a tenth of a standard deviation
_UNDETERMINED = 1e-10  # eigenvalue of the rotations' unit-diagonal Hessian: matches within a thousandth of a degree
_WIDEST = math.radians(140)  # half field of view that a camera may grow to while its lens is being found


class Adjustment(NamedTuple):
    """What an adjustment found.

    Attributes
    ----------
    rotations
        camera_from_world (n, 3, 3) of the frames.
    cameras
        The cameras.
    mounts
        camera_from_rig (c, 3, 3) of the cameras.
    sigma
        One standard deviation (n,) in radians of the angle that each frame is turned from the truth, the world being
        that in which the errors of all frames of the group are zero on average.
    covariances
        Of each camera's values, (P, P) in the order of its `parameter_names`; zero where a value was not free and
        not known to be uncertain.
    residuals_px
        For each link the lengths (m,) of its matches' whitened residuals: the error of one keypoint.
    cost
        The robust sum that was minimised, in square pixels.
    """

    rotations: FloatArray
    cameras: tuple[Camera, ...]
    mounts: FloatArray
    sigma: FloatArray
    covariances: tuple[FloatArray, ...]
    residuals_px: tuple[FloatArray, ...]
    cost: float


class Known(NamedTuple):
    """What is known of a camera beforehand: names (k,) of values, the values (k,) and their covariance (k, k)."""

    names: Sequence[str]
    values: FloatArray
    covariance: FloatArray


class _Problem(NamedTuple):
    """What stays the same: links and their matches, who took what, the unknowns and which of
    the cameras' values are tied together, beliefs about cameras, the scale.
    """

    links: Sequence[Link]
    matches: MatchArrays
    rig: Rig
    unknowns: Unknowns
    tied: Sequence[int]
    beliefs: Sequence[_Belief]
    scale: float


class _Belief(NamedTuple):
    """What is known of some unknowns at `places` (k,) beforehand: values (k,) and information (k, k), per pixel^2."""

    camera: int
    columns: NDArray[np.intp]
    places: NDArray[np.intp]
    values: FloatArray
    information: FloatArray


class _State(NamedTuple):
    """A point of the search, with cost, residual lengths, J^T W J and J^T W r there."""

    poses: Poses
    cameras: tuple[Camera, ...]
    cost: float
    residuals: FloatArray
    hessian: FloatArray
    gradient: FloatArray


def adjust(
    links: Sequence[Link],
    rotations: FloatArray,
    group: NDArray[np.intp],
    cameras: Sequence[Camera],
    free: Sequence[str] = (),
    robust_scale_px: float = 1.0,
    tolerance: float = 1e-7,
    rig: Rig | None = None,
    known: Sequence[Known | None] = (),
    tied: Sequence[str] = (),
) -> Adjustment:
    """Refine the rotations of a connected group, and the camera parameters named in `free`.

    Parameters
    ----------
    links
        Between frames of the group.
    rotations
        Starting camera_from_world (n, 3, 3) of all frames; the first shot of the group stays as it is.
    group
        Indices of the frames to adjust.
    cameras
        Starting cameras.  Their fields of view do not limit the fit; each keeps imaging the same circle, so that its
        `half_fov` follows the lens.
    free
        Names of parameters that are free in every camera that has them.
    robust_scale_px
        Residual at which a match has half of its weight.  Keypoints are good to a third of a pixel.
    tolerance
        Relative fall of the cost that is no longer worth a step.
    rig
        Which camera took which frame, and which were taken at once; by default one camera took each by itself.
    known
        What is known of each camera beforehand; None where nothing is.  A free camera is held by it; the uncertainty
        of one that is not free goes into that of the rotations.
    tied
        Names out of `free` that have one value for all cameras, which then start with it.

    Raises
    ------
    GeometryError
        If the matches do not determine the rotations.
    """
    rig = rig or Rig.of_one_camera(len(rotations))
    together = [n for n, name in enumerate(cameras[0].parameter_names) if name in tied]
    unknowns = Unknowns.of(rig, group, free_columns(cameras, free, rig, group), together)
    poses = poses_of(rotations, rig, group, len(cameras))
    problem = _Problem(links, MatchArrays.of(links), rig, unknowns, together, (), robust_scale_px)
    state = _evaluate(problem, poses, tuple(cameras))
    beliefs = _beliefs(unknowns, cameras, known, spread_px(state.residuals) ** 2)
    if beliefs:
        problem = problem._replace(beliefs=beliefs)
        state = _evaluate(problem, poses, tuple(cameras))
    state = _descend(problem, state, tolerance)
    return _result(problem, state, rotations, group, known)


def _descend(problem: _Problem, state: _State, tolerance: float) -> _State:
    damping, growth = 1e-4, 2.0
    for _ in range(_MAX_STEPS):
        step = _damped_step(state, damping)
        following = _moved(problem, state, step)
        if following is None or not following.cost < state.cost:
            damping, growth = damping * growth, 2 * growth
            if damping > 1e8:
                break
            continue
        fall = state.cost - following.cost
        # How well the fall was foretold says how the damping goes on (Nielsen, IMM-REP-1999-05, DTU, 1999).
        foretold = float(step @ (damping * np.diag(state.hessian) * step - state.gradient))
        variance = min(problem.scale, spread_px(following.residuals)) ** 2
        ended = fall < max(tolerance * state.cost, _NOTHING * variance)
        state, growth = following, 2.0
        damping = max(damping * max(0.1, 1 - (2 * fall / foretold - 1) ** 3), 1e-12)
        if ended:
            break
    return state


def _evaluate(problem: _Problem, poses: Poses, cameras: tuple[Camera, ...]) -> _State:
    """Cost sum of scale^2 log(1 + (r/scale)^2), and the normal equations with its weights 1/(1 + (r/scale)^2)."""
    size = problem.unknowns.size
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    cost, squared = 0.0, np.zeros(len(problem.matches.i))
    for own, places, jacobian, residual, weight in _rows(problem, poses, cameras):
        root = np.sqrt(weight)
        weighted = (jacobian * root[:, None, None]).reshape(-1, len(places))
        hessian[np.ix_(places, places)] += weighted.T @ weighted
        gradient[places] += weighted.T @ (residual * root[:, None]).ravel()
        squared[own] = (residual**2).sum(1)
    cost = float(np.log1p(squared / problem.scale**2).sum()) * problem.scale**2
    for belief in problem.beliefs:
        off = cameras[belief.camera].values[belief.columns] - belief.values
        hessian[np.ix_(belief.places, belief.places)] += belief.information
        gradient[belief.places] += belief.information @ off
        cost += float(off @ belief.information @ off)
    return _State(poses, cameras, cost, np.sqrt(squared), hessian, gradient)


class _Rows(NamedTuple):
    """One link's part: its matches, the unknowns (k,) it touches, J (m, 2, k), residuals (m, 2) and weights (m,)."""

    matches: slice
    places: NDArray[np.intp]
    jacobian: FloatArray
    residual: FloatArray
    weight: FloatArray


def _rows(problem: _Problem, poses: Poses, cameras: tuple[Camera, ...]) -> Iterator[_Rows]:
    errors = match_errors(problem.matches, poses.rotations(problem.rig), cameras, problem.rig)
    weight = 1 / (1 + (errors.residual**2).sum(1) / problem.scale**2)
    end = 0
    for link in problem.links:
        own = slice(end, end + len(link.pixels_i))
        end = own.stop
        blocks: list[tuple[NDArray[np.intp], FloatArray]] = []
        for frame, by_frame, by_camera in (
            (link.i, errors.by_i[own], errors.by_camera_i[own]),
            (link.j, errors.by_j[own], errors.by_camera_j[own]),
        ):
            blocks += problem.unknowns.blocks(frame, by_frame, by_camera, poses.mounts)
        places = np.unique(np.concatenate([np.empty(0, np.intp), *(at for at, _ in blocks)]))
        jacobian = np.zeros((own.stop - own.start, 2, len(places)))
        for at, block in blocks:
            jacobian[..., np.searchsorted(places, at)] += block
        yield _Rows(own, places, jacobian, errors.residual[own], weight[own])


def _beliefs(
    unknowns: Unknowns, cameras: Sequence[Camera], known: Sequence[Known | None], variance: float
) -> tuple[_Belief, ...]:
    """What covariances say of the free values, weighed against matches of so much variance in square pixels."""
    found = []
    for k, belief in enumerate(known):
        if belief is None:
            continue
        index = [cameras[k].parameter_names.index(name) for name in belief.names]
        own = np.isin(index, unknowns.columns[k])
        columns = np.array(index, np.intp)[own]
        if not own.any():
            continue
        covariance = belief.covariance[np.ix_(own, own)]
        scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        unit = covariance / scale / scale[:, None]
        information = variance * np.linalg.pinv(unit, rcond=1e-13, hermitian=True) / scale / scale[:, None]
        places = unknowns.camera_at[k][np.searchsorted(unknowns.columns[k], columns)]
        found.append(_Belief(k, columns, places, belief.values[own], information))
    return tuple(found)


def _damped_step(state: _State, damping: float) -> FloatArray:
    """-(H + damping diag H)^-1 g, solved with unit diagonal."""
    scale = unit_scale(state.hessian)
    scaled = state.hessian * scale * scale[:, None]
    scaled[np.diag_indices_from(scaled)] += damping + 1e-14
    try:
        return np.asarray(-scale * cho_solve(cho_factor(scaled), scale * state.gradient))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise GeometryError("the matches do not determine the frames' orientations") from error


def _moved(problem: _Problem, state: _State, step: FloatArray) -> _State | None:
    """The state after a step, or None where the step leaves the camera model's domain."""
    unknowns = problem.unknowns
    shots, mounts = state.poses.shots.copy(), state.poses.mounts.copy()
    for turned, places in ((shots, unknowns.shot_at), (mounts, unknowns.mount_at)):
        for index, place in places.items():
            turned[index] = Rotation.from_rotvec(step[place : place + 3]).as_matrix() @ turned[index]
    cameras = list(state.cameras)
    reach = max(camera.half_fov for camera in cameras)  # one for all, so that tied lenses stay the same
    for k, camera in enumerate(cameras):
        columns = unknowns.columns[k]
        if len(columns):
            values, change = camera.values, np.zeros(len(camera.values))
            change[columns] = step[unknowns.camera_at[k]]
            of_lens = len(camera.lens.values)
            values[of_lens:] += change[of_lens:]
            values[:of_lens] = lens_moved(camera.lens, change[:of_lens], reach)
            moved = with_same_circle(camera, values)
            if moved is None:
                return None
            cameras[k] = moved
    following = _evaluate(problem, Poses(shots, mounts), tuple(cameras))
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


def spread_px(residuals: FloatArray) -> float:
    """Standard deviation of one coordinate: lengths are Rayleigh distributed, with a median of s sqrt(2 ln 2)."""
    return float(np.median(residuals)) / math.sqrt(2 * math.log(2)) if residuals.size else 0.0


def _result(
    problem: _Problem, state: _State, rotations: FloatArray, group: NDArray[np.intp], known: Sequence[Known | None]
) -> Adjustment:
    turns = problem.unknowns.turns
    scale = unit_scale(state.hessian)[:turns]
    if turns and np.linalg.eigvalsh(state.hessian[:turns, :turns] * scale * scale[:, None])[0] < _UNDETERMINED:
        raise GeometryError("the matches do not determine the frames' orientations")
    found = rotations.copy()
    found[group] = state.poses.rotations(problem.rig)[group]
    uncertainty = _uncertainty(problem, state, found, group, known)
    ends = np.cumsum([len(link.pixels_i) for link in problem.links])
    return Adjustment(
        found,
        state.cameras,
        state.poses.mounts,
        uncertainty.of_rotations(found, group, state.poses.mounts),
        tuple(uncertainty.of_camera(k, len(camera.values)) for k, camera in enumerate(state.cameras)),
        tuple(np.split(state.residuals, ends[:-1])),
        state.cost,
    )


def _uncertainty(
    problem: _Problem, state: _State, rotations: FloatArray, group: NDArray[np.intp], known: Sequence[Known | None]
) -> Uncertainty:
    """Of all that was free, and of the cameras' values that were fixed although they are uncertain."""
    columns, fixed = list(problem.unknowns.columns), []
    used = set(problem.rig.camera_of[group].tolist())
    for k, given in enumerate(known):
        if given is not None and k in used and not len(columns[k]):
            index = np.array([state.cameras[k].parameter_names.index(name) for name in given.names], np.intp)
            order = np.argsort(index)[np.diag(given.covariance)[np.argsort(index)] > 0]
            columns[k] = index[order]
            fixed.append((k, given.covariance[np.ix_(order, order)]))
    unknowns = Unknowns.of(problem.rig, group, columns, problem.tied)
    problem = problem._replace(unknowns=unknowns)
    matches = problem.matches
    cells = np.zeros(len(matches.i), np.intp)
    for k, camera in enumerate(state.cameras):
        own = problem.rig.camera_of[matches.i] == k
        ray = opened_camera(camera).unproject(matches.pixels_i[own])
        cells[own] = neighbourhoods((ray[:, None] @ rotations[matches.i[own]])[:, 0])
    names, cells = np.unique(cells, return_inverse=True)
    hessian, by_cell = np.zeros((unknowns.size, unknowns.size)), np.zeros((len(names), unknowns.size))
    weights = np.zeros(len(cells))
    for own, places, jacobian, residual, weight in _rows(problem, state.poses, state.cameras):
        weighted = jacobian * weight[:, None, None]
        hessian[np.ix_(places, places)] += np.einsum("mki,mkj->ij", weighted, jacobian)
        np.add.at(by_cell, (cells[own, None], places), np.einsum("mki,mk->mi", weighted, residual))
        weights[own] = weight
    information = np.zeros_like(hessian)
    for belief in problem.beliefs:
        own = np.searchsorted(unknowns.columns[belief.camera], belief.columns)
        places = unknowns.camera_at[belief.camera][own]
        information[np.ix_(places, places)] += belief.information
    curvature = float((weights**2).sum() / weights.sum())
    scores = Scores(hessian, by_cell, len(cells), spread_px(state.residuals) ** 2, curvature)
    return Uncertainty.of(scores, unknowns, information, [(unknowns.camera_at[k], c) for k, c in fixed])
