"""How far off an adjustment may be: the covariance of its unknowns, from the residuals themselves.

Errors of matches are not independent: a keypoint is matched in several frames, and near things, moving things and a
lens that is not quite right push all matches of a neighbourhood the same way.  So the covariance is that of scores
summed over neighbourhoods of the sphere, B^-1 (sum g g^T) B^-1 (Huber 1967; White 1982; clusters: Liang & Zeger 1986).
It is never taken to be less than that of independent errors, s^2 B^-1.  What a camera's calibration left open goes
into the rotations through their sensitivity to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.unknowns import Unknowns

_CELL_DEG = 5.0  # side of a neighbourhood: wider than a keypoint's reach, and some thousand fit on a sphere


class Scores(NamedTuple):
    """Of an adjustment's last step: J^T W J (U, U), scores J^T W r summed by neighbourhood (cells, U), and more.

    Attributes
    ----------
    hessian, by_cell
        As said.
    matches
        How many there were.
    variance
        Of one coordinate of a keypoint, square pixels, outliers not counted.
    curvature
        What share of the Hessian is left where residuals are large: sum w^2 over sum w for Cauchy weights w.
    """

    hessian: FloatArray
    by_cell: FloatArray
    matches: int
    variance: float
    curvature: float


class Uncertainty(NamedTuple):
    """Factors F (U, k) of two covariances F F^T of the unknowns: errors alike in a neighbourhood, and independent."""

    unknowns: Unknowns
    clustered: FloatArray
    independent: FloatArray

    @classmethod
    def of(
        cls,
        scores: Scores,
        unknowns: Unknowns,
        information: FloatArray,
        fixed: Sequence[tuple[NDArray[np.intp], FloatArray]],
    ) -> Self:
        """From scores, the information (U, U) known beforehand, and what was fixed: (places, covariance) of values."""
        held = np.zeros(unknowns.size, bool)
        blocks = [np.zeros((unknowns.size, 0))]
        for own, covariance in fixed:
            held[own] = True
            block = np.zeros((unknowns.size, len(covariance)))
            block[own] = _root(covariance)
            blocks.append(block)
        free = ~held
        inverse = _inverse_factor((scores.hessian + information)[np.ix_(free, free)])
        solve = np.zeros((unknowns.size, unknowns.size))
        solve[np.ix_(free, free)] = inverse @ inverse.T
        known = np.concatenate(blocks, 1)
        known -= solve @ (scores.hessian @ known)  # the sensitivity of the rotations to what was fixed
        believed = math.sqrt(scores.variance) * solve @ _root(information)
        cells = len(scores.by_cell)
        most = 2 * scores.matches
        sample = math.sqrt(cells / max(cells - 1, 1) * most / max(most - int(free.sum()), 1))
        clustered = sample / scores.curvature * solve @ scores.by_cell.T
        independent = np.zeros((unknowns.size, inverse.shape[1]))
        independent[free] = math.sqrt(scores.variance) * inverse
        return cls(unknowns, np.concatenate([clustered, believed, known], 1), np.concatenate([independent, known], 1))

    def of_rotations(self, rotations: FloatArray, group: NDArray[np.intp], mounts: FloatArray) -> FloatArray:
        """One standard deviation (n,) of the angle of camera_from_world (n, 3, 3), zero outside the group.

        The world is the one in which the turns of all frames of the group are zero on average.
        """
        turns = np.zeros((len(group), 3, self.unknowns.size))
        for row, frame in zip(turns, group, strict=True):
            for places, block in self.unknowns.blocks(int(frame), np.eye(3), None, mounts):
                row[:, places] = rotations[frame].T @ block  # in the world, where they can be averaged
        turns -= turns.mean(0)
        flat = turns.reshape(-1, self.unknowns.size)
        variance = [((flat @ f) ** 2).sum(1).reshape(-1, 3).sum(1) for f in (self.clustered, self.independent)]
        sigma = np.zeros(len(rotations))
        sigma[group] = np.sqrt(np.maximum(*variance))
        return sigma

    def of_camera(self, index: int, count: int) -> FloatArray:
        """Covariance (count, count) of a camera's values; zero for those that were neither free nor uncertain."""
        columns, places = self.unknowns.columns[index], self.unknowns.camera_at[index]
        clustered, independent = self.clustered[places], self.independent[places]
        share = (clustered**2).sum(1) / np.maximum((independent**2).sum(1), 1e-300)
        factor = clustered if len(columns) and float(np.median(share)) > 1 else independent
        covariance = np.zeros((count, count))
        covariance[np.ix_(columns, columns)] = factor @ factor.T
        return covariance


def neighbourhoods(directions: FloatArray) -> NDArray[np.intp]:
    """Number of the cell of the sphere, of about equal area, that each of the unit directions (n, 3) lies in."""
    bands = round(180 / _CELL_DEG)
    band = np.clip((np.arccos(np.clip(directions[:, 1], -1, 1)) / math.pi * bands).astype(np.intp), 0, bands - 1)
    around = np.maximum(np.round(2 * bands * np.sin((np.arange(bands) + 0.5) * math.pi / bands)).astype(np.intp), 1)
    turn = np.arctan2(directions[:, 0], directions[:, 2]) / (2 * math.pi) + 0.5
    return np.asarray(
        (np.cumsum(around) - around)[band] + np.minimum(turn * around[band], around[band] - 1).astype(np.intp)
    )


def unit_scale(hessian: FloatArray) -> FloatArray:
    """Scales (n,) that give the Hessian a unit diagonal; a parameter without any effect is left where it is."""
    diagonal = np.diag(hessian)
    return np.asarray(1 / np.sqrt(np.maximum(diagonal, 1e-14 * max(float(diagonal.max(initial=0.0)), 1e-300))))


def _inverse_factor(matrix: FloatArray) -> FloatArray:
    """F (n, k) with F F^T the pseudo-inverse of a symmetric matrix (n, n), taken with unit diagonal."""
    scale = unit_scale(matrix)
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    good = values > len(values) * 1e-15 * values.max(initial=0.0)
    return np.asarray(scale[:, None] * vectors[:, good] / np.sqrt(values[good]))


def _root(matrix: FloatArray) -> FloatArray:
    """F (n, n) with F F^T = matrix, symmetric and not negative; the rounding of tiny eigenvalues apart."""
    if not matrix.any():
        return np.zeros((len(matrix), 0))
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / scale / scale[:, None])
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0)))
