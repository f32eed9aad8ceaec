"""Velocities on a grid of square cells: median, number of vectors and standard error of each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.velocimetry.vectors import Unit, Vectors

_CELLS = 30  # along the longer side of what the first vectors cover
_ROUND = (1.0, 2.0, 5.0, 10.0)
_MEDIAN = np.pi / 2  # variance of the median of normal errors, times that of their mean
_TO_SIGMA = 1.4826  # from a median absolute deviation


@dataclass(frozen=True, eq=False)
class VelocityGrid:
    """The cells that hold vectors.

    Attributes:
        cell_m: side of a cell; cells begin at whole multiples of it.
        centre_m: (C, 2).
        velocity_m_s: (C, 2), median of each component.
        covariance: (C, 2, 2) of it, by the vectors' own errors or by their scatter, whichever is larger.
        shared: (C, 2, K), mean of the vectors' shared errors, which do not average out.
        count: (C,) int64, vectors that lie in the cell.
        unit: of lengths.
    """

    cell_m: float
    centre_m: FloatArray
    velocity_m_s: FloatArray
    covariance: FloatArray
    shared: FloatArray
    count: IdArray
    unit: Unit = "m"

    def __len__(self) -> int:
        return len(self.count)

    @property
    def total_covariance(self) -> FloatArray:
        """(C, 2, 2), by all errors."""
        return np.asarray(self.covariance + self.shared @ self.shared.transpose(0, 2, 1))

    @property
    def standard_error_m_s(self) -> FloatArray:
        """(C,), by all errors, root of the trace."""
        return np.asarray(np.sqrt(np.trace(self.total_covariance, axis1=1, axis2=2)))


def gridded(vectors: Vectors, cell_m: float) -> VelocityGrid:
    """The vectors by cells; each counts where its middle lies."""
    v = vectors.velocity_m_s
    cells, which = np.unique(np.floor(vectors.position_m / cell_m).astype(np.int64), axis=0, return_inverse=True)
    count = np.bincount(which.ravel(), minlength=len(cells)).astype(np.int64)
    ends = np.cumsum(count)
    parts = np.split(np.argsort(which.ravel(), kind="stable"), ends[:-1]) if len(cells) else []
    median = np.array([np.median(v[part], axis=0) for part in parts]).reshape(-1, 2)
    covariance = np.array([_of_median(v[part], vectors.covariance[part]) for part in parts]).reshape(-1, 2, 2)
    shared = np.zeros((len(cells), 2, vectors.shared.shape[2]))
    for number, part in enumerate(parts):
        shared[number] = vectors.shared[part].mean(axis=0)
    return VelocityGrid(cell_m, (cells + 0.5) * cell_m, median, covariance, shared, count, vectors.unit)


def cell_for(vectors: Vectors) -> float:
    """A round side (1, 2 or 5 times a power of ten) of cells for what these vectors cover."""
    extent = float(np.ptp(vectors.position_m, axis=0).max()) if len(vectors) else 0.0
    if not extent > 0:
        return 1.0
    decade = 10 ** math.floor(math.log10(extent / _CELLS))
    return float(decade * min(_ROUND, key=lambda factor: abs(math.log(factor * decade * _CELLS / extent))))


def _of_median(v: FloatArray, own: FloatArray) -> FloatArray:
    """Covariance (2, 2) of the median of n velocities (n, 2) with covariances (n, 2, 2)."""
    by_own = own.mean(axis=0) / len(v)
    if len(v) == 1:
        return np.asarray(by_own)
    scatter = np.diag((_TO_SIGMA * np.median(np.abs(v - np.median(v, axis=0)), axis=0)) ** 2) / len(v)
    larger = by_own if np.trace(by_own) >= np.trace(scatter) else scatter
    return np.asarray((_MEDIAN if len(v) > 2 else 1.0) * larger)
