"""Peaks of score maps (one map per point) with sub-pixel positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray

_MIN_SCORE_SHARE = 0.01  # scores are clipped at this share of the peak before the logarithm


@dataclass(frozen=True, eq=False)
class Peaks:
    """The highest score of each of N maps.

    Attributes:
        row, column: (N,) int64, px.
        height: (N,) the score.
    """

    row: IdArray
    column: IdArray
    height: FloatArray

    def around(self, maps: FloatArray, side: int) -> FloatArray:
        """Scores (N, side, side) around each peak; NaN outside the map."""
        reach = side // 2
        span = np.arange(-reach, reach + 1)
        padded = np.pad(maps, ((0, 0), (reach, reach), (reach, reach)), constant_values=np.nan)
        rows, columns = self.row[:, None] + reach + span, self.column[:, None] + reach + span
        return np.asarray(padded[np.arange(len(maps))[:, None, None], rows[:, :, None], columns[:, None, :]])


def highest(maps: FloatArray) -> Peaks:
    """The highest peak of each of `maps`, (N, h, w)."""
    n, height, width = maps.shape
    flat = maps.reshape(n, height * width)
    best = flat.argmax(axis=1)
    row, column = np.divmod(best, width)
    return Peaks(row, column, flat[np.arange(n), best])


def ratio(maps: FloatArray, peaks: Peaks) -> FloatArray:
    """Ratio (N,) of the highest to the second highest peak of `maps`, (N, h, w); infinite without a second one.

    A peak is a positive score that none of its eight neighbours exceeds.
    """
    others = np.where(_is_peak(maps), maps, 0.0)
    others[np.arange(len(maps)), peaks.row, peaks.column] = 0.0
    second = others.max(axis=(1, 2))
    return np.asarray(np.divide(peaks.height, second, out=np.full(len(maps), np.inf), where=second > 0))


def _is_peak(maps: FloatArray) -> BoolArray:
    """(N, h, w) bool: whether no neighbour is higher."""
    padded = np.pad(maps, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    rows = np.maximum(np.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])
    around = np.maximum(np.maximum(rows[:, :, :-2], rows[:, :, 1:-1]), rows[:, :, 2:])
    return np.asarray(maps >= around)


def gaussian_2x3(near: FloatArray) -> FloatArray:
    """Offsets (N, 2), x and y in px, of the peaks from the centres of scores (N, 3, 3): a Gaussian on each axis.

    The 2x3-point estimator (Willert and Gharib 1991): dx = (ln l - ln r) / (2 ln l - 4 ln c + 2 ln r). NaN where the
    scores are NaN or not concave.
    """
    level = _logarithm(near)
    middle = level[:, 1, 1]
    return np.stack([_vertex(level[:, 1, 0], middle, level[:, 1, 2]), _vertex(level[:, 0, 1], middle, level[:, 2, 1])],
                    axis=1)


def _vertex(before: FloatArray, middle: FloatArray, after: FloatArray) -> FloatArray:
    """Position of the maximum of the parabola through the values at -1, 0 and 1; NaN where it has none."""
    curvature = 2 * before - 4 * middle + 2 * after
    return np.asarray(np.divide(before - after, curvature, out=np.full(len(middle), np.nan), where=curvature < 0))


def gaussian_fit(near: FloatArray) -> FloatArray:
    """Offsets (N, 2), x and y in px, of the peaks from the centres of scores (N, k, k): a fitted 2-D Gaussian.

    Least squares over height, position, widths and orientation, linear in the logarithm of the scores. Weights equal to
    the squared score make errors count as in the scores themselves (Guo 2011). NaN where the scores are NaN or not
    concave, or where the peak lies outside the window.
    """
    reach = near.shape[1] // 2
    y, x = (axis.ravel().astype(float) for axis in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    unknown = ~np.isfinite(near.sum(axis=(1, 2)))
    scores = np.where(unknown[:, None, None], 1.0, near)
    share = np.maximum(scores, 0) / scores[:, reach, reach][:, None, None]
    weight = share.reshape(len(near), design.shape[0]) ** 2
    normal = np.einsum("np,pa,pb->nab", weight, design, design) + 1e-9 * np.eye(6)
    right = np.einsum("np,pa,np->na", weight, design, _logarithm(scores).reshape(weight.shape))
    _, bx, by, xx, xy, yy = np.linalg.solve(normal, right[:, :, None])[:, :, 0].T
    determinant = np.where((xx < 0) & (4 * xx * yy > xy**2), 4 * xx * yy - xy**2, np.nan)
    step = np.stack([xy * by - 2 * yy * bx, xy * bx - 2 * xx * by], axis=1) / determinant[:, None]
    step[unknown | (np.abs(step).max(axis=1) > reach)] = np.nan
    return step


def _logarithm(near: FloatArray) -> FloatArray:
    """Logarithm of the scores (N, k, k) relative to the central one."""
    middle = near[:, near.shape[1] // 2, near.shape[2] // 2][:, None, None]
    return np.asarray(np.log(np.maximum(near / middle, _MIN_SCORE_SHARE)))
