"""Standard deviations that a few wrong values do not change."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray

MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation, of a normal distribution


def robust_sigma(values: FloatArray) -> FloatArray:
    """Standard deviation of values (N, ...) over their first axis, by the deviations from their median: (...)."""
    return np.asarray(MAD_TO_SIGMA * np.median(np.abs(values - np.median(values, axis=0)), axis=0))
