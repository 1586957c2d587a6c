"""Levenberg-Marquardt over lens, centre, aspect and the pose of every view (equation 7 of the paper).

The values of the Bakstein-Pajdla lens are nearly interchangeable: the squared error lies in a bent canyon, along which
a descent over a, b, c, d takes hundreds of steps.  The pixels however depend on them only through the curve r(theta),
and depend on the curve linearly.  So the points are linearised once in the curve (a few odd Chebyshev polynomials),
the centre, the aspect and the poses, and reduced by QR to a dozen rows; in these the lens values are then
followed round the bends of the canyon at no cost worth mentioning.  A handful of passes over the points is enough.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.calibration import reduction
from fullsphere.model.calibration.lens_step import FRAME, best_camera, odd_polynomials
from fullsphere.model.calibration.points import Poses, Sightings
from fullsphere.model.calibration.reduction import POSE
from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, GeometryError
from fullsphere.model.lens import FloatArray

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-24, 1e12  # of squared columns: 1e-24 frees condition 1e12
_LITTLE = 1e-6  # a fall of the cost, in units of the residual variance, that ends the descent: 1e-3 of a sigma
_CRAWL, _CRAWLS = 1e-4, 4  # or falls so small, so often: a lens at the end of its canyon
_EXACT_PX = 1e-10  # residuals of this size are rounding
_RIM = 1e-9  # radians kept between the outermost point and the edge of the trial camera


@dataclasses.dataclass(frozen=True, eq=False)
class Solution:
    """Where a descent ended.

    Attributes
    ----------
    camera, poses
        The values reached.
    bow
        (2,) values of the board's bow (see `bow`), or none.
    residuals
        (N, 2) predicted minus observed, pixels.
    triangle
        (F, F) upper triangular; triangle.T @ triangle is the information on the F free camera values, poses and bow
        marginalised, for a residual variance of 1.
    converged, iterations
        Whether nothing was left to gain, and after how many linearisations.
    """

    camera: Camera
    poses: Poses
    bow: FloatArray
    residuals: FloatArray
    triangle: FloatArray
    converged: bool
    iterations: int

    @property
    def rms_px(self) -> float:
        """sqrt(mean(du^2 + dv^2))."""
        return math.sqrt(float(np.mean(np.sum(self.residuals**2, -1))))


def solve(
    sightings: Sightings,
    camera: Camera,
    poses: Poses,
    free: Sequence[str] | None = None,
    shapes: FloatArray | None = None,
) -> Solution:
    """Minimise the squared reprojection error; as `descend`, but an end short of the minimum is an error.

    Raises
    ------
    GeometryError
        If there are fewer measurements than unknowns, the start leaves the lens's domain, or the descent does not
        converge; the message says what was reached.
    """
    solution = descend(sightings, camera, poses, free, shapes=shapes)
    if not solution.converged:
        raise GeometryError(
            f"calibration: the {camera.lens.projection} lens did not converge; {solution.iterations} steps reached "
            f"rms {solution.rms_px:.4g} px. Check the points for outliers and mixed-up rows, or try another lens"
        )
    return solution


def descend(
    sightings: Sightings,
    camera: Camera,
    poses: Poses,
    free: Sequence[str] | None = None,
    max_iterations: int = 100,
    shapes: FloatArray | None = None,
) -> Solution:
    """Levenberg-Marquardt from the given camera and poses.

    Parameters
    ----------
    sightings
        The measured points.
    camera
        Start; its `half_fov` does not limit the fit (the lens's own domain does), and the camera returned has the
        largest angle at which a point stands.
    poses
        Start; rotations are updated from the left.
    free
        Those of `camera.parameter_names` that may change; None frees all.  Poses are always free.
    max_iterations
        Linearisations after which the descent ends, converged or not.
    shapes
        (N, 2) of `bow_shapes`, for a board that may be bowed; None for a flat board or a target in space.

    Raises
    ------
    GeometryError
        If there are fewer measurements than unknowns, or the start leaves the lens's domain.
    """
    columns = np.array([i for i, name in enumerate(camera.parameter_names) if free is None or name in free], np.intp)
    bent = np.zeros((sightings.count, 0)) if shapes is None else shapes
    unknowns = columns.size + POSE * len(sightings.images) + bent.shape[1]
    if 2 * sightings.count <= unknowns:
        raise GeometryError(
            f"calibration: {sightings.count} points give {2 * sightings.count} measurements for {unknowns} unknowns; "
            "more points are needed"
        )
    centroids = np.array([part.mean(0) for part in sightings.split(sightings.points)])
    problem = _Problem(sightings, sightings.points - centroids[sightings.view], bent, columns)
    arm = np.einsum("vij,vj->vi", poses.camera_from_target, centroids) + poses.translation
    first = problem.linearised(_State(camera, poses.camera_from_target, arm, np.zeros(bent.shape[1])))
    if first is None:
        raise GeometryError(
            f"calibration: points stand outside the domain of the {camera.lens.projection} lens at the start; "
            "try a lens that sees further"
        )
    reached, converged, iterations = problem.descend(first, max_iterations, 2 * sightings.count - unknowns)
    state = reached.state
    translation = state.arm - np.einsum("vij,vj->vi", state.rotation, centroids)
    return Solution(
        state.camera,
        Poses(state.rotation, translation),
        state.bow,
        reached.residuals,
        problem.information(reached),
        converged,
        iterations,
    )


class _State(NamedTuple):
    """Values on the way; `arm` (V, 3) leads to the centroid of a view's points, not to the target's origin.

    Turning about the centroid moves the picture least, which keeps rotation and translation apart.
    """

    camera: Camera
    rotation: FloatArray
    arm: FloatArray
    bow: FloatArray


class _Linear(NamedTuple):
    """A linearisation: triangles (V, K, K) over [pose | curve | centre, aspect | bow | residual], and their making."""

    state: _State
    triangles: FloatArray
    residuals: FloatArray
    of_pose: FloatArray  # (N, 2, 6)
    of_camera: FloatArray  # (N, 2, P)
    of_bow: FloatArray  # (N, 2, 0 or 2)

    @property
    def cost(self) -> float:
        return float(np.sum(self.residuals**2))


class _Problem(NamedTuple):
    sightings: Sightings
    centred: FloatArray  # points (N, 3) from the centroid of their view
    shapes: FloatArray  # (N, 0 or 2) along the target's z, per value of the bow
    columns: NDArray[np.intp]  # of the camera's values, those that are free

    def descend(self, linear: _Linear, max_iterations: int, freedom: int) -> tuple[_Linear, bool, int]:
        """The linearisation reached, whether nothing is left to gain, and the number made."""
        damping, lift, crawled = _FIRST_DAMPING, 4.0, 0
        scale = reduction.column_norms(linear.triangles)
        for iteration in range(1, max_iterations + 1):
            scale = np.maximum(scale, reduction.column_norms(linear.triangles))
            variance = linear.cost / freedom
            held, small = reduction.damped(linear.triangles, scale, damping)
            camera, shared = best_camera(linear.state.camera, self.columns, small, _LITTLE * variance)
            of_poses = reduction.pose_steps(held, shared)
            promise = reduction.promised_fall(linear.triangles, of_poses, shared)
            little = promise <= _LITTLE * variance
            if linear.cost <= freedom * _EXACT_PX**2 or (little and damping <= _FIRST_DAMPING):
                return linear, True, iteration
            turn = Rotation.from_rotvec(of_poses[:, :3]).as_matrix()
            state = linear.state
            bow = state.bow + shared[shared.size - state.bow.size :]
            following = self.linearised(_State(camera, turn @ state.rotation, state.arm + of_poses[:, 3:], bow))
            if following is None or following.cost >= linear.cost:
                if little or damping > _MOST_DAMPING:  # rounding hides what may be left
                    return linear, little, iteration
                damping, lift = damping * lift, lift * 2
                continue
            fall = linear.cost - following.cost
            linear = following
            crawled = crawled + 1 if fall <= _CRAWL * variance else 0
            if crawled >= _CRAWLS:
                return linear, True, iteration
            easier = 0.02 if fall > 0.75 * promise else 0.3 if fall > 0.25 * promise else 2.0
            damping, lift = max(damping * easier, _LEAST_DAMPING), 4.0
        return linear, False, max_iterations

    def linearised(self, state: _State) -> _Linear | None:
        """The state, its camera seeing just far enough, linearised; None where the lens does not reach a point."""
        rotation = state.rotation[self.sightings.view]
        turned = (
            np.einsum("nij,nj->ni", rotation, self.centred) + rotation[:, :, 2] * (self.shapes @ state.bow)[:, None]
        )
        rays = turned + state.arm[self.sightings.view]
        across = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(across, rays[:, 2])
        camera = _reaching(state.camera, float(theta.max()))
        if camera is None:
            return None
        pixels, by_ray, of_camera = camera.project_with_jacobians(rays)
        residuals = pixels - self.sightings.pixels
        # a small rotation w moves the ray by w x turned, so a row g of by_ray gives turned x g
        of_pose = np.concatenate([np.cross(turned[:, None, :], by_ray), by_ray], -1)
        outward = rays[:, :2] / np.maximum(across, 1e-300)[:, None] * [1.0, camera.aspect]
        of_curve = outward[:, :, None] * odd_polynomials(theta / theta.max())[:, None, :]
        of_bow = np.einsum("nij,nj->ni", by_ray, rotation[:, :, 2])[:, :, None] * self.shapes[:, None, :]
        rows = np.concatenate([of_pose, of_curve, of_camera[..., -FRAME:], of_bow, residuals[..., None]], -1)
        if not np.isfinite(rows).all():
            return None
        triangles = reduction.triangles_by_view(rows, self.sightings.view, len(self.sightings.images))
        return _Linear(state._replace(camera=camera), triangles, residuals, of_pose, of_camera, of_bow)

    def information(self, linear: _Linear) -> FloatArray:
        """The triangle (F, F) of the free camera values, poses and bow marginalised."""
        rows = np.concatenate([linear.of_pose, linear.of_bow, linear.of_camera[..., self.columns]], -1)
        triangles = reduction.triangles_by_view(rows, self.sightings.view, len(self.sightings.images))
        bow = self.shapes.shape[1]
        return reduction.triangle(np.concatenate(triangles[:, POSE:, POSE:]))[bow:, bow:]


def _reaching(camera: Camera, angle: float) -> Camera | None:
    """The camera with a field of view just wider than the angle; None if its lens does not reach it."""
    limit = camera.lens.theta_max
    if not 0 < angle <= limit:
        return None
    try:
        return dataclasses.replace(camera, half_fov=min(angle + _RIM, limit))
    except CameraError:
        return None
