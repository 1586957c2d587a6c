"""Where two straight edges of a chessboard cross, to a few hundredths of a pixel.

The picture near an inner corner is  I(p) = m + k erf(d1/s1) erf(d2/s2),  d_i the signed distance of the pixel p from
edge i: two blurred steps multiplied.  All eight values (corner, the two edges' directions, m, k, the two blurs) are
fitted by damped Gauss-Newton, for all corners at once.  Unlike a gradient-orthogonality search it needs no large
window, does not care how blurred or how oblique the corner is, and says by its residuals whether there was a corner
at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from fullsphere.model.lens import FloatArray

_STEPS = 12
_DIFF_OF_ERF = 2 / np.sqrt(np.pi)
_MIN_PIXELS = 16  # twice the unknowns
_FURTHEST_PX = 7  # from the corner: beyond it the edges of a wide-angle picture bend


class Saddles(NamedTuple):
    """Fitted corners: pixel (n, 2), its standard deviation (n,) in px, k (n,), and residual RMS (n,) over |k|.

    Where there were too few pixels, everything is NaN.
    """

    pixels: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    misfit: FloatArray


def fit_saddles(
    light: NDArray[np.float32],
    start: FloatArray,
    px_from_square: FloatArray,
    clear: float,
    reach: float = 0.3,
    bend: FloatArray | None = None,
) -> Saddles:
    """Fit corners near `start` (n, 2).

    Parameters
    ----------
    light
        Picture (h, w) in any unit proportional to light.
    start
        First guesses, off by less than a few pixels.
    px_from_square
        Local map (n, 2, 2) from the board to pixels: its columns are the steps of one square along x and y.
    clear
        How far, in squares, the chessboard goes on undisturbed on both sides of an edge (up to the marker's border).
    reach
        How far along the edges to look, in squares.
    bend
        Second derivatives (n, 2, 2, 2) of the pixels by the board's coordinates in squares, pixel axis first.  A
        straight line on the board is a curve in the picture; taken for straight, it draws the corner to its inner
        side by some hundredths of a pixel.  None where they are not known.
    """
    count = len(start)
    around = np.arange(-_FURTHEST_PX - 1, _FURTHEST_PX + 2)
    offsets = np.stack(np.meshgrid(around, around), -1).reshape(-1, 2)
    origin = np.rint(start)
    at = origin[:, None] + offsets  # (n, m, 2)
    straight = _straightened(offsets, start - origin, px_from_square, bend)
    height, width = light.shape
    inside = np.all((at >= 0) & (at <= [width - 1, height - 1]), axis=-1)
    column, row = np.where(inside[..., None], at, 0).astype(np.intp).transpose(2, 0, 1)
    values = light[row, column].astype(float)
    guess = _first_guess(px_from_square)
    guess[:, :2] = start - origin
    result = Saddles(*(np.full(shape, np.nan) for shape in ((count, 2), count, count, count)))
    fitted = guess
    for _ in range(2):  # the window follows the corner once
        weight = inside & _window(straight - fitted[:, None, :2], px_from_square, clear, reach)
        enough = weight.sum(1) >= _MIN_PIXELS
        if not enough.any():
            return result
        guess[:, :2] = fitted[:, :2]
        _set_levels(guess, values, weight, straight)
        fitted, sigma, misfit = _gauss_newton(guess, values, weight.astype(float), straight)
    good = enough & np.isfinite(fitted).all(1)
    corners = _bent(fitted[:, :2], start - origin, px_from_square, bend)
    result.pixels[good] = (corners + origin)[good]
    result.sigma_px[good], result.contrast[good], result.misfit[good] = sigma[good], fitted[good, 5], misfit[good]
    return result


def _straightened(
    offsets: NDArray[np.intp], start: FloatArray, px_from_square: FloatArray, bend: FloatArray | None
) -> FloatArray:
    """Pixels (n, m, 2) moved to where they would be if the picture of the board were only sheared and scaled.

    To second order in s, the squares from `start`:  pixel = start + P s + s B s / 2, so what is taken off is s B s / 2.
    """
    relative = offsets - start[:, None]
    if bend is None:
        return np.asarray(offsets + np.zeros_like(relative), float)
    with np.errstate(invalid="ignore"):
        squares = np.einsum("nij,nmj->nmi", _inverse(px_from_square), relative)
    return np.asarray(offsets - np.einsum("nkij,nmi,nmj->nmk", bend, squares, squares) / 2, float)


def _bent(corners: FloatArray, start: FloatArray, px_from_square: FloatArray, bend: FloatArray | None) -> FloatArray:
    """Straightened corners (n, 2) back in the picture: the inverse of `_straightened`."""
    if bend is None:
        return corners
    squares = np.einsum("nij,nj->ni", _inverse(px_from_square), corners - start)
    return np.asarray(corners + np.einsum("nkij,ni,nj->nk", bend, squares, squares) / 2, float)


def _inverse(matrices: FloatArray) -> FloatArray:
    """Inverses (n, 2, 2); NaN where there is none."""
    regular = np.abs(np.linalg.det(matrices)) > 0
    return np.where(
        regular[:, None, None], np.linalg.inv(np.where(regular[:, None, None], matrices, np.eye(2))), np.nan
    )


def _first_guess(px_from_square: FloatArray) -> FloatArray:
    """Rows (u, v, angle 1, angle 2, m, k, log s1, log s2): edge 1 runs along x, edge 2 along y."""
    along_x, along_y = px_from_square[:, :, 0], px_from_square[:, :, 1]
    guess = np.zeros((len(px_from_square), 8))
    guess[:, 2] = np.arctan2(along_x[:, 1], along_x[:, 0])
    guess[:, 3] = np.arctan2(along_y[:, 1], along_y[:, 0])
    return guess


def _window(relative: FloatArray, px_from_square: FloatArray, clear: float, reach: float) -> NDArray[np.bool_]:
    """Pixels (n, m) near the corner's edges but clear of the markers."""
    with np.errstate(invalid="ignore"):
        to_square = np.linalg.inv(px_from_square)
        across = np.abs(np.einsum("nij,nmj->nmi", to_square, relative))
        # a pixel and its blur take this much, in squares, of the way to the marker
        pixel = 0.9 * np.linalg.norm(to_square, axis=2)[:, None, :]
        near_edge = (across < clear - pixel).any(-1) | (across < 0.6 * clear).any(-1)
        close = (across < reach).all(-1) & (np.linalg.norm(relative, axis=-1) < _FURTHEST_PX)
    return np.asarray(near_edge & close, bool)


def _distances(p: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signed distances (n, m) of pixels (n, m, 2) from both edges; positive on the side the other edge points to."""
    x, y = offsets[..., 0] - p[:, :1], offsets[..., 1] - p[:, 1:2]
    turned = np.sign(np.sin(p[:, 3:4] - p[:, 2:3]))
    d1 = turned * (np.cos(p[:, 2:3]) * y - np.sin(p[:, 2:3]) * x)
    d2 = turned * (np.sin(p[:, 3:4]) * x - np.cos(p[:, 3:4]) * y)
    return d1, d2


def _set_levels(p: FloatArray, values: FloatArray, weight: NDArray[np.bool_], offsets: FloatArray) -> None:
    """Grey levels m and k, and blur, to start from: linear regression on the sharp pattern."""
    d1, d2 = _distances(p, offsets)
    pattern = erf(d1) * erf(d2)
    n = np.maximum(weight.sum(1), 1)
    mean_value, mean_pattern = (values * weight).sum(1) / n, (pattern * weight).sum(1) / n
    centred = (pattern - mean_pattern[:, None]) * weight
    p[:, 5] = (centred * values).sum(1) / np.maximum((centred**2).sum(1), 1e-9)
    p[:, 4] = mean_value - p[:, 5] * mean_pattern
    p[:, 6:] = 0.0


def _gauss_newton(
    start: FloatArray, values: FloatArray, weight: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters (n, 8), standard deviation of the corner (n,), residual RMS over |k| (n,)."""
    p, damping = start.copy(), np.full(len(start), 1e-3)
    model, jacobian = _model(p, offsets)
    residual = (values - model) * weight
    error = (residual**2).sum(1)
    for _ in range(_STEPS):
        normal = np.einsum("nmi,nm,nmj->nij", jacobian, weight, jacobian)
        diagonal = np.einsum("nii->ni", normal)
        damped = normal + (damping[:, None] * diagonal + 1e-12)[:, :, None] * np.eye(8)
        step = np.linalg.solve(damped, np.einsum("nmi,nm->ni", jacobian, residual)[..., None])[..., 0]
        step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        trial = p + step
        trial[:, 6:] = np.clip(trial[:, 6:], -1.6, 1.6)  # blur between 0.2 and 5 px
        trial_model, trial_jacobian = _model(trial, offsets)
        trial_residual = (values - trial_model) * weight
        trial_error = (trial_residual**2).sum(1)
        better = trial_error <= error
        damping = np.where(better, damping / 4, damping * 8)
        p, jacobian = np.where(better[:, None], trial, p), np.where(better[:, None, None], trial_jacobian, jacobian)
        residual, error = np.where(better[:, None], trial_residual, residual), np.where(better, trial_error, error)
    freedom = np.maximum(weight.sum(1) - 8, 1)
    normal = np.einsum("nmi,nm,nmj->nij", jacobian, weight, jacobian)
    covariance = np.linalg.pinv(normal, hermitian=True)[:, :2, :2] * (error / freedom)[:, None, None]
    sigma = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 0.0))
    return p, sigma, np.sqrt(error / freedom) / np.maximum(np.abs(p[:, 5]), 1e-9)


