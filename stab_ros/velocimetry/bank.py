"""Whether the bank stands still: the velocity of static ground, which must be 0 within its error bar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.vectors import Vectors

_LEAST = 8  # vectors
_SURE = float(chi2.ppf(0.95, 2))
_MEDIAN = np.pi / 2  # variance of the median of normal errors, times that of their mean


@dataclass(frozen=True, eq=False)
class BankVelocity:
    """The velocity of the bank.

    Attributes:
        count: number of vectors.
        velocity_m_s: (2,), median of each component.
        covariance: (2, 2) of it: of the median of the vectors' own errors, and of what they share.
        speed_m_s: median of the speeds of the single vectors, noise included.
    """

    count: int
    velocity_m_s: FloatArray
    covariance: FloatArray
    speed_m_s: float

    @property
    def sigma_m_s(self) -> float:
        """Standard deviation of the velocity, root of the trace."""
        return float(np.sqrt(np.trace(self.covariance)))

    @property
    def is_zero(self) -> bool:
        """Whether 0 lies within the 95 % error ellipse."""
        return bool(self.velocity_m_s @ np.linalg.pinv(self.covariance) @ self.velocity_m_s <= _SURE)


def bank_velocity(vectors: Vectors) -> BankVelocity | None:
    """The velocity of vectors on the bank; None: they are too few to tell.

    Each component's own error is that of a median of independent vectors, but no less than their scatter tells. What is
    shared is averaged with its sign; the errors of the frames between which an interval was measured are new in each.
    """
    if len(vectors) < _LEAST:
        return None
    v = vectors.velocity_m_s
    median = np.median(v, axis=0)
    scatter = np.diag((1.4826 * np.median(np.abs(v - median), axis=0)) ** 2)
    own = vectors.covariance.mean(axis=0)
    own = own if np.trace(own) > np.trace(scatter) else scatter
    covariance = _MEDIAN * own / len(vectors) + _shared(vectors)
    return BankVelocity(len(vectors), median, covariance, float(np.median(np.hypot(*v.T))))


def _shared(vectors: Vectors) -> FloatArray:
    """(2, 2), of the means of the intervals; an error is taken for another one in each interval."""
    starts, which = np.unique(vectors.start_ns, return_inverse=True)
    means = [vectors.shared[which == k].mean(axis=0) * np.mean(which == k) for k in range(len(starts))]
    return np.asarray(sum((mean @ mean.T for mean in means), np.zeros((2, 2))))
