"""Vectors on a grid: median, count and standard error of each cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.robust import robust_sigma
from stab_ros.core.types import FloatArray, IdArray
from stab_ros.velocimetry.vectors import Vectors

_MEDIAN_COST = np.pi / 2  # variance of the median per variance of the mean, of normal errors and many vectors


@dataclass(frozen=True, eq=False)
class VelocityGrid:
    """Velocities of the n cells that hold vectors.

    Attributes:
        side_m: of a cell; cells begin at whole multiples of it.
        cell: (n, 2) int64, column and row: a cell covers `side_m` times [cell, cell + 1).
        median_m_s: (n, 2), of the components.
        count: (n,) number of vectors.
        own_sigma_m_s: (n, 2), standard error of the median by what each vector has by itself: by the larger of their
            scatter and of their covariance.
        shared: (n, 2, K), changes of the median by one standard deviation of each common error, as of `Vectors`.
    """

    side_m: float
    cell: IdArray
    median_m_s: FloatArray
    count: IdArray
    own_sigma_m_s: FloatArray
    shared: FloatArray

    @property
    def centre_m(self) -> FloatArray:
        """(n, 2), centres of the cells."""
        return np.asarray((self.cell + 0.5) * self.side_m)

    @property
    def shared_sigma_m_s(self) -> FloatArray:
        """(n, 2), standard error of the median by all common errors."""
        return np.asarray(np.sqrt(np.sum(self.shared**2, axis=2)))

    @property
    def sigma_m_s(self) -> FloatArray:
        """(n, 2), standard error of the median by all errors."""
        return np.asarray(np.hypot(self.own_sigma_m_s, self.shared_sigma_m_s))


def on_grid(vectors: Vectors, side_m: float, least: int = 1) -> VelocityGrid:
    """Sorts vectors into cells by the place midway between start and end.

    Args:
        vectors: of any number of intervals whose columns of `shared` mean the same errors.
        side_m: of a cell.
        least: smallest number of vectors of a cell.

    Returns:
        The cells with at least so many vectors, by row and column.
    """
    cells = np.floor(vectors.position_m / side_m).astype(np.int64)
    order = np.lexsort(cells.T)
    sorted_cells = cells[order]
    begins = np.flatnonzero(np.r_[True, (np.diff(sorted_cells, axis=0) != 0).any(axis=1)]) if len(order) else order
    groups = [group for group in np.split(order, begins[1:]) if len(group) >= least]
    members = [_summary(vectors[group]) for group in groups]
    columns = vectors.shared.shape[2]
    return VelocityGrid(
        side_m, np.array([cells[group[0]] for group in groups], np.int64).reshape(-1, 2),
        np.array([one[0] for one in members]).reshape(-1, 2), np.array([len(group) for group in groups], np.int64),
        np.array([one[1] for one in members]).reshape(-1, 2),
        np.array([one[2] for one in members]).reshape(len(groups), 2, columns))


def _summary(vectors: Vectors) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Median (2,), own standard error of it (2,), and its changes by common errors (2, K)."""
    velocity = vectors.velocity_m_s
    median = np.median(velocity, axis=0)
    scatter = robust_sigma(velocity) ** 2
    told = vectors.covariance[:, [0, 1], [0, 1]].mean(axis=0)
    cost = _MEDIAN_COST if len(vectors) > 2 else 1.0  # the median of two is their mean
    own = np.sqrt(np.maximum(scatter, told) * cost / len(vectors))
    return median, own, vectors.shared.mean(axis=0)
