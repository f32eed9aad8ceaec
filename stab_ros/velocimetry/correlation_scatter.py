"""The covariance of a displacement by ensemble correlation, from how much the parts of its window disagree.

The slope of the correlation at its peak is 0 for the window as a whole, but not for each of its parts: noise, texture
that changes and shear pull them to different sides. Their scatter is the covariance of the slope, and that of the peak
follows by its curvature (Wieneke 2015, "PIV uncertainty quantification from correlation statistics", with blocks for
his sums over neighbours). Parts are summed over all pairs of the interval first, so that an error which lasts, as of a
texture that is drawn out, counts in full; one block's estimate is noisy, so the scale is drawn towards that of windows
with a like peak (Smyth 2004). Texture that changes as it drifts from part to part pulls them alike, which their scatter
does not tell, but that of whole windows side by side does (`variance_factor`).
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from stab_ros.core.types import FloatArray

_PRIOR_DOF = 8.0  # how many degrees of freedom the windows' common scale counts
_TWO_SIGMA = 0.97725  # share of a normal distribution below two standard deviations
_MEDIAN_SQUARE = 0.4549  # of a standard normal variable
_PRIOR_DIFFERENCES = 24  # how many differences the usual factor counts


def slopes(near: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope (..., 2) and curvature (..., 2, 2), negated, of correlations (..., 3, 3) at their middle, by px."""
    x, y = (near[..., 1, 2] - near[..., 1, 0]) / 2, (near[..., 2, 1] - near[..., 0, 1]) / 2
    xx = 2 * near[..., 1, 1] - near[..., 1, 2] - near[..., 1, 0]
    yy = 2 * near[..., 1, 1] - near[..., 2, 1] - near[..., 0, 1]
    xy = (near[..., 0, 2] + near[..., 2, 0] - near[..., 2, 2] - near[..., 0, 0]) / 4
    return np.stack([x, y], axis=-1), np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


def scatter_px2(parts: FloatArray) -> FloatArray:
    """Covariances (N, 2, 2) of the peaks of correlations summed over B parts, (N, B, 3, 3)."""
    slope, curve = slopes(parts)
    count = parts.shape[1]
    total = np.linalg.pinv(curve.sum(axis=1))
    step = np.einsum("nij,nj->ni", total, slope.sum(axis=1))
    pull = slope - np.einsum("nbij,nj->nbi", curve, step)
    spread = np.einsum("nbi,nbj->nij", pull, pull) * (count / (count - 1))
    return np.asarray(total @ spread @ total)


def sharpness_px2(near: FloatArray) -> FloatArray:
    """What the variance of a peak is proportional to, (N,) px^2, of correlations (N, 3, 3).

    The width of the peak by how much of the correlation is lost, (1 / rho^2 - 1).
    """
    top = np.clip(near[:, 1, 1], 1e-3, 0.999)
    bend = np.maximum(np.trace(slopes(near)[1], axis1=1, axis2=2), 1e-3) / (2 * top)
    return np.asarray((1 / top**2 - 1) / bend)


def moderated(covariance: FloatArray, model_px2: FloatArray, dof: float) -> FloatArray:
    """Covariances (N, 2, 2) with the scale of each drawn towards that of all windows.

    Args:
        covariance: (N, 2, 2), as estimated.
        model_px2: (N,), what variances are proportional to.
        dof: degrees of freedom of `covariance`.

    Returns:
        (N, 2, 2), larger by the factor that makes two of its standard deviations hold 95 % in spite of the degrees of
        freedom.
    """
    own = np.trace(covariance, axis1=1, axis2=2) / 2
    usual = model_px2 * (np.median(own / model_px2) if len(own) else 1.0)
    mean = (dof * covariance + _PRIOR_DOF * usual[:, None, None] * np.eye(2)) / (dof + _PRIOR_DOF)
    wider = (stdtrit(dof + _PRIOR_DOF, _TWO_SIGMA) / 2) ** 2
    return np.asarray(mean * wider)


def variance_factor(values: FloatArray, variance: FloatArray, apart: int, usual: float = 1.0) -> float:
    """By how much the differences of windows exceed what their variances explain, or fall short of it.

    The variance of unit weight of an adjustment, by medians, of the second differences in rows and columns, which
    a linear flow leaves at 0. A flow that curves more makes it larger.

    Args:
        values: (rows, columns, 2); NaN where there are none.
        variance: (rows, columns, 2), of each component.
        apart: distance of windows that do not overlap, in rows and columns.
        usual: the factor without differences, towards which that of few is drawn.
    """
    ratios = []
    for v, var in ((values, variance), (values.swapaxes(0, 1), variance.swapaxes(0, 1))):
        count = max(len(v) - 2 * apart, 0)
        before, here, after = (slice(k * apart, k * apart + count) for k in range(3))
        ratios.append(((v[before] - 2 * v[here] + v[after]) ** 2 / (var[before] + 4 * var[here] + var[after])).ravel())
    ratio = np.concatenate(ratios)
    known = ratio[np.isfinite(ratio)]
    told = float(np.median(known)) / _MEDIAN_SQUARE if len(known) else usual
    return (len(known) * told + _PRIOR_DIFFERENCES * usual) / (len(known) + _PRIOR_DIFFERENCES)
