"""Uncertainty from how verticals differ from what their neighbours tell: the interpolated variance estimator (IVE).

Cohn, Kiang and Mason 2013, Estimating discharge measurement uncertainty using the interpolated variance estimator,
Journal of Hydraulic Engineering 139(5). Here each filled velocity is left out, as it is no observation, and the sum of
squares is divided by the number of its terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray

_EDGE = 2  # verticals at each end that the estimator leaves out, where profiles are curved
_FEWEST = 3  # terms that tell a standard deviation


@dataclass(frozen=True)
class Roughness:
    """Standard deviations of single verticals; NaN: too few to tell.

    Attributes:
        depth_m: of the depth.
        velocity_m_s: of the velocity.
    """

    depth_m: float
    velocity_m_s: float


def roughness(chainage_m: FloatArray, depth_m: FloatArray, velocity_m_s: FloatArray, known: BoolArray) -> Roughness:
    """Equations 12 to 15 of Cohn et al. 2013.

    Args:
        chainage_m: (N,), of the wet verticals.
        depth_m: (N,).
        velocity_m_s: (N,).
        known: (N,), which velocities are measured.
    """
    return Roughness(_sigma(chainage_m, depth_m, np.ones(len(known), np.bool_)),
                     _sigma(chainage_m[known], velocity_m_s[known], known[known]))


def _sigma(chainage_m: FloatArray, values: FloatArray, use: BoolArray) -> float:
    """Standard deviation of a value against the line between its neighbours."""
    if len(values) < 2 * _EDGE + _FEWEST:
        return float("nan")
    inner = slice(_EDGE, len(values) - _EDGE)
    before, here, after = (np.roll(chainage_m, shift)[inner] for shift in (1, 0, -1))
    share = (after - here) / np.maximum(after - before, 1e-12)
    expected = share * np.roll(values, 1)[inner] + (1 - share) * np.roll(values, -1)[inner]
    square = (values[inner] - expected) ** 2 / (2 * (1 - share + share**2))
    return float(np.sqrt(square.mean()))


def relative_sigma(rough: Roughness, depth_m: FloatArray, velocity_m_s: FloatArray, part_m3_s: FloatArray,
                   width: float, systematic: float) -> float:
    """Standard deviation of the discharge over the discharge, equation 17 of Cohn et al. 2013; NaN: cannot be told.

    Args:
        rough: of single verticals.
        depth_m: (N,), of the wet verticals.
        velocity_m_s: (N,), depth-averaged.
        part_m3_s: (N,), partial discharges.
        width: relative standard deviation of the width of a vertical.
        systematic: relative standard deviation by what all verticals share.
    """
    moving = (np.abs(velocity_m_s) > 0) & (depth_m > 0)
    q, v, h = part_m3_s[moving], velocity_m_s[moving], depth_m[moving]
    single = (rough.depth_m / h) ** 2 + (rough.velocity_m_s / v) ** 2 + width**2
    return float(np.sqrt(systematic**2 + (q**2 * single).sum() / q.sum() ** 2)) if q.sum() else float("nan")
