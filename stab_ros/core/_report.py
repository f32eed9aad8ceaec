"""From a fitted homography to a `Fit`: who agreed, how far off they are, and how uncertain it is."""

from __future__ import annotations

import numpy as np

from stab_ros.core import _gauss_newton as gn
from stab_ros.core._problem import LEAST_SQUARES, Kernel, Problem
from stab_ros.core.geometry import apply
from stab_ros.core.models import PARAMETERS
from stab_ros.core.types import BoolArray, Fit, FloatArray, Homography


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
    `least`. None where the features that count determine nothing.
    """
    pairs, basis = problem.pairs, problem.basis
    normal, right, claimed, shown = gn.accumulate(H, pairs.reference_px, pairs.current_px, pairs.information, weight,
                                                  basis.centre, basis.radius, PARAMETERS[basis.model])
    if not gn.solve(normal, right)[0]:
        return None
    inverse = np.linalg.inv(normal)
    excess = max(least, float(np.trace(inverse @ shown)) / float(np.trace(inverse @ claimed)))
    to_entries = basis.entry_jacobian(H) @ inverse
    return np.asarray(to_entries @ (claimed * excess) @ to_entries.T)
