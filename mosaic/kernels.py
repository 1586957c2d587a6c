"""Compiled loops of registration."""

from __future__ import annotations

import numpy as np

from fullsphere.model.kernels import compiled


@compiled
def two_best(
    similarity: np.ndarray,
    first_row: int,
    best_of_row: np.ndarray,
    rows: np.ndarray,
    best_of_column: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Take a block of rows (n, m) of a similarity matrix into the two best of every row and every column, in one pass.

    `best_of_row` (N,) and `best_of_column` (m,) are the index of the best; `rows` (N, 2) and `columns` (m, 2) hold the
    best and the second best value.  Of equal values the first counts as the best.
    """
    for k in range(similarity.shape[0]):
        i = first_row + k
        top, second, at = rows[i, 0], rows[i, 1], best_of_row[i]
        for j in range(similarity.shape[1]):
            s = similarity[k, j]
            if s > second:
                if s > top:
                    second, top, at = top, s, j
                else:
                    second = s
            if s > columns[j, 1]:
                if s > columns[j, 0]:
                    columns[j, 1], columns[j, 0], best_of_column[j] = columns[j, 0], s, i
                else:
                    columns[j, 1] = s
        rows[i, 0], rows[i, 1], best_of_row[i] = top, second, at
