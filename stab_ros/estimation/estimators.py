"""Seven estimators of a homography from correspondences, each with every transformation model.

* `least_squares`: all features, weighted by their information matrices.
* `ransac` (Fischler and Bolles 1981): the minimal sample with the largest consensus set, then least squares over it.
* `lo_ransac` (Chum et al. 2003): as `ransac`, with a local optimization of good samples before they are compared.
* `three_sigma` (Pauta criterion): least squares, repeated without residuals above three standard deviations.
* `ed_ransac` (Zhang et al. 2023, section 2.2): a RANSAC consensus set, then a threshold on Euclidean distances.
* `lmeds` (Rousseeuw 1984): the sample with the least median of squared residuals.
* `magsac` (MAGSAC++, Barath et al. 2020): as `lo_ransac`, with soft weights instead of a hard threshold; the default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography
from stab_ros.estimation.consensus import ed_ransac, lmeds, ransac, three_sigma
from stab_ros.estimation.covariance import fit_with_loss
from stab_ros.estimation.models import minimal_points, nearest
from stab_ros.estimation.problem import (
    LEAST_SQUARES,
    MAGSAC,
    RANSAC,
    RANSAC_THRESHOLD_PX,
    EstimationProblem,
    LossFunction,
)
from stab_ros.estimation.search import search


def _with_loss(loss_function: LossFunction, problem: EstimationProblem, guess: Homography) -> Fit | None:
    H = search(problem, loss_function, guess)
    return None if H is None else fit_with_loss(problem, loss_function, H)


# Each returns None where the correspondences determine no homography. The initial guess is a homography of the model.
ESTIMATORS: Mapping[str, Callable[[EstimationProblem, Homography], Fit | None]] = {
    "least_squares": partial(_with_loss, LEAST_SQUARES),
    "ransac": ransac,
    "lo_ransac": partial(_with_loss, RANSAC),
    "three_sigma": three_sigma,
    "ed_ransac": ed_ransac,
    "lmeds": lmeds,
    "magsac": partial(_with_loss, MAGSAC),
}


def fit(pairs: Correspondences, model: str, estimator: str, threshold_px: float, guess: Homography,
        trust: FloatArray | None = None, ransac_threshold_px: float = RANSAC_THRESHOLD_PX) -> Fit | None:
    """Robust fit of a homography to correspondences.

    Args:
        pairs: N correspondences.
        model: one of `models.MODELS`.
        estimator: one of `ESTIMATORS`.
        threshold_px: inlier threshold, reference side.
        guess: initial `ref_H_cur`.
        trust: (N,) prior weights in [0, 1]; None for 1.
        ransac_threshold_px: inlier threshold of the consensus set that `ed_ransac` filters with `threshold_px`.

    Returns:
        The fit, or None if the correspondences do not determine a homography.
    """
    if len(pairs) < minimal_points(model):
        return None
    trust = np.ones(len(pairs)) if trust is None else trust
    problem = EstimationProblem.of(pairs, trust, model, threshold_px, ransac_threshold_px)
    return ESTIMATORS[estimator](problem, nearest(model, guess, pairs.current_px))


def refine(pairs: Correspondences, model: str, threshold_px: float, guess: Homography,
           trust: FloatArray) -> Homography | None:
    """The homography without its covariance, by MAGSAC++: for methods that fit and measure in turn.

    Arguments as for `fit`; None if the correspondences do not determine a homography.
    """
    if len(pairs) < minimal_points(model):
        return None
    return search(EstimationProblem.of(pairs, trust, model, threshold_px), MAGSAC, guess)
