"""How alike an area is where it was found, and how well that fixes its place."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray

_QUANTISATION = 1.0 / 12  # variance of rounding to whole grey levels
_LEAST_CORRELATION = 0.05


def structure(area: FloatArray) -> FloatArray:
    """(N, 2, 2): sum of the outer products of the gradient over each of the areas (N, s, s), grey levels^2 per px^2.

    A constant and the area itself are projected out: what brightness and contrast can explain tells no displacement.
    """
    centred = _centred(area)
    power = np.maximum(np.einsum("nij,nij->n", centred, centred), 1e-9)
    gradient = np.stack([_centred(np.gradient(centred, axis=axis)) for axis in (2, 1)])
    along = np.einsum("dnij,nij->dn", gradient, centred) / power
    gradient -= along[:, :, None, None] * centred
    return np.asarray(np.einsum("anij,bnij->nab", gradient, gradient))


def correlation(template: FloatArray, found: FloatArray) -> FloatArray:
    """(N,) Pearson's correlation coefficient of areas (N, s, s); 0 where one of them is flat."""
    a, b = _centred(template), _centred(found)
    power = np.einsum("nij,nij->n", a, a) * np.einsum("nij,nij->n", b, b)
    both = np.einsum("nij,nij->n", a, b)
    return np.asarray(np.divide(both, np.sqrt(power), out=np.zeros(len(a)), where=power > 0))


def information(template: FloatArray, alike: FloatArray, structure: FloatArray, excess: float,
                floor_px: FloatArray) -> FloatArray:
    """(N, 2, 2) 1/px^2: inverse covariance of the places of areas that correlate by `alike` (N,) with their template.

    The Cramer-Rao bound, noise over structure tensor, with the noise as it shows in what the template does not explain;
    `excess` times its variance, as measured against truth, and `floor_px` (N,) for what the sub-pixel peak adds.
    """
    count = template.shape[1] * template.shape[2]
    rho2 = np.maximum(alike, _LEAST_CORRELATION) ** 2
    variance = template.var(axis=(1, 2)) * count / (count - 2) * (1 - rho2) / rho2 + _QUANTISATION / rho2
    trace = np.trace(structure, axis1=1, axis2=2)
    firm = structure + (1e-6 * trace + 1e-9)[:, None, None] * np.eye(2)
    covariance = excess * variance[:, None, None] * np.linalg.inv(firm) + floor_px[:, None, None] ** 2 * np.eye(2)
    return np.linalg.inv(covariance)


def _centred(area: FloatArray) -> FloatArray:
    return np.asarray(area - area.mean(axis=(1, 2), keepdims=True), np.float64)
