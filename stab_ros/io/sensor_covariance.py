"""The covariance in a message of a sensor: nine numbers, which often say nothing."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray

_ASYMMETRY = 1e-6  # of the largest element: rounding in the sensor


def known_covariance(elements: FloatArray) -> tuple[FloatArray | None, str]:
    """The covariance of a message.

    Args:
        elements: (9,), row by row.

    Returns:
        The (3, 3) matrix, None where it says nothing; then also why, in words.
    """
    C = elements.reshape(3, 3)
    if not np.isfinite(C).all():
        return None, "its covariance is not finite"
    if not C.any():
        return None, "its covariance is unknown (all zero)"
    shape = C / np.abs(C).max()
    if np.abs(shape - shape.T).max() > _ASYMMETRY or np.linalg.eigvalsh(shape).min() < -_ASYMMETRY:
        return None, "its covariance is none, it must be symmetric and not negative"
    return np.asarray(C / 2 + C.T / 2), ""