_LARGEST_STEP = np.array([1.0, 1.0, 0.2, 0.2, np.inf, np.inf, 0.3, 0.3])


def _model(p: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """I (n, m) and its derivatives (n, m, 8)."""
    d1, d2 = _distances(p, offsets)
    x, y = offsets[..., 0] - p[:, :1], offsets[..., 1] - p[:, 1:2]
    turned = np.sign(np.sin(p[:, 3:4] - p[:, 2:3]))
    c1, s1, c2, s2 = (f(p[:, i : i + 1]) for i in (2, 3) for f in (np.cos, np.sin))
    blur1, blur2 = np.exp(p[:, 6:7]), np.exp(p[:, 7:8])
    e1, e2 = erf(d1 / blur1), erf(d2 / blur2)
    k = p[:, 5:6]
    by_d1 = k * e2 * _DIFF_OF_ERF * np.exp(-((d1 / blur1) ** 2)) / blur1
    by_d2 = k * e1 * _DIFF_OF_ERF * np.exp(-((d2 / blur2) ** 2)) / blur2
    jacobian = np.stack(
        [
            turned * (by_d1 * s1 - by_d2 * s2),
            turned * (-by_d1 * c1 + by_d2 * c2),
            -turned * by_d1 * (s1 * y + c1 * x),
            turned * by_d2 * (c2 * x + s2 * y),
            np.ones_like(e1),
            e1 * e2,
            -by_d1 * d1,
            -by_d2 * d2,
        ],
        -1,
    )
    return p[:, 4:5] + k * e1 * e2, jacobian
