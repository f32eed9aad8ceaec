"""Square roots of covariances."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray


def factor(covariance: FloatArray) -> FloatArray:
    """F (n, n) with F F^T = covariance (n, n): scales times the symmetric root of the correlations.

    It is unique and changes steadily with the covariance, so that its columns mean the same from frame to frame. What
    is not positive semidefinite by rounding is taken for 0.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 0))
    unit = np.where(scale > 0, scale, 1)
    return np.asarray(scale[:, None] * roots(covariance / np.outer(unit, unit)))


def roots(covariance: FloatArray) -> FloatArray:
    """Symmetric roots of covariances (..., n, n); what is not positive semidefinite by rounding counts as 0."""
    values, vectors = np.linalg.eigh(covariance)
    scaled = vectors * np.sqrt(np.maximum(values, 0))[..., None, :]
    return np.asarray(scaled @ np.swapaxes(vectors, -1, -2))
