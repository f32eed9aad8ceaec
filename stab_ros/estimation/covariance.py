"""From a fitted homography to a `Fit`: who agreed, how far off they are, and how uncertain it is."""

from __future__ import annotations

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.models import PARAMETERS
from stab_ros.estimation.problem import LEAST_SQUARES, Kernel, Problem

# Between the errors of any two features. Measured: over the sequences of docs/uncertainty.md it brings the median of
# error over sigma near its expectation; between patches 40 to 160 px apart it was found to be 0 to 0.01 directly.
_COMMON_CORRELATION = 0.0018
_CELLS = 10  # across and down: larger than a patch, and enough of them to tell a variance


def measured(problem: Problem, kernel: Kernel, H: Homography) -> Fit | None:
    """The end of the kernels' estimators: H polished, each feature weighing also with the relief of the scene."""
    reach_px = problem.reach_px(kernel, H)
    problem = problem.softened(problem.relief_px(H))
    polished = problem.polish(kernel, H, reach_px)
    if polished is None:
        return None
    relative = problem.relative(polished, reach_px)
    weight = gn.weigh(relative, kernel.weight, kernel.beyond) * problem.trust
    return report(problem, polished, weight, relative < 1)


def fitted(problem: Problem, chosen: BoolArray, H: Homography, consensus: int | None = None) -> Fit | None:
    """Least squares over the chosen features, starting from H."""
    problem = problem.only(chosen)
    plain = problem.polish(LEAST_SQUARES, H, problem.threshold_px)
    if plain is None:
        return None
    problem = problem.softened(problem.relief_px(plain, np.inf))
    polished = problem.polish(LEAST_SQUARES, plain, problem.threshold_px)
    return None if polished is None else report(problem, polished, problem.trust, chosen, consensus)


def report(problem: Problem, H: Homography, weight: FloatArray, inlier: BoolArray,
           consensus: int | None = None) -> Fit | None:
    """The fit that a homography is; None where the features that count do not determine it."""
    covariance = covariance_of(problem, weight, H)
    if covariance is None or not inlier.any():
        return None
    distance = np.sum((problem.pairs.reference_px - apply(H, problem.pairs.current_px)) ** 2, axis=1)
    return Fit(H, inlier, covariance, float(np.sqrt(np.mean(distance[inlier]))), consensus)


def covariance_of(problem: Problem, weight: FloatArray, H: Homography, least: float = 1.0) -> FloatArray | None:
    """Of the entries of H (8, 8): the sandwich N^-1 V N^-1 of a weighted fit (Huber 1967).

    V is the variance of the score that the information claims, times what the residuals show of it, but at least
    `least`, and times what all features share. None where the features that count determine nothing.
    """
    pairs, basis = problem.pairs, problem.basis
    scores = np.zeros((len(pairs), PARAMETERS[basis.model]))
    normal, right, claimed = gn.accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,
                                           basis.centre, basis.radius, PARAMETERS[basis.model], scores)
    if not gn.solve(normal, right)[0]:
        return None
    inverse, shown = np.linalg.inv(normal), _shown(scores, weight, pairs.reference_px)
    excess = max(least, float(np.trace(inverse @ shown)) / float(np.trace(inverse @ claimed)))
    to_entries = basis.entry_jacobian(H) @ inverse
    return np.asarray(to_entries @ (claimed * excess * _shared(weight)) @ to_entries.T)


def _shown(scores: FloatArray, weight: FloatArray, places_px: FloatArray) -> FloatArray:
    """(k, k) variance of the sum of the scores (N, k), by their sums over cells of the picture.

    Neighbours may err alike, as patches that overlap do, but not across the picture (cluster-robust, Liang and Zeger
    1986).
    """
    low, high = places_px.min(axis=0), places_px.max(axis=0)
    cell = ((places_px - low) / np.maximum(high - low, 1e-9) * _CELLS).astype(int).clip(0, _CELLS - 1)
    index = cell[:, 1] * _CELLS + cell[:, 0]
    sums = np.stack([np.bincount(index, column, _CELLS * _CELLS) for column in scores.T], axis=1)
    cells, k = np.count_nonzero(np.bincount(index[weight > 0])), scores.shape[1]
    return np.asarray(sums.T @ sums * (cells / (cells - k) if cells > 2 * k else 1.0))


def _shared(weight: FloatArray) -> float:
    """By how much the variance of a mean is larger than if the errors of its features were independent.

    Interpolation and aliasing bend all features a little to the same side, which no residual shows: the fit follows.
    With a correlation of rho between any two of n features the variance grows by 1 + (n - 1) rho.
    """
    total = float(weight.sum())
    count = total**2 / max(float((weight**2).sum()), 1e-12)  # as many of equal weight (Kish 1965)
    return 1.0 + max(count - 1.0, 0.0) * _COMMON_CORRELATION
