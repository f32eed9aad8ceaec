"""How much more the scores of a fit vary than their features claim, from the fit's own residuals.

Errors of neighbouring features are correlated: patches overlap, a codec moves whole blocks, a rolling shutter whole
rows, relief whole slopes. Sums of scores over parts of the picture, larger than the correlation reaches, tell the
variance of their total whatever the correlation is (cluster-robust variance, Liang and Zeger 1986). How far it reaches
is not known. So the picture is divided in several ways, and the largest variance counts.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.kernels import F64, kernel, read
from stab_ros.core.types import FloatArray, IdArray

ACROSS = 12  # cells along each axis
_DIVISIONS = ((12, 12), (6, 6), (4, 4), (3, 3), (12, 1), (1, 12))  # down and across: cells, bands of rows, of columns
_LARGEST = 1.27  # the mean of the largest ratio where errors are independent (simulated, 30 to 2400 features)
_LEAST_LEFT = 0.25  # share of the variance that the fit must leave in the residuals to judge by them


@kernel((read(F64, 2),))
def cells_of(places_px: FloatArray) -> IdArray:
    """Cell (N,) of each place (N, 2), px, row by row over the area that the places cover."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for x, y in places_px:
        low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
    wide, tall = max(high_x - low_x, 1e-9) / ACROSS, max(high_y - low_y, 1e-9) / ACROSS
    cell = np.empty(len(places_px), np.int64)
    for i in range(len(places_px)):
        column, row = int((places_px[i, 0] - low_x) / wide), int((places_px[i, 1] - low_y) / tall)
        cell[i] = min(row, ACROSS - 1) * ACROSS + min(column, ACROSS - 1)
    return cell


def excess(normal: FloatArray, score: FloatArray, predicted: FloatArray) -> float:
    """Ratio of the empirical variance of the total score to its predicted variance; 0 where nothing can be said.

    Args:
        normal: (cells, k, k) normal matrices of the cells.
        score: (cells, k) scores of the cells.
        predicted: (k, k) variance of the total score.
    """
    inverse = np.linalg.inv(normal.sum(axis=0))
    values, axes = np.linalg.eigh((inverse + inverse.T) / 2)
    root = axes * np.sqrt(np.maximum(values, 0.0))  # of a matrix that rounding may have made slightly indefinite
    normal, score = root.T @ normal @ root, score @ root
    ratios = [_left_and_found(normal, score, *division) for division in _DIVISIONS]
    found = max((total / left for left, total in ratios if left > _LEAST_LEFT), default=0.0)
    return found / _LARGEST / float(np.trace(inverse @ predicted))


def _left_and_found(normal: FloatArray, score: FloatArray, down: int, across: int) -> tuple[float, float]:
    """Share of the scores' variance that is left after the fit, and what is found of it.

    The fit makes the scores add up to nothing. For errors that differ from cell to cell but not within, a share
    trace(N_c N_c) / k of each cell's variance is lost thereby, N_c in coordinates in which the sum of all is the unit
    matrix (Bell and McCaffrey 2002, with the mean over the parameters for the matrix).
    """
    k = score.shape[1]
    shape = (down, ACROSS // down, across, ACROSS // across)
    normals = normal.reshape(*shape, k * k).sum(axis=(1, 3)).reshape(-1, k * k)
    scores = score.reshape(*shape, k).sum(axis=(1, 3)).reshape(-1, k)
    return 1 - float(np.sum(normals**2)) / k, float(np.sum(scores**2))
