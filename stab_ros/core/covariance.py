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
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    root = (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    return np.asarray(scale[:, None] * root)


def roots(covariance: FloatArray) -> FloatArray:
    """Symmetric roots (N, n, n) of covariances (N, n, n); what is not positive semidefinite by rounding counts as 0."""
    values, vectors = np.linalg.eigh(covariance)
    scaled = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    return np.asarray(scaled @ vectors.transpose(0, 2, 1))
