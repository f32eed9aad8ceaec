"""From a fitted homography to a `Fit`: inliers, residuals and covariance."""

from __future__ import annotations

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.models import PARAMETERS
from stab_ros.estimation.problem import LEAST_SQUARES, EstimationProblem, LossFunction

# Correlation between the errors of any two features. Calibrated on the sequences of docs/uncertainty.md, so that the
# median of error over sigma is near its expectation. Measured directly between patches 40 to 160 px apart, it is 0 to
# 0.01.
_COMMON_CORRELATION = 0.0018
_CELLS = 10  # per axis: cells are larger than a patch, and numerous enough to estimate a variance


def fit_with_loss(problem: EstimationProblem, loss_function: LossFunction, H: Homography) -> Fit | None:
    """Final fit with a loss function, starting from H; the excess scatter of the scene is added to each covariance.

    Returns None where the correspondences do not determine a homography.
    """
    limit_px = problem.inlier_threshold_px(loss_function, H)
    problem = problem.noise_inflated(problem.excess_scatter_px(H))
    polished = problem.polish(loss_function, H, limit_px)
    if polished is None:
        return None
    ratios = problem.squared_ratios(polished, limit_px)
    weight = gn.weights_of(ratios, loss_function.weight, loss_function.beyond) * problem.trust
    return make_fit(problem, polished, weight, ratios < 1)


def fit_least_squares(problem: EstimationProblem, chosen: BoolArray, H: Homography,
                      consensus: int | None = None) -> Fit | None:
    """Least squares fit to the chosen correspondences, (N,) bool, starting from H; None where they determine none.

    consensus: see `Fit`.
    """
    problem = problem.restricted_to(chosen)
    plain = problem.polish(LEAST_SQUARES, H, problem.threshold_px)
    if plain is None:
        return None
    problem = problem.noise_inflated(problem.excess_scatter_px(plain, np.inf))
    polished = problem.polish(LEAST_SQUARES, plain, problem.threshold_px)
    return None if polished is None else make_fit(problem, polished, problem.trust, chosen, consensus)


def make_fit(problem: EstimationProblem, H: Homography, weight: FloatArray, inlier: BoolArray,
           consensus: int | None = None) -> Fit | None:
    """The `Fit` of a homography; None where the weighted correspondences do not determine it.

    weight: (N,) weight of each correspondence in the fit. inlier: (N,) bool. consensus: see `Fit`.
    """
    covariance = covariance_of(problem, weight, H)
    if covariance is None or not inlier.any():
        return None
    distance = np.sum((problem.pairs.reference_px - apply(H, problem.pairs.current_px)) ** 2, axis=1)
    return Fit(H, inlier, covariance, float(np.sqrt(np.mean(distance[inlier]))), consensus)


def covariance_of(problem: EstimationProblem, weight: FloatArray, H: Homography,
                  least: float = 1.0) -> FloatArray | None:
    """Covariance (8, 8) of the entries h00 .. h21: the sandwich estimator N^-1 V N^-1 (Huber 1967).

    V is the variance of the score as predicted by the information matrices, times two factors: the ratio of the
    empirical to the predicted variance (at least `least`), and the inflation by correlation between features. None
    where the weighted correspondences determine no homography.
    """
    pairs, basis = problem.pairs, problem.basis
    scores = np.zeros((len(pairs), PARAMETERS[basis.model]))
    normal, right, predicted = gn.accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,
                                           basis.centre, basis.radius, PARAMETERS[basis.model], scores)
    if not gn.solve(normal, right)[0]:
        return None
    inverse, empirical = np.linalg.inv(normal), _empirical_variance(scores, weight, pairs.reference_px)
    excess = max(least, float(np.trace(inverse @ empirical)) / float(np.trace(inverse @ predicted)))
    to_entries = basis.entry_jacobian(H) @ inverse
    return np.asarray(to_entries @ (predicted * excess * _correlation_inflation(weight)) @ to_entries.T)


def _empirical_variance(scores: FloatArray, weight: FloatArray, places_px: FloatArray) -> FloatArray:
    """Cluster-robust variance (k, k) of the sum of the scores (N, k) (Liang and Zeger 1986).

    The clusters are cells of the image, because errors of neighbours, such as overlapping patches, are correlated.
    """
    low, high = places_px.min(axis=0), places_px.max(axis=0)
    cell = ((places_px - low) / np.maximum(high - low, 1e-9) * _CELLS).astype(int).clip(0, _CELLS - 1)
    index = cell[:, 1] * _CELLS + cell[:, 0]
    sums = np.stack([np.bincount(index, column, _CELLS * _CELLS) for column in scores.T], axis=1)
    cells, k = np.count_nonzero(np.bincount(index[weight > 0])), scores.shape[1]
    return np.asarray(sums.T @ sums * (cells / (cells - k) if cells > 2 * k else 1.0))


def _correlation_inflation(weight: FloatArray) -> float:
    """Factor by which correlation between all features increases the variance of their mean.

    Interpolation and aliasing bias all features slightly in a common direction. The fit follows this bias, so the
    residuals do not show it. With a correlation rho between any two of n features, the factor is 1 + (n - 1) rho.
    """
    total = float(weight.sum())
    count = total**2 / max(float((weight**2).sum()), 1e-12)  # effective sample size (Kish 1965)
    return 1.0 + max(count - 1.0, 0.0) * _COMMON_CORRELATION
