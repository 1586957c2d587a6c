"""Whether two frames differ by a rotation alone, or the camera moved between them as well.

With a translation t between the viewpoints the matched rays obey ((R x) x y) . t = 0 whatever their distance, while no
rotation brings them together: near things are off by up to |t| / distance.  The two models are compared by GRIC
(Torr, "Model selection for two view geometry: a review", 1999) with the keypoints' own noise, which the residuals of
the richer model tell.  A statistic says whether there is parallax; how much of it there is, is another question, and
answered apart: a tripod turned beside the entrance pupil always leaves some.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.matching import MIN_INLIERS, best_rotation, fit_rotation

REACH = 0.12
"""Share of the picture's radius by which parallax may pull a match from the rotation: ten degrees of a fisheye."""

_ENOUGH = 2 * MIN_INLIERS  # matches that fix the five values of a rotation and a direction, some being wrong
_MOST = 300  # matches of a pair that tell as much as all
_TRIALS = 300
_STARTS, _APART = 3, 0.9  # directions to refine, and the cosine between them at the most
_STEPS = 15
_CLOSE_PX = 4.0
_NONE_PX = 0.25  # median residual of a rotation below which there is no parallax worth a look
_NOISE_PX = 1.0  # scale to which keypoints are judged before their noise is known
_RAYLEIGH = math.sqrt(2 * math.log(2))  # median length of a vector of two unit normals
_CLEARLY = 3.0  # standard deviations of a keypoint that parallax must reach to be called so
_MATTERS_PX = 2.0  # and pixels: with less, a rotation still holds nearly all matches of the pair


class Parallax(NamedTuple):
    """How far a pair of frames is from a pure rotation.

    Attributes
    ----------
    verdict
        "parallax" where a translation explains the matches better, and moves half of them by more than two pixels and
        three standard deviations of a keypoint; else "rotation".
    size
        Angle in radians by which matches are off the best rotation on account of parallax, the median of them.
    size_px
        The same in pixels of the frames, those of a keypoint on either side.
    sigma_px
        Standard deviation of a keypoint along one axis, as the matches themselves tell.
    matches
        How many matches agree with a rotation and a translation.
    gain
        GRIC of the rotation minus that of rotation and translation, per match; positive speaks for a translation.
    rotation
        (3, 3), rays of the first frame into those of the second, near things and far ones weighed alike.
    direction
        Unit vector (3,) along the translation in the second frame; its sign is not known.  NaN where the rotation
        leaves next to nothing.
    turn
        (3, 3), the rotation that goes with the translation.
    """

    verdict: str
    size: float
    size_px: float
    sigma_px: float
    matches: int
    gain: float
    rotation: FloatArray
    direction: FloatArray
    turn: FloatArray


class _Rays(NamedTuple):
    """Unit rays (n, 3) of matches in both frames, and the angles (n,) that one pixel spans there."""

    a: FloatArray
    b: FloatArray
    pixel_a: FloatArray
    pixel_b: FloatArray

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> _Rays:
        return _Rays(*(values[which] for values in self))


class _Motion(NamedTuple):
    """Rotation (3, 3) and direction of translation (3,)."""

    rotation: FloatArray
    direction: FloatArray


def pair_parallax(
    rays_a: FloatArray,
    rays_b: FloatArray,
    pixel_a: FloatArray,
    pixel_b: FloatArray,
    reach_px: float,
    seed: int = 0,
    rotation: FloatArray | None = None,
) -> Parallax | None:
    """Compare rotation with rotation and translation on the matches of two frames.

    Parameters
    ----------
    rays_a, rays_b
        Unit rays (n, 3) of the matches, wrong ones among them, in the two camera frames.
    pixel_a, pixel_b
        Angle (n,) in radians that a pixel spans at each of them.
    reach_px
        How many pixels a match may be off the rotation.
    seed
        Of the random trials.
    rotation
        (3, 3) b from a where it is known: if it leaves next to nothing, that is the answer.

    Returns
    -------
    The comparison, or None where too few matches agree with any motion.
    """
    single = _single(rays_a, rays_b)
    evenly = np.linspace(0, len(single) - 1, min(len(single), _MOST)).round().astype(np.intp)
    rays = _Rays(rays_a, rays_b, pixel_a, pixel_b).chosen(single[evenly])
    pixel = np.hypot(rays.pixel_a, rays.pixel_b)
    if rotation is not None:
        apart_px = _apart(rays, rotation) / pixel
        within = apart_px < reach_px
        if within.sum() >= _ENOUGH and np.median(apart_px[within]) < _NONE_PX:
            return _none(rays.chosen(within), rotation)
    tolerance = reach_px * pixel
    near = fit_rotation(rays.a, rays.b, tolerance, seed)
    if near is None or near.inliers.sum() < _ENOUGH:
        return None
    rays = rays.chosen(near.inliers)
    # Much parallax leaves no rotation that many matches agree with closely, and little of it hides in a loose one.
    pixel = np.hypot(rays.pixel_a, rays.pixel_b)
    close = fit_rotation(rays.a, rays.b, _CLOSE_PX * pixel, seed)
    if close is not None and np.median(_apart(rays, close.rotation) / pixel) < _NONE_PX:
        return _none(rays, close.rotation)
    starts = [near.rotation] if close is None else [near.rotation, close.rotation]
    motions = [_best_motion(rays, start, np.random.default_rng(seed)) for start in starts]
    motion = min(motions, key=lambda motion: _cost(rays, motion, _NOISE_PX))
    off_plane = _off_plane_px(rays, motion)
    sigma = max(1.4826 * float(np.median(np.abs(off_plane))), 1e-3)
    agree = np.abs(off_plane) < 3 * sigma
    if agree.sum() < _ENOUGH:
        return None
    alone = _median_rotation(rays.chosen(agree), near.rotation)
    apart = _apart(rays, alone)
    gain = _gric(apart / pixel / sigma, 2, 3) - _gric(off_plane / sigma, 3, 5)
    size_px = math.sqrt(max(float(np.median((apart / pixel)[agree])) ** 2 - (_RAYLEIGH * sigma) ** 2, 0.0))
    clear = gain > 0 and size_px > max(_CLEARLY * sigma, _MATTERS_PX)
    return Parallax(
        "parallax" if clear else "rotation",
        size_px * float(np.median(pixel[agree])),
        size_px,
        sigma,
        int(agree.sum()),
        gain / len(rays.a),
        alone,
        motion.direction,
        motion.rotation,
    )


