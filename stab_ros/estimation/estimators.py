"""From correspondences to a homography: seven estimators, every one with every model.

* `least_squares`: all features, weighed with their information.
* `ransac` (Fischler and Bolles 1981): the minimal sample with the largest consensus, then least squares over that.
* `lo_ransac` (Chum et al. 2003): the same, but good samples are polished before they are compared.
* `three_sigma` (Pauta): least squares; what is off by more than three standard deviations is dropped, until nothing is.
* `ed_ransac` (Zhang et al. 2023, section 2.2): a RANSAC consensus, then a threshold on plain distances.
* `lmeds` (Rousseeuw 1984): the sample with the least median of squares.
* `magsac` (MAGSAC++, Barath et al. 2020): as `lo_ransac`, with weights instead of a yes or no; the default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography
from stab_ros.estimation.consensus import ed_ransac, lmeds, ransac, three_sigma
from stab_ros.estimation.covariance import measured
from stab_ros.estimation.models import minimal_points, nearest
from stab_ros.estimation.problem import LEAST_SQUARES, MAGSAC, RANSAC, RANSAC_THRESHOLD_PX, Kernel, Problem
from stab_ros.estimation.search import search


def _by_kernel(kernel: Kernel, problem: Problem, guess: Homography) -> Fit | None:
    H = search(problem, kernel, guess)
    return None if H is None else measured(problem, kernel, H)


# each gives None where the features determine nothing; the guess is a homography of the model
ESTIMATORS: Mapping[str, Callable[[Problem, Homography], Fit | None]] = {
    "least_squares": partial(_by_kernel, LEAST_SQUARES),
    "ransac": ransac,
    "lo_ransac": partial(_by_kernel, RANSAC),
    "three_sigma": three_sigma,
    "ed_ransac": ed_ransac,
    "lmeds": lmeds,
    "magsac": partial(_by_kernel, MAGSAC),
}


def fit(pairs: Correspondences, model: str, estimator: str, threshold_px: float, guess: Homography,
        trust: FloatArray | None = None, ransac_threshold_px: float = RANSAC_THRESHOLD_PX) -> Fit | None:
    """The homography of `model` that the correspondences agree on; None if they do not determine one.

    guess: where to start from. trust: (N,) prior weights in [0, 1]. ransac_threshold_px: of the consensus that
    `ed_ransac` filters with `threshold_px`.
    """
    if len(pairs) < minimal_points(model):
        return None
    trust = np.ones(len(pairs)) if trust is None else trust
    problem = Problem.of(pairs, trust, model, threshold_px, ransac_threshold_px)
    return ESTIMATORS[estimator](problem, nearest(model, guess, pairs.current_px))


def refine(pairs: Correspondences, model: str, threshold_px: float, guess: Homography,
           trust: FloatArray) -> Homography | None:
    """The homography alone, good enough for the inner iterations of a method that measures again after each."""
    if len(pairs) < minimal_points(model):
        return None
    return search(Problem.of(pairs, trust, model, threshold_px), MAGSAC, guess)
