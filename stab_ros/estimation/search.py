"""The search that the robust kernels share: samples drawn and scored, the best one polished (LO-RANSAC)."""

from __future__ import annotations

import math

from stab_ros.core.types import FloatArray, Homography
from stab_ros.estimation.problem import Kernel, Problem
from stab_ros.estimation.samples import best_drawn, samples_needed

_LEVEL = 0.2  # of the threshold: features more certain than this count alike in the search
_SETTLING = 2
_MAJORITY = 0.8


def search(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """The best of the narrowed-down guess and of polished samples, drawn until one more cannot matter.

    Each good sample is polished before it is compared (locally optimised RANSAC, Chum et al. 2003).
    No feature may outvote many others here: the information is levelled to a fraction of the threshold.
    """
    problem = problem.softened(_LEVEL * problem.threshold_px)
    if not kernel.robust:
        return problem.polish(kernel, guess, problem.threshold_px)
    best = _narrow_down(problem, kernel, guess)
    least = math.inf if best is None else problem.least_loss(kernel, best[None])[1]
    if best is not None and problem.agreeing(best) > _MAJORITY:
        return best  # no other plane can have more

    def judge(candidates: FloatArray) -> tuple[Homography | None, float]:
        """The best of the samples' homographies, fitted to all that agrees with it."""
        index = problem.least_loss(kernel, candidates)[0]
        polished = None if index < 0 else _settle(problem, kernel, candidates[index])
        return polished, math.inf if polished is None else problem.least_loss(kernel, polished[None])[1]

    trust = max(float(problem.trust.sum()), 1e-9)
    return best_drawn(problem, judge, lambda loss: samples_needed(problem, loss / trust), best, least)


def _narrow_down(problem: Problem, kernel: Kernel, guess: Homography) -> Homography | None:
    """From the guess through ever smaller thresholds (graduated non-convexity), for a guess that is a few px off."""
    H: Homography | None = guess
    reach_px = 3 * problem.typical_px(guess)
    while problem.threshold_px < reach_px < math.inf and H is not None:
        H = problem.polish(kernel, H, reach_px, steps=2)
        reach_px /= 4
    return _settle(problem, kernel, H)


def _settle(problem: Problem, kernel: Kernel, H: Homography | None) -> Homography | None:
    """H fitted to what lies within the scatter of what agrees with it."""
    for _ in range(_SETTLING):
        H = None if H is None else problem.polish(kernel, H, problem.reach_px(kernel, H))
    return H