def parallaxes(
    evidence: Evidence,
    cameras: Sequence[Camera],
    pairs: Sequence[Pair],
    executor: Executor | None = None,
    rotations: Mapping[int, FloatArray] | None = None,
) -> Mapping[Pair, Parallax]:
    """The comparison for pairs of frames, by all their matches; those without enough matches are left out.

    Parameters
    ----------
    evidence
        Keypoints and matches.  The matches of links would not do: they agree with a rotation already.
    cameras
        Turn keypoints into rays.
    pairs
        Those to compare.
    executor
        Where pairs are worked on side by side.
    rotations
        camera_from_world (3, 3) of frames where they are known: pairs that agree with them closely cost no search.
    """
    known = rotations or {}
    camera_of = {k: cameras[evidence.camera_of.get(k, 0)] for k in evidence.features}

    def compare(pair: Pair) -> Parallax | None:
        (i, j), (first, second, *_) = pair, evidence.matches[pair]
        a = camera_of[i].unproject(evidence.features[i].pixels[first])
        b = camera_of[j].unproject(evidence.features[j].pixels[second])
        seen = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
        a, b = a[seen], b[seen]
        pixel_a, pixel_b = 1 / camera_of[i].pixels_per_radian(a), 1 / camera_of[j].pixels_per_radian(b)
        reach = REACH * min(camera_of[i].image_radius, camera_of[j].image_radius)
        turn = known[j] @ known[i].T if i in known and j in known else None
        return pair_parallax(a, b, pixel_a, pixel_b, reach, i * 100_003 + j, turn)

    found = ordered_map(executor, compare, list(pairs))
    return {pair: one for pair, one in zip(pairs, found, strict=True) if one is not None}


def _single(a: FloatArray, b: FloatArray) -> NDArray[np.intp]:
    """Indices of matches that share no ray with an earlier one: a place with two orientations is two keypoints."""
    kept = np.arange(len(a))
    for rays in (a, b):
        kept = np.sort(kept[np.unique(rays[kept], axis=0, return_index=True)[1]])
    return kept


def _none(rays: _Rays, rotation: FloatArray) -> Parallax:
    """The answer where a rotation leaves so little that nobody need ask whether it is noise or parallax."""
    apart_px = _apart(rays, rotation) / np.hypot(rays.pixel_a, rays.pixel_b)
    sigma = float(np.median(apart_px)) / _RAYLEIGH
    agree = int((apart_px < 4 * sigma).sum())
    return Parallax("rotation", 0.0, 0.0, sigma, agree, 0.0, rotation, np.full(3, np.nan), rotation)


def _apart(rays: _Rays, rotation: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(rays.a @ rotation.T - rays.b, axis=1))


def _off_plane_px(rays: _Rays, motion: _Motion) -> FloatArray:
    """n . t with n = (R x) x y, over its change when either keypoint moves by a pixel (n,)."""
    rotation, direction = motion
    turned = rays.a @ rotation.T
    by_a = rays.pixel_a**2 * (1 - (rays.b @ direction) ** 2)
    by_b = rays.pixel_b**2 * (1 - (turned @ direction) ** 2)
    off: FloatArray = (turned * (rays.b @ _crossed_with(direction))).sum(1) / np.sqrt(np.maximum(by_a + by_b, 1e-24))
    return off


