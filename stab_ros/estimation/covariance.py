"""From a fitted homography to a `Fit`: inliers, residuals and covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.clusters import ACROSS, cells_of, excess
from stab_ros.estimation.models import PARAMETERS
from stab_ros.estimation.problem import LEAST_SQUARES, EstimationProblem, LossFunction, strongest

# The last polish gives weight up to five standard deviations of a feature instead of three: 4 to 9 % smaller errors.
_WIDER = 5 / 3
_LEAST_RESPONSE = 0.2  # the estimate is poor below
_NOTHING = 1e-12
_NEAR_PX, _STEPS = 3.0, 2


def fit_with_loss(problem: EstimationProblem, loss_function: LossFunction, H: Homography) -> Fit | None:
    """Final fit with a loss function, starting from H; the excess scatter of the scene is added to each covariance.

    Returns None where the correspondences do not determine a homography.
    """
    scatter_px = problem.excess_scatter_px(H)
    limit_px, scattered = problem.inlier_threshold_px(loss_function, scatter_px), problem.noise_inflated(scatter_px)
    wide = scattered.wider(_WIDER) if loss_function.falls else scattered
    polished = wide.polish(loss_function, H, limit_px)
    if polished is None:
        return None
    inlier, weight = scattered.squared_ratios(polished, limit_px) < 1, wide.weights(loss_function, polished, limit_px)
    fit = make_fit(wide, polished, weight, inlier,
                   sandwich=_sandwich(wide, loss_function, polished, weight, wide.noise + limit_px**2))
    return _with_disagreement(fit, scattered, loss_function) if fit is not None and loss_function.robust else fit


def _with_disagreement(fit: Fit, problem: EstimationProblem, loss_function: LossFunction) -> Fit:
    """The fit with a covariance that covers the plane that all features near it agree on, whatever their weight was.

    Where the ground is a plane and the rest is water, what is near agrees with it. Where rows swing, where the scene is
    no plane, or a picture is blurred, a robust fit follows one part of it exactly and gives the rest no weight, so its
    residuals are small whichever part it has found.
    """
    limit_px = max(_NEAR_PX, problem.threshold_px)
    other = problem.trusting_neighbours().polish(loss_function, fit.ref_H_cur, limit_px, _STEPS)
    if other is None:
        return fit
    off = (other - fit.ref_H_cur).ravel()[:8]
    return replace(fit, covariance=fit.covariance + np.outer(off, off))


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


@dataclass(frozen=True)
class Sandwich:
    """What weights that depend on the residuals change in the sandwich estimator (Huber 1981, section 6.3).

    Attributes:
        response: E[psi'] / E[w] of the score psi(r) = w(r) r. The weight falls as the residual grows, so the score
            changes less with the homography than the weights say.
        least: variance of the scores if the features are as exact as they claim, as a share of their predicted one,
            which takes weights for constant. Large errors have small weights, so it is below 1.
    """

    response: float = 1.0
    least: float = 1.0


CONSTANT = Sandwich()  # weights


def _sandwich(problem: EstimationProblem, loss_function: LossFunction, H: Homography, weight: FloatArray,
              limit: FloatArray) -> Sandwich:
    """weight: (N,) in the fit. limit: (N,) squared inlier thresholds, px^2."""
    pairs, strength = problem.pairs, strongest(problem.pairs.information)
    response = gn.response(H, pairs.reference_px, pairs.current_px, pairs.information, problem.metric, problem.trust,
                           limit, loss_function.weight, loss_function.beyond)
    claimed = problem.trust**2 * gn.weights_of(1 / (strength * limit), loss_function.claimed, loss_function.claimed[-1])
    predicted = max(float(weight**2 @ strength), _NOTHING)
    return Sandwich(max(_LEAST_RESPONSE, response), float(claimed[weight > 0] @ strength[weight > 0]) / predicted)


def make_fit(problem: EstimationProblem, H: Homography, weight: FloatArray, inlier: BoolArray,
             consensus: int | None = None, sandwich: Sandwich = CONSTANT) -> Fit | None:
    """The `Fit` of a homography; None where the weighted correspondences do not determine it.

    weight: (N,) weight of each correspondence in the fit. inlier: (N,) bool. consensus: see `Fit`.
    """
    covariance = covariance_of(problem, weight, H, sandwich)
    if covariance is None or not inlier.any():
        return None
    distance = np.sum((problem.pairs.reference_px - apply(H, problem.pairs.current_px)) ** 2, axis=1)
    return Fit(H, inlier, covariance, float(np.sqrt(np.mean(distance[inlier]))), consensus)


def covariance_of(problem: EstimationProblem, weight: FloatArray, H: Homography,
                  sandwich: Sandwich = CONSTANT) -> FloatArray | None:
    """Covariance (8, 8) of the entries h00 .. h21: the sandwich estimator N^-1 V N^-1 (Huber 1967).

    V is the variance of the score as predicted by the information matrices, times the ratio of the empirical to the
    predicted variance (`clusters.excess`). None where the weighted correspondences determine no homography.
    """
    pairs, basis = problem.pairs, problem.basis
    normals, scores, predicted = gn.accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,
                                               basis.centre, basis.radius, PARAMETERS[basis.model],
                                               cells_of(pairs.reference_px), ACROSS**2)
    normal = normals.sum(axis=0)
    if not gn.solve(normal, normal[0])[0]:
        return None
    to_entries = basis.entry_jacobian(H) @ np.linalg.inv(normal)
    inflation = max(sandwich.least, excess(normals, scores, predicted)) / sandwich.response**2
    return np.asarray(to_entries @ (predicted * inflation) @ to_entries.T)

