"""Exposures, tints and vignetting from what several frames recorded in the same directions.

One robust linear least-squares problem in EV (after Brown & Lowe, IJCV 2007, section 6; d'Angelo, ICVS 2007): the
scene's own light in each direction and colour is eliminated by its mean, and what stays are the normal equations of
the levels of all frames in each colour and of two values of each camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear

from fullsphere.model.lens import FloatArray

_GREEN = 1
_COLOURS = 3

_HUBER_EV = 0.15
_STEPS, _SETTLED_EV = 30, (1e-3, 1e-5)  # of each of the two kinds of weights
_SPREADS, _LEAST_SPREAD_EV = 4.0, 0.01  # beyond so many of the spread of what agrees a value hardly counts any more

# Priors, as sums of squares beside those of the values that were compared, in EV.  All of them give way to a few
# hundred of those; they decide where overlaps do not.
_MEAN, _NOTED, _TINT = 1e-4, 0.1, 0.25
_FALLOFF, _SHAPE = 0.003, 0.1
_STEEPER = 1.5  # the slope at the rim to that on the axis, over s, that lenses have without telling better

_MOST_FALLOFF_EV = 4.0  # a unit of s
_MOST_TINT_EV = 1.0  # daylight to lamps, by automatic white balance, is less; what is more is no camera's
_SEEN_TINT_EV = 0.01  # less in all frames is no tint but noise: pictures stay as they were developed


class Photometry(NamedTuple):
    """How frames recorded the scene.

    Attributes
    ----------
    exposure_ev
        (n,) how much brighter than their mean, by green.
    white_balance
        (n, 3) factors beside that, green 1; geometric mean 1 over the frames.
    vignetting_ev
        (w1, w2) of each camera: 2^(w1 s + w2 s^2) falls from the axis to the rim s = 1.
    shade_ev
        What the edge of each camera takes beside (`edge_shade`); empty as long as that is not measured.
    """

    exposure_ev: FloatArray
    white_balance: FloatArray
    vignetting_ev: tuple[tuple[float, float], ...]
    shade_ev: tuple[tuple[float, ...], ...] = ()


def fit(
    levels: NDArray[np.float32],
    s: NDArray[np.float32],
    camera: NDArray[np.intp],
    cameras: int,
    noted_ev: FloatArray | None = None,
) -> Photometry:
    """Solve for what frames recorded.

    Parameters
    ----------
    levels
        (n, d, 3) log2 of the light of n frames in d directions, NaN where it is not known.
    s
        (n, d) (theta/half_fov)^2 of the directions in the frames.
    camera
        (n,) which camera took each frame, of so many `cameras`.
    noted_ev
        (n,) exposures that the cameras noted; they count where the overlaps say little.
    """
    n = len(levels)
    if n == 0:
        return Photometry(np.zeros(0), np.ones((0, 3)), ((0.0, 0.0),) * cameras)
    data = [_Colour(levels[..., c], s, camera, cameras) for c in range(_COLOURS)]
    prior, towards = _priors(n, cameras, noted_ev)
    x = np.zeros(len(towards))
    for gently, settled in zip((True, False), _SETTLED_EV, strict=True):
        for _ in range(_STEPS):
            before, x = x, _step(data, prior, towards, cameras, gently)
            if np.abs(x - before).max() < settled:
                break
    return _photometry(x[: _COLOURS * n].reshape(_COLOURS, n), x[_COLOURS * n :].reshape(cameras, 2))


def scene_of(
    levels: NDArray[np.float32], s: NDArray[np.float32], camera: NDArray[np.intp], found: Photometry
) -> NDArray[np.float32]:
    """log2 of the scene's light (n, d, 3) as each frame tells it, its exposure, tint and vignetting taken out."""
    w1, w2 = np.array(found.vignetting_ev, np.float32)[camera].T[..., None]
    own = found.exposure_ev[:, None] + np.log2(found.white_balance)
    return np.asarray(levels - own[:, None] - (w1 * s + w2 * s**2)[..., None], np.float32)


def _step(data: list[_Colour], prior: FloatArray, towards: FloatArray, cameras: int, gently: bool) -> FloatArray:
    """Solve with the weights as they are, and weigh anew what then disagrees."""
    unknowns = len(towards)
    n = (unknowns - 2 * cameras) // _COLOURS
    normal, right = prior.copy(), towards.copy()
    for c, colour in enumerate(data):
        own = np.r_[c * n : (c + 1) * n, _COLOURS * n : unknowns]
        part, values = colour.normal_equations()
        normal[np.ix_(own, own)] += part
        right[own] += values
    x = _solved(normal, right, 2 * cameras)
    residuals = [colour.residuals(x[c * n : (c + 1) * n], x[_COLOURS * n :]) for c, colour in enumerate(data)]
    spread = _HUBER_EV if gently else max(_spread(residuals), _LEAST_SPREAD_EV)
    for colour, residual in zip(data, residuals, strict=True):
        colour.reweigh(residual, spread, gently)
    return x


