"""The estimators of the papers: choose features by a rule, then fit those by least squares."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.covariance import covariance_of, fitted
from stab_ros.estimation.models import minimal_points
from stab_ros.estimation.problem import LEAST_SQUARES, RANSAC, Problem
from stab_ros.estimation.samples import best_drawn, samples_needed

_HALF = 0.5  # of outliers, the most that LMedS stands
_LMEDS_SIGMAS = 2.5
_REWEIGHTED = 2  # times, before the last fit
_PAUTA_SIGMAS = 3.0
_LEAST_DEVIATION_PX = 1e-6
_FAR = 100.0  # exp of it is as good as infinite
_RAYLEIGH_MEDIAN = math.sqrt(2 * math.log(2))  # of distances whose parts have the standard deviation 1


def ransac(problem: Problem, _guess: Homography) -> Fit | None:
    """The largest consensus of any sample (Fischler and Bolles 1981), then least squares over it."""
    return _consensus_fit(problem, problem.threshold_px)


def ed_ransac(problem: Problem, _guess: Homography) -> Fit | None:
    """Of a RANSAC consensus, what lies within the threshold of its own fit (Zhang et al. 2023, section 2.2).

    Eq. 6: ED = sqrt((x_r - x_s)^2 + (y_r - y_s)^2), the plain distance of a pair after its transformation (eq. 5), with
    no allowance for what a feature claims. `Fit.consensus` is the paper's FS, the number of inliers its FP.
    """
    problem = problem.euclidean()
    first = _consensus_fit(problem, problem.ransac_threshold_px)
    if first is None:
        return None
    retained = first.inlier & (problem.relative(first.ref_H_cur, problem.threshold_px) < 1)
    fit = fitted(problem, retained, first.ref_H_cur, first.consensus)
    return None if fit is None else _with_truncation(problem, first, fit)


def lmeds(problem: Problem, _guess: Homography) -> Fit | None:
    """Least median of squares (Rousseeuw 1984), then least squares over what lies within 2.5 standard deviations.

    Robust standard deviation and limit: Rousseeuw and Leroy 1987, chapter 5, eq. 1.3; `threshold` plays no part.
    """
    def judge(candidates: FloatArray) -> tuple[Homography | None, float]:
        medians = [_median_square(problem, H) for H in candidates]
        best = int(np.argmin(medians)) if medians else -1
        return (None, math.inf) if best < 0 else (candidates[best], medians[best])

    H = best_drawn(problem, judge, lambda _: samples_needed(problem, _HALF))
    for _ in range(_REWEIGHTED):  # a minimal sample is far off where it has no points, and its median too large
        H = None if H is None else problem.only(_typical(problem, H)).polish(LEAST_SQUARES, H, problem.threshold_px)
    return None if H is None else fitted(problem, _typical(problem, H), H)


def three_sigma(problem: Problem, guess: Homography) -> Fit | None:
    """Least squares; what is off by more than three standard deviations is dropped, until nothing is (Pauta)."""
    chosen, H = problem.trust > 0, problem.polish(LEAST_SQUARES, guess, problem.threshold_px)
    while H is not None:
        near = chosen & (_distance_px(problem, H) <= _PAUTA_SIGMAS * _deviation_px(problem, chosen, H))
        if near.sum() == chosen.sum():
            return fitted(problem, chosen, H)
        chosen, H = near, problem.only(near).polish(LEAST_SQUARES, H, problem.threshold_px)
    return None


def _consensus_fit(problem: Problem, threshold_px: float) -> Fit | None:
    """Least squares over the largest consensus."""
    trust = max(float(problem.trust.sum()), 1e-9)

    def judge(candidates: FloatArray) -> tuple[Homography | None, float]:
        best, loss = problem.least_loss(RANSAC, candidates, threshold_px, octaves=1)
        return (None, math.inf) if best < 0 else (candidates[best], loss)

    H = best_drawn(problem, judge, lambda loss: samples_needed(problem, loss / trust))
    if H is None:
        return None
    consensus = problem.relative(H, threshold_px) < 1
    return fitted(problem, consensus, H, int(consensus.sum()))


def _typical(problem: Problem, H: Homography) -> BoolArray:
    """What lies within 2.5 robust standard deviations of H, (N,) bool."""
    spare = max(1, len(problem.pairs) - minimal_points(problem.basis.model))
    deviation_px = 1.4826 * (1 + 5 / spare) * math.sqrt(_median_square(problem, H))
    return np.asarray(problem.relative(H, _LMEDS_SIGMAS * deviation_px) < 1)


def _median_square(problem: Problem, H: Homography) -> float:
    """Median of the squared residuals, each counted with its trust, px^2."""
    squared = _distance_px(problem, H) ** 2
    order = np.argsort(squared, kind="stable")
    trust = np.cumsum(problem.trust[order])
    return float(squared[order][np.searchsorted(trust, trust[-1] / 2)])


def _distance_px(problem: Problem, H: Homography) -> FloatArray:
    """(N,) residuals, px; infinite behind the camera."""
    pairs = problem.pairs
    return np.asarray(np.sqrt(gn.squared_residuals(H, pairs.reference_px, pairs.current_px, problem.shape)))


def _deviation_px(problem: Problem, chosen: BoolArray, H: Homography) -> float:
    """Standard deviation of the chosen residuals (Bessel's), px."""
    distance = _distance_px(problem, H)[chosen]
    return max(math.sqrt(float(np.sum(distance**2)) / max(1, len(distance) - 1)), _LEAST_DEVIATION_PX)


def _with_truncation(problem: Problem, first: Fit, fit: Fit) -> Fit:
    """The second fit with the uncertainty that choosing by the first one leaves it.

    Among errors of standard deviation s on either axis, those within a disc of radius t about a first estimate that is
    off by d have the mean k d and the variance (1 - k) s^2, k = u exp(-u) / (1 - exp(-u)), u = t^2 / (2 s^2): the
    smaller the disc, the more of the first estimate's error stays.
    """
    chosen = first.inlier & (problem.trust > 0)
    spread_px = float(np.median(_distance_px(problem, first.ref_H_cur)[chosen])) / _RAYLEIGH_MEDIAN
    u = problem.threshold_px**2 / (2 * max(spread_px, _LEAST_DEVIATION_PX) ** 2)
    kept = u / math.expm1(min(u, _FAR))
    retained = covariance_of(problem, problem.only(fit.inlier).trust, fit.ref_H_cur, least=1 - kept)
    if retained is None:
        return fit
    return dataclasses.replace(fit, covariance=kept**2 * first.covariance + retained)
