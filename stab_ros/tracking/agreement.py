"""Whether matches agree on one motion by more than chance: a similarity, and the number of false alarms behind it.

Among N wrong matches a few always agree on some similarity. The number of false alarms (NFA) is how many such groups
are expected where matches are wrong and lie anywhere within reach: the number of pairs that define a similarity, times
the binomial tail of the others that agree with it (a contrario test, Moisan and Stival 2004; Desolneux et al. 2008).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Homography
from stab_ros.estimation import estimators

_MOST_SAMPLES = 5000
_LEAST_AGREEING = 6  # a texture that repeats itself agrees more often than chance
_LOG10_FALSE_ALARMS = -4.0  # matches on one texture are not independent, so a thousandth of an alarm is too many
_DETERMINED = 16  # matches, four times as many as a homography needs
_TILT = 6.0  # times the threshold, which a tilt of the camera adds at the edges
_SIGMA_SHARE = 0.3  # standard deviation of a right match, as a share of the threshold


def motion(current_px: FloatArray, anchor_px: FloatArray, threshold_px: float, reach_px2: float) -> Homography | None:
    """anchor_H_cur on which most of the matches agree; None where chance explains it.

    A similarity, which few right matches determine, and where they are enough the homography near it.

    Args:
        current_px: (N, 2) in the frame.
        anchor_px: (N, 2) where they were found in the anchor frame.
        threshold_px: largest distance of one that agrees.
        reach_px2: area within which a wrong match lies anywhere with the same probability.
    """
    found = similarity(current_px, anchor_px, threshold_px, _LEAST_AGREEING, _MOST_SAMPLES)
    if found is None:
        return None
    H, agrees = found
    chance = min(1.0, math.pi * threshold_px**2 / reach_px2)
    if log10_false_alarms(len(agrees), int(agrees.sum()), chance) > _LOG10_FALSE_ALARMS:
        return None
    return _tilted(current_px, anchor_px, threshold_px, H) if agrees.sum() >= _DETERMINED else H


def log10_false_alarms(matches: int, agreeing: int, chance: float) -> float:
    """Log of the expected number of similarities on which so many of the matches agree by chance.

    chance: that a wrong match lies within the threshold of where a given similarity puts it.
    """
    others, k = matches - 2, agreeing - 2
    pairs = math.log10(max(matches * (matches - 1) / 2, 1))
    if k <= 0 or chance >= 1:
        return pairs
    terms = [_log_binomial(others, i) + i * math.log(chance) + (others - i) * math.log1p(-chance)
             for i in range(k, others + 1)]
    most = max(terms)
    return pairs + (most + math.log(math.fsum(math.exp(term - most) for term in terms))) / math.log(10)


def _log_binomial(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)


def similarity(current_px: FloatArray, anchor_px: FloatArray, threshold_px: float, least: int,
               most_samples: int) -> tuple[Homography, BoolArray] | None:
    """The similarity that most of N matches agree on, and (N,) bool: these; None where fewer than `least` do."""
    if len(current_px) < least:
        return None
    affine, agrees = cv2.estimateAffinePartial2D(current_px, anchor_px, method=cv2.RANSAC, maxIters=most_samples,
                                                 ransacReprojThreshold=threshold_px)
    if affine is None or not np.isfinite(affine).all() or agrees.sum() < least:
        return None
    return np.vstack([affine, [0.0, 0.0, 1.0]]), agrees.ravel().astype(bool)


def _tilted(current_px: FloatArray, anchor_px: FloatArray, threshold_px: float, H: Homography) -> Homography:
    """The similarity H refined to a homography by the matches near it."""
    near = np.hypot(*(apply(H, current_px) - anchor_px).T) < _TILT * threshold_px
    n = int(near.sum())
    information = np.eye(2) / (_SIGMA_SHARE * threshold_px) ** 2
    pairs = Correspondences(np.arange(n), anchor_px[near], current_px[near], np.tile(information, (n, 1, 1)))
    better = estimators.refine(pairs, "projective", threshold_px, H, np.ones(n))
    return H if better is None else better