class _Colour:
    """The values of one colour: what of them is compared, and how much each counts."""

    def __init__(
        self, level: NDArray[np.float32], s: NDArray[np.float32], camera: NDArray[np.intp], cameras: int
    ) -> None:
        seen = np.isfinite(level)
        several = seen.sum(0) >= 2
        self._seen = seen[:, several]
        self._level = np.where(self._seen, level[:, several], 0).astype(np.float64)
        at = s[:, several].astype(np.float64)
        # 2^-(p (s - s^2/2) + q s^2/2): p and q are the slopes on the axis and at the rim; it falls while both are > 0.
        self._falloff = (-(at - at**2 / 2), -(at**2) / 2)
        self._camera, self._cameras = camera, cameras
        self._weight = self._seen.astype(np.float64)

    def normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """(n + 2 cameras) equations of the frames' levels and of p and q of each camera."""
        w, n = self._weight, len(self._weight)
        total = np.maximum(w.sum(0), 1e-12)
        weighted = [self._of_camera(w * column, k) for k in range(self._cameras) for column in self._falloff]
        sums = np.array([part.sum(0) for part in weighted]).reshape(len(weighted), len(total))
        normal = np.zeros((n + len(weighted),) * 2)
        normal[:n, :n] = np.diag(w.sum(1)) - (w / total) @ w.T
        for j, part in enumerate(weighted):
            normal[:n, n + j] = part.sum(1) - w @ (sums[j] / total)
            for i in range(j + 1):
                own = (part * self._falloff[i % 2]).sum() if i // 2 == j // 2 else 0.0
                normal[n + i, n + j] = own - (sums[i] * sums[j] / total).sum()
        normal = np.triu(normal) + np.triu(normal, 1).T
        mean = (w * self._level).sum(0) / total
        off = self._level - mean
        right = np.concatenate([(w * off).sum(1), [(part * off).sum() for part in weighted]])
        return normal, right

    def residuals(self, level: FloatArray, falloff: FloatArray) -> FloatArray:
        """(n, d) of what a frame recorded from what all agree on."""
        p, q = falloff.reshape(-1, 2)[self._camera].T
        own = self._level - level[:, None] - p[:, None] * self._falloff[0] - q[:, None] * self._falloff[1]
        mean = (self._weight * own).sum(0) / np.maximum(self._weight.sum(0), 1e-12)
        return np.where(self._seen, own - mean, np.nan)

    def reweigh(self, residual: FloatArray, spread: float, gently: bool) -> None:
        """Huber's weights while `gently`, then those of Geman and McClure, which let go of what disagrees."""
        away = np.nan_to_num(np.abs(residual)) / spread
        weight = 1 / np.maximum(away, 1) if gently else 1 / (1 + (away / _SPREADS) ** 2) ** 2
        self._weight = np.where(self._seen, weight, 0.0)

    def _of_camera(self, values: FloatArray, camera: int) -> FloatArray:
        return np.where((self._camera == camera)[:, None], values, 0.0)


def _priors(n: int, cameras: int, noted_ev: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    unknowns = _COLOURS * n + 2 * cameras
    normal, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    frames = np.arange(n)
    green = _GREEN * n + frames
    if noted_ev is None:
        normal[green, green] += _MEAN
    else:
        normal[green, green] += _NOTED
        right[green] += _NOTED * (noted_ev - noted_ev.mean())
    for c in (0, 2):
        own = c * n + frames
        normal[own, own] += _TINT
        normal[green, green] += _TINT
        normal[own, green] -= _TINT
        normal[green, own] -= _TINT
    for k in range(cameras):
        p, q = _COLOURS * n + 2 * k + np.arange(2)
        normal[p, p] += _FALLOFF + _SHAPE * _STEEPER**2
        normal[q, q] += _FALLOFF + _SHAPE
        normal[[p, q], [q, p]] -= _SHAPE * _STEEPER
    return normal, right


def _solved(normal: FloatArray, right: FloatArray, bounded: int) -> FloatArray:
    """The least of x'Nx/2 - r'x with the last so many unknowns between 0 and `_MOST_FALLOFF_EV`."""
    free = len(right) - bounded
    factor = cho_factor(normal[:free, :free])
    inner = cho_solve(factor, np.column_stack([normal[:free, free:], right[:free]]))
    reduced = normal[free:, free:] - normal[free:, :free] @ inner[:, :-1]
    rest = right[free:] - normal[free:, :free] @ inner[:, -1]
    root = np.linalg.cholesky((reduced + reduced.T) / 2)
    falloff = lsq_linear(root.T, np.linalg.solve(root, rest), (0, _MOST_FALLOFF_EV), method="bvls").x
    return np.concatenate([inner[:, -1] - inner[:, :-1] @ falloff, falloff])


def _spread(residuals: list[FloatArray]) -> float:
    """One standard deviation of what agrees."""
    known = np.concatenate([residual[np.isfinite(residual)] for residual in residuals])
    return 1.4826 * float(np.median(np.abs(known))) if known.size else 0.0


def _photometry(level: FloatArray, falloff: FloatArray) -> Photometry:
    exposure = level[_GREEN] - level[_GREEN].mean()
    tint = level - level[_GREEN]
    tint = np.clip(tint - tint.mean(axis=1, keepdims=True), -_MOST_TINT_EV, _MOST_TINT_EV)
    if np.abs(tint).max() <= _SEEN_TINT_EV:
        tint = np.zeros_like(tint)
    vignetting = [(-float(p) + 0.0, float(p - q) / 2 + 0.0) for p, q in falloff]
    return Photometry(exposure, np.exp2(tint.T), tuple(vignetting))
