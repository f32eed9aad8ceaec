"""The normalised median test of Westerweel and Scarano (2005), for scattered vectors (Duncan et al. 2010)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.types import BoolArray, FloatArray

NEIGHBOURS = 8
_FEWEST = 4


def fits_neighbours(position_m: FloatArray, velocity: FloatArray, noise: FloatArray, limit: float,
                    eps: float) -> BoolArray:
    """Which vectors lie within a limit of the median of their neighbours.

    The residual of a vector is its distance from the median of its eight nearest neighbours, divided by the median
    distance of these from it plus `eps`; noise that the vectors are known to have is part of `eps`.

    Args:
        position_m: (N, 2).
        velocity: (N, 2).
        noise: (N,), standard deviation of each vector by itself.
        limit: largest residual.
        eps: scatter that is always allowed, in the unit of velocity.

    Returns:
        (N,) bool; all true with fewer than five vectors, which tell nothing.
    """
    n = len(position_m)
    if n <= _FEWEST:
        return np.ones(n, bool)
    count = min(NEIGHBOURS, n - 1)
    others = np.asarray(cKDTree(position_m).query(position_m, k=count + 1)[1])[:, 1:]
    median = np.median(velocity[others], axis=1)
    scatter = np.median(np.linalg.norm(velocity[others] - median[:, None], axis=2), axis=1)
    allowed = scatter + eps + noise
    return np.asarray(np.linalg.norm(velocity - median, axis=1) <= limit * allowed)
