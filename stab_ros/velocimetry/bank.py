"""The velocity of what does not move: measured on the bank, it must be zero within its error bar.

It tests the stabilisation and the error bars at once: an error of a homography moves the bank as it moves the water.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.robust import robust_sigma
from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.vectors import Vectors

_CHI2_99 = 9.21  # of two degrees of freedom
_MEDIAN_COST = np.pi / 2  # variance of the median per variance of the mean


@dataclass(frozen=True, eq=False)
class BankVelocity:
    """What was measured on the bank.

    Attributes:
        count: number of vectors on it.
        median_m_s: (2,), of their components; NaN without any.
        covariance: (2, 2) of that median, by all errors, (m/s)^2; NaN without any.
    """

    count: int
    median_m_s: FloatArray
    covariance: FloatArray

    @property
    def sigma_m_s(self) -> FloatArray:
        """(2,), standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def at_rest(self) -> bool | None:
        """Whether zero lies in the region that holds 99 of 100 measurements of a bank; None: nothing was measured."""
        if not self.count:
            return None
        return bool(self.median_m_s @ np.linalg.pinv(self.covariance, hermitian=True) @ self.median_m_s <= _CHI2_99)


def bank_velocity(vectors: Vectors, bank: PlaneMask | None) -> BankVelocity:
    """The velocity of what lies on the bank.

    Args:
        vectors: of one interval, measured on water and bank alike.
        bank: static ground on the plane of the vectors, as a static map or polygons; None: all lies on it.

    Returns:
        The median of the vectors that begin and end on it, with covariance.
    """
    still = vectors if bank is None else vectors[bank.holds(vectors.start_m) & bank.holds(vectors.end_m)]
    n = len(still)
    if not n:
        return BankVelocity(0, np.full(2, np.nan), np.full((2, 2), np.nan))
    velocity = still.velocity_m_s
    median = np.median(velocity, axis=0)
    scatter = robust_sigma(velocity) ** 2
    told = still.covariance.mean(axis=0)
    excess = np.maximum(scatter - np.diag(told), 0)
    own = (told + np.diag(excess)) * (_MEDIAN_COST if n > 2 else 1.0) / n
    common = still.shared.mean(axis=0)
    return BankVelocity(n, median, own + common @ common.T)
