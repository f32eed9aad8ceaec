"""Uncertainty of a template match: structure tensor, correlation and the Cramer-Rao bound on the displacement."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray

_QUANTISATION = 1.0 / 12  # variance of rounding to whole grey levels
_MIN_CORRELATION = 0.05


def structure(area: FloatArray) -> FloatArray:
    """Structure tensors (N, 2, 2) of windows (N, s, s), in grey levels^2 per px^2.

    The gradient is made orthogonal to a constant and to the window itself, because a change of brightness or contrast
    must not count as displacement.
    """
    centred = _centred(area)
    power = np.maximum(np.einsum("nij,nij->n", centred, centred), 1e-9)
    gradient = np.stack([_centred(np.gradient(centred, axis=axis)) for axis in (2, 1)])
    along = np.einsum("dnij,nij->dn", gradient, centred) / power
    gradient -= along[:, :, None, None] * centred
    return np.asarray(np.einsum("anij,bnij->nab", gradient, gradient))


def correlation(template: FloatArray, found: FloatArray) -> FloatArray:
    """Pearson's correlation coefficients (N,) of two sets of windows (N, s, s); 0 where one of them is flat."""
    a, b = _centred(template), _centred(found)
    power = np.einsum("nij,nij->n", a, a) * np.einsum("nij,nij->n", b, b)
    both = np.einsum("nij,nij->n", a, b)
    return np.asarray(np.divide(both, np.sqrt(power), out=np.zeros(len(a)), where=power > 0))


def information(template: FloatArray, correlation: FloatArray, structure: FloatArray, excess: float,
                floor_px: FloatArray) -> FloatArray:
    """Inverse covariance (N, 2, 2), 1/px^2, of the displacement of each matched window: the Cramer-Rao bound.

    The bound is the noise variance times the inverse structure tensor. The noise variance follows from the part of the
    window that the template does not explain.

    Args:
        template: (N, s, s) windows of the reference, grey levels.
        correlation: (N,) correlation coefficient of each window with its match.
        structure: (N, 2, 2) from `structure`.
        excess: factor on the variance, calibrated against ground truth.
        floor_px: (N,) standard deviation that the sub-pixel interpolation of the peak adds, px.
    """
    count = template.shape[1] * template.shape[2]
    rho2 = np.maximum(correlation, _MIN_CORRELATION) ** 2
    variance = template.var(axis=(1, 2)) * count / (count - 2) * (1 - rho2) / rho2 + _QUANTISATION / rho2
    trace = np.trace(structure, axis1=1, axis2=2)
    regularised = structure + (1e-6 * trace + 1e-9)[:, None, None] * np.eye(2)
    covariance = (excess * variance[:, None, None] * np.linalg.inv(regularised)
                  + floor_px[:, None, None] ** 2 * np.eye(2))
    return np.linalg.inv(covariance)


def _centred(area: FloatArray) -> FloatArray:
    return np.asarray(area - area.mean(axis=(1, 2), keepdims=True), np.float64)
