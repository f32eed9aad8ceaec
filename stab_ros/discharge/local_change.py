"""How the velocity changes around a place, from vectors that lie there at random.

Where velocity changes across the river, the median of vectors that lie to one side of a vertical is not the velocity
at the vertical: at the outermost ones all vectors lie on the side of the river. So the median is taken of what each
vector says of the vertical, by gradient and curvature around it (local quadratic regression: Cleveland 1979; Fan and
Gijbels 1996), which has no such bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.robust import MAD_TO_SIGMA
from stab_ros.core.types import FloatArray

_ROUNDS = 4  # of robust weights
_ROBUST = 4.0  # standard deviations off the surface from which a vector no longer counts; 6 medians, as Cleveland's
_LEAST_M_S = 1e-6  # noise: rounding


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a velocity from a place to those beside it: gradient and curvature along the section and across it.

    Attributes:
        coefficients: (4,), 1/s, 1/s, 1/(m s), 1/(m s).
        covariance: (4, 4) of these.
    """

    coefficients: FloatArray
    covariance: FloatArray

    @staticmethod
    def none() -> Change:
        """That of a velocity which is the same everywhere."""
        return Change(np.zeros(4), np.zeros((4, 4)))

    def at(self, offset_m: FloatArray) -> FloatArray:
        """(N,) change to places (N, 2) so far along the section and across it, m/s."""
        return np.asarray(_terms(offset_m) @ self.coefficients)

    def sigma_m_s(self, offset_m: FloatArray) -> float:
        """Standard deviation of the mean change to places (N, 2), m/s."""
        mean = _terms(offset_m).mean(axis=0)
        return float(np.sqrt(mean @ self.covariance @ mean))


def local_change(offset_m: FloatArray, velocity_m_s: FloatArray, reach_m: float, usual: FloatArray) -> Change:
    """That of the surface through the velocities around a place, nearer ones weighing more.

    Args:
        offset_m: (N, 2), of vectors from the place, along the section and across it.
        velocity_m_s: (N,), one component.
        reach_m: distance at which a vector no longer counts.
        usual: (4,), standard deviations of the coefficients before anything is seen; with few vectors they rule.
    """
    near = np.maximum(1 - np.sum(offset_m**2, axis=1) / reach_m**2, 0)
    scale = np.array([1, reach_m, reach_m, reach_m**2, reach_m**2])
    design = np.column_stack([np.ones(len(offset_m)), _terms(offset_m)]) / scale
    prior = np.diag([0.0, *1 / np.maximum(usual * scale[1:], 1e-9) ** 2])
    off, free = velocity_m_s - np.median(velocity_m_s), float(len(velocity_m_s))
    for _ in range(_ROUNDS):
        noise = max(MAD_TO_SIGMA * float(np.median(np.abs(off))) * math.sqrt(len(off) / free), _LEAST_M_S)
        weight = near * np.maximum(1 - (off / (_ROBUST * noise)) ** 2, 0) ** 2
        information = (design.T * weight) @ design / noise**2
        inverse = np.linalg.pinv(information + prior, hermitian=True)
        free = max(len(off) - float(np.trace(inverse @ information)), 1.0)  # what the surface itself takes is not noise
        surface = inverse @ (design.T @ (weight * velocity_m_s)) / noise**2
        off = velocity_m_s - design @ surface
    return Change((surface / scale)[1:], (inverse / np.outer(scale, scale))[1:, 1:])


def _terms(offset_m: FloatArray) -> FloatArray:
    """(N, 4), what the coefficients are multiplied by at places (N, 2)."""
    return np.column_stack([offset_m, offset_m**2 / 2])
