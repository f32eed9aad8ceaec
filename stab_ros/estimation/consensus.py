"""Estimators with a hard inlier selection: select features by a rule, then fit those by least squares."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from stab_ros.core.robust import MAD_TO_SIGMA
from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.covariance import Sandwich, covariance_of, fit_least_squares
from stab_ros.estimation.models import minimal_points
from stab_ros.estimation.problem import LEAST_SQUARES, RANSAC, EstimationProblem
from stab_ros.estimation.samples import best_sample, samples_needed

_MAX_OUTLIER_SHARE = 0.5  # breakdown point of LMedS
_LMEDS_SIGMAS = 2.5
_REWEIGHTINGS = 2  # before the final fit
_PAUTA_SIGMAS = 3.0
_MIN_DEVIATION_PX = 1e-6
_MAX_EXPONENT = 100.0  # of exp, against overflow
_RAYLEIGH_MEDIAN = math.sqrt(2 * math.log(2))  # median distance for a standard deviation of 1 along each axis


def ransac(problem: EstimationProblem, _guess: Homography) -> Fit | None:
    """RANSAC (Fischler and Bolles 1981): least squares over the largest consensus set."""
    return _consensus_fit(problem, problem.threshold_px)


def ed_ransac(problem: EstimationProblem, _guess: Homography) -> Fit | None:
    """ED-RANSAC (Zhang et al. 2023, section 2.2): a RANSAC consensus set, filtered by a second threshold.

    Eq. 6: ED = sqrt((x_r - x_s)^2 + (y_r - y_s)^2), the Euclidean distance of a pair after the transformation (eq. 5),
    independent of the features' uncertainty. `Fit.consensus` is FS of the paper, the number of inliers is FP.
    """
    problem = problem.euclidean()
    first = _consensus_fit(problem, problem.ransac_threshold_px)
    if first is None:
        return None
    retained = first.inlier & (problem.squared_ratios(first.ref_H_cur, problem.threshold_px) < 1)
    fit = fit_least_squares(problem, retained, first.ref_H_cur, first.consensus)
    return None if fit is None else _with_selection_variance(problem, first, fit)


def lmeds(problem: EstimationProblem, _guess: Homography) -> Fit | None:
    """Least median of squares (Rousseeuw 1984), then least squares over residuals within 2.5 standard deviations.

    Robust standard deviation and limit: Rousseeuw and Leroy (1987), chapter 5, eq. 1.3. `threshold` is not used.
    """
    def score(candidates: FloatArray) -> tuple[Homography | None, float]:
        medians = [_median_squared_residual_px2(problem, H) for H in candidates]
        best = int(np.argmin(medians)) if medians else -1
        return (None, math.inf) if best < 0 else (candidates[best], medians[best])

    H = best_sample(problem, score, lambda _: samples_needed(problem, _MAX_OUTLIER_SHARE))
    for _ in range(_REWEIGHTINGS):  # a minimal sample extrapolates badly, so the first median is too large
        if H is not None:
            inliers = problem.restricted_to(_lmeds_inliers(problem, H))
            H = inliers.polish(LEAST_SQUARES, H, problem.threshold_px)
    return None if H is None else fit_least_squares(problem, _lmeds_inliers(problem, H), H)


def three_sigma(problem: EstimationProblem, guess: Homography) -> Fit | None:
    """Least squares, repeated without residuals above three standard deviations until none is left (Pauta)."""
    chosen, H = problem.trust > 0, problem.polish(LEAST_SQUARES, guess, problem.threshold_px)
    while H is not None:
        near = chosen & (_residuals_px(problem, H) <= _PAUTA_SIGMAS * _deviation_px(problem, chosen, H))
        if near.sum() == chosen.sum():
            return fit_least_squares(problem, chosen, H)
        chosen, H = near, problem.restricted_to(near).polish(LEAST_SQUARES, H, problem.threshold_px)
    return None


def _consensus_fit(problem: EstimationProblem, threshold_px: float) -> Fit | None:
    """Least squares over the largest consensus set of any minimal sample."""
    trust = max(float(problem.trust.sum()), 1e-9)

    def score(candidates: FloatArray) -> tuple[Homography | None, float]:
        best, loss = problem.least_loss(RANSAC, candidates, threshold_px, octaves=1)
        return (None, math.inf) if best < 0 else (candidates[best], loss)

    H = best_sample(problem, score, lambda loss: samples_needed(problem, loss / trust))
    if H is None:
        return None
    consensus = problem.squared_ratios(H, threshold_px) < 1
    return fit_least_squares(problem, consensus, H, int(consensus.sum()))


def _lmeds_inliers(problem: EstimationProblem, H: Homography) -> BoolArray:
    """(N,) bool: residuals within 2.5 robust standard deviations."""
    spare = max(1, len(problem.pairs) - minimal_points(problem.basis.model))
    deviation_px = MAD_TO_SIGMA * (1 + 5 / spare) * math.sqrt(_median_squared_residual_px2(problem, H))
    return np.asarray(problem.squared_ratios(H, _LMEDS_SIGMAS * deviation_px) < 1)


def _median_squared_residual_px2(problem: EstimationProblem, H: Homography) -> float:
    """Weighted median of the squared residuals, with the prior weights, px^2."""
    squared = _residuals_px(problem, H) ** 2
    order = np.argsort(squared, kind="stable")
    trust = np.cumsum(problem.trust[order])
    return float(squared[order][np.searchsorted(trust, trust[-1] / 2)])


def _residuals_px(problem: EstimationProblem, H: Homography) -> FloatArray:
    """Residuals (N,), px; infinite for points behind the camera."""
    pairs = problem.pairs
    return np.asarray(np.sqrt(gn.squared_residuals(H, pairs.reference_px, pairs.current_px, problem.metric)))


def _deviation_px(problem: EstimationProblem, chosen: BoolArray, H: Homography) -> float:
    """Sample standard deviation of the chosen residuals, px."""
    distance = _residuals_px(problem, H)[chosen]
    return max(math.sqrt(float(np.sum(distance**2)) / max(1, len(distance) - 1)), _MIN_DEVIATION_PX)


def _with_selection_variance(problem: EstimationProblem, first: Fit, fit: Fit) -> Fit:
    """The second fit with a covariance that includes the selection by the first one.

    Of errors with standard deviation s along each axis, those inside a disc of radius t around a first estimate with
    error d have the mean k d and the variance (1 - k) s^2, where k = u exp(-u) / (1 - exp(-u)) and u = t^2 / (2 s^2).
    The smaller the disc, the larger the share of the first estimate's error that remains.
    """
    chosen = first.inlier & (problem.trust > 0)
    spread_px = float(np.median(_residuals_px(problem, first.ref_H_cur)[chosen])) / _RAYLEIGH_MEDIAN
    u = problem.threshold_px**2 / (2 * max(spread_px, _MIN_DEVIATION_PX) ** 2)
    kept = u / math.expm1(min(u, _MAX_EXPONENT))
    retained = covariance_of(problem, problem.restricted_to(fit.inlier).trust, fit.ref_H_cur,
                             Sandwich(least=1 - kept))
    if retained is None:
        return fit
    return dataclasses.replace(fit, covariance=kept**2 * first.covariance + retained)
