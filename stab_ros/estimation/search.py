"""Locally optimized RANSAC, the search that the robust loss functions share."""

from __future__ import annotations

import math

from stab_ros.core.types import FloatArray, Homography
from stab_ros.estimation.problem import EstimationProblem, LossFunction
from stab_ros.estimation.samples import best_sample, samples_needed

_NOISE_FLOOR_SHARE = 0.2  # isotropic error added to each feature during the search, as a share of the threshold
_LOCAL_ITERATIONS = 2
_SUFFICIENT_SUPPORT = 0.8


def search(problem: EstimationProblem, loss_function: LossFunction, guess: Homography) -> Homography | None:
    """The homography with the smallest loss among the refined guess and locally optimized minimal samples.

    Locally optimized RANSAC (Chum et al. 2003): each good sample is optimized before it is compared. During the search
    an isotropic error is added to each feature, so that a few very certain features do not dominate. None where the
    correspondences determine no homography.
    """
    problem = problem.noise_inflated(_NOISE_FLOOR_SHARE * problem.threshold_px)
    if not loss_function.robust:
        return problem.polish(loss_function, guess, problem.threshold_px)
    best = _graduated_refinement(problem, loss_function, guess)
    least = math.inf if best is None else problem.least_loss(loss_function, best[None])[1]
    if best is not None and problem.support(best) > _SUFFICIENT_SUPPORT:
        return best  # no other plane can have more support

    def score(candidates: FloatArray) -> tuple[Homography | None, float]:
        """The best candidate after local optimization, and its loss."""
        index = problem.least_loss(loss_function, candidates)[0]
        polished = None if index < 0 else _local_optimization(problem, loss_function, candidates[index])
        return polished, math.inf if polished is None else problem.least_loss(loss_function, polished[None])[1]

    trust = max(float(problem.trust.sum()), 1e-9)
    return best_sample(problem, score, lambda loss: samples_needed(problem, loss / trust), best, least)


def _graduated_refinement(problem: EstimationProblem, loss_function: LossFunction,
                          guess: Homography) -> Homography | None:
    """The guess refined with decreasing thresholds (graduated non-convexity), for a guess that is a few px off."""
    H: Homography | None = guess
    limit_px = 3 * problem.median_residual_px(guess)
    while problem.threshold_px < limit_px < math.inf and H is not None:
        H = problem.polish(loss_function, H, limit_px, steps=2)
        limit_px /= 4
    return _local_optimization(problem, loss_function, H)


def _local_optimization(problem: EstimationProblem, loss_function: LossFunction,
                        H: Homography | None) -> Homography | None:
    """H refitted to its inliers, with a threshold adapted to their scatter."""
    for _ in range(_LOCAL_ITERATIONS):
        if H is not None:
            limit_px = problem.inlier_threshold_px(loss_function, problem.excess_scatter_px(H))
            H = problem.polish(loss_function, H, limit_px)
    return H