def _crossed_with(v: FloatArray) -> FloatArray:
    """M (3, 3) with rows @ M = cross(rows, v)."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _best_motion(rays: _Rays, rotation: FloatArray, random: np.random.Generator) -> _Motion:
    """The motion that most matches agree with.

    With the rotation nearly known, two matches give a direction, at right angles to both of their n; the best of them
    are refined together with the rotation.
    """
    normals = np.cross(rays.a @ rotation.T, rays.b)
    pick = random.integers(0, len(normals), (_TRIALS, 2))
    directions = np.cross(normals[pick[:, 0]], normals[pick[:, 1]])
    length = np.linalg.norm(directions, axis=1)
    directions = directions[length > 1e-12] / length[length > 1e-12, None]
    if not len(directions):  # every match agrees with the rotation exactly: any direction will do
        return _Motion(rotation, np.array([1.0, 0.0, 0.0]))
    off = normals @ directions.T
    by_a = rays.pixel_a[:, None] ** 2 * (1 - (rays.b @ directions.T) ** 2)
    by_b = rays.pixel_b[:, None] ** 2 * (1 - (rays.a @ rotation.T @ directions.T) ** 2)
    squared = off**2 / np.maximum(by_a + by_b, 1e-24)
    cost = np.log1p(squared / (2 * _NOISE_PX) ** 2).sum(0)
    starts: list[FloatArray] = []
    for k in np.argsort(cost, kind="stable"):
        if len(starts) < _STARTS and all(abs(directions[k] @ other) < _APART for other in starts):
            starts.append(directions[k])
    best = [_refined(rays, _Motion(rotation, start)) for start in starts]
    return min(best, key=lambda motion: _cost(rays, motion, _NOISE_PX))


def _cost(rays: _Rays, motion: _Motion, scale: float) -> float:
    return float(np.log1p((_off_plane_px(rays, motion) / scale) ** 2).sum())


def _refined(rays: _Rays, motion: _Motion) -> _Motion:
    """Levenberg-Marquardt with Cauchy weights, the residuals' denominators held during a step."""
    for scale in (4 * _NOISE_PX, _NOISE_PX):
        cost, damping = _cost(rays, motion, scale), 1e-4
        for _ in range(_STEPS):
            moved = _stepped(rays, motion, scale, damping)
            following = _cost(rays, moved, scale)
            if not following < cost:
                damping *= 100
                if damping > 1:
                    break
                continue
            gain, cost, damping, motion = cost - following, following, damping / 10, moved
            if gain < 1e-4 * cost:
                break
    return motion


def _stepped(rays: _Rays, motion: _Motion, scale: float, damping: float) -> _Motion:
    rotation, direction = motion
    turned, off = rays.a @ rotation.T, _off_plane_px(rays, motion)
    tangents = _tangents(direction)
    x, y, z = turned.T
    by_t = rays.b @ _crossed_with(direction)
    p, q, r = by_t.T
    plain = x * p + y * q + z * r
    by_tangents = [(turned * (rays.b @ _crossed_with(tangent))).sum(1) for tangent in tangents.T]
    per = np.divide(off, plain, out=np.zeros_like(off), where=plain != 0)
    jacobian = np.stack([y * r - z * q, z * p - x * r, x * q - y * p, *by_tangents], -1) * per[:, None]
    weighted = jacobian / (1 + (off / scale) ** 2)[:, None]
    hessian = weighted.T @ jacobian
    hessian[np.diag_indices(5)] *= 1 + damping
    step = -np.linalg.lstsq(hessian, weighted.T @ off, rcond=1e-12)[0]
    along = direction + tangents @ step[3:]
    return _Motion(Rotation.from_rotvec(step[:3]).as_matrix() @ rotation, along / np.linalg.norm(along))


def _tangents(direction: FloatArray) -> FloatArray:
    """Two unit vectors, as columns (3, 2), at right angles to a unit vector and to each other."""
    axis = np.zeros(3)
    axis[np.abs(direction).argmin()] = 1.0
    first = np.cross(direction, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)], -1)


def _median_rotation(rays: _Rays, rotation: FloatArray) -> FloatArray:
    """The rotation with the least sum of angles: near things, however many, do not pull it as squares would."""
    pixel = np.hypot(rays.pixel_a, rays.pixel_b)
    for _ in range(20):
        apart = _apart(rays, rotation) / pixel
        rotation = best_rotation(rays.a, rays.b, 1 / (pixel**2 * np.maximum(apart, 0.1)))
    return rotation


def _gric(residuals: FloatArray, dimension: int, parameters: int) -> float:
    """Torr's criterion of residuals in standard deviations (n,), in the 4-space of two matched keypoints."""
    count = len(residuals)
    fit = np.minimum(residuals**2, 2 * (4 - dimension)).sum()
    return float(fit + dimension * count * math.log(4) + parameters * math.log(4 * count))
