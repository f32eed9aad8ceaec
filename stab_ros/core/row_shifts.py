"""Displacements of the rows of one frame by a rolling shutter: a smooth curve down the frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DEGREE = 3
_STEP_PX = 0.25  # of the inverse, linear between
# uniform cubic B-spline (de Boor 1978): weights of four coefficients as polynomials of the place u within an interval
_CUBIC = np.array([[1.0, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6


@dataclass(frozen=True, eq=False)
class RowShifts:
    """A uniform cubic B-spline over the rows of a frame.

    What a frame shows at (x, y), a camera that takes all rows at once would show at (x, y) + `at(y)`.

    Attributes:
        coefficients: (K, 2) float64, K >= 4, along x and y, px.
        height: rows of the frame.

    Raises:
        ValueError: an array of another shape, or values that are not finite.
    """

    coefficients: NDArray[np.floating[Any]]
    height: int

    def __post_init__(self) -> None:
        shape = self.coefficients.shape
        if len(shape) != 2 or shape[1] != 2 or shape[0] <= _DEGREE or not np.isfinite(self.coefficients).all():
            raise ValueError(f"coefficients of shape {shape} are not finite (K, 2) with K above {_DEGREE}")

    def at(self, rows_px: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Displacements (n, 2), px, of rows (n,), px; those beyond the frame move as its first or last."""
        first, weights = spline_weights(rows_px, len(self.coefficients), self.height)
        return np.asarray(np.einsum("nk,nkd->nd", weights, self.coefficients[first[:, None] + np.arange(_DEGREE + 1)]))

    def before(self, points: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Where the frame shows what belongs to `points` (N, 2), px: the inverse of adding `at`."""
        rows_px = np.interp(points[:, 1], *self._inverse)
        return np.asarray(points - self.at(rows_px))

    @cached_property
    def _inverse(self) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]:
        """Rows as they belong, ascending, and the rows of the frame that show them, (n,) px each."""
        most = float(np.abs(self.coefficients).max()) + 1
        shown = np.arange(-most, self.height + most, _STEP_PX)
        return np.maximum.accumulate(shown + self.at(shown)[:, 1]), shown

    @property
    def intervals(self) -> int:
        """Number of intervals of the spline."""
        return len(self.coefficients) - _DEGREE

    @cached_property
    def values(self) -> NDArray[np.floating[Any]]:
        """Displacement (height, 2) of each row, px."""
        return self.at(np.arange(float(self.height)))

    def differs_px(self, other: RowShifts) -> float:
        """Largest distance from the displacements of another frame of this height, px."""
        return float(np.hypot(*(self.values - other.values).T).max())

    @property
    def rms_px(self) -> float:
        """Root mean square length of the displacements, px."""
        return float(np.sqrt(np.mean(np.sum(self.values**2, axis=1))))

    @property
    def most_px(self) -> float:
        """Length of the largest displacement, px."""
        return float(np.hypot(*self.values.T).max())


def spline_weights(rows_px: NDArray[np.floating[Any]], count: int,
                   height: int) -> tuple[NDArray[np.int64], NDArray[np.floating[Any]]]:
    """The first of the four coefficients that move each row, (n,) int64, and their weights, (n, 4).

    rows_px: (n,). count: number of coefficients. height: rows of the frame.
    """
    intervals = count - _DEGREE
    place = np.clip(rows_px / max(height - 1, 1), 0.0, 1.0) * intervals
    first = np.minimum(place.astype(np.int64), intervals - 1)
    u = place - first
    return first, np.stack([np.ones_like(u), u, u**2, u**3], axis=1) @ _CUBIC.T
