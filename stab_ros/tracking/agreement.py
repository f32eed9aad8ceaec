"""Whether matches agree on one motion by more than chance: a similarity, and the number of false alarms behind it.

Among N wrong matches a few always agree on some similarity. The number of false alarms (NFA) is how many such groups
are expected where matches are wrong and lie anywhere within reach: the number of pairs that define a similarity, times
the binomial tail of the others that agree with it (a contrario test, Moisan and Stival 2004; Desolneux et al. 2008).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Homography

_MOST_SAMPLES = 10000
_LEAST_AGREEING = 6  # a texture that repeats itself agrees more often than chance
_LOG10_FALSE_ALARMS = -4.0  # matches on one texture are not independent, so a thousandth of an alarm is too many


def similarity(current_px: FloatArray, anchor_px: FloatArray, threshold_px: float,
               reach_px2: float) -> tuple[Homography, BoolArray] | None:
    """The similarity that most matches agree on, if chance does not explain it.

    Args:
        current_px: (N, 2) in the frame.
        anchor_px: (N, 2) where they were found in the anchor frame.
        threshold_px: largest distance of one that agrees.
        reach_px2: area within which a wrong match lies anywhere with the same probability.

    Returns:
        anchor_H_cur, and (N,) bool: the matches that agree.
    """
    if len(current_px) < _LEAST_AGREEING:
        return None
    affine, agrees = cv2.estimateAffinePartial2D(current_px, anchor_px, method=cv2.RANSAC, maxIters=_MOST_SAMPLES,
                                                 ransacReprojThreshold=threshold_px)
    if affine is None or not np.isfinite(affine).all():
        return None
    count, chance = int(agrees.sum()), min(1.0, math.pi * threshold_px**2 / reach_px2)
    if count < _LEAST_AGREEING or log10_false_alarms(len(current_px), count, chance) > _LOG10_FALSE_ALARMS:
        return None
    return np.vstack([affine, [0.0, 0.0, 1.0]]), agrees.ravel().astype(bool)


def log10_false_alarms(matches: int, agreeing: int, chance: float) -> float:
    """Log of the expected number of similarities on which so many of the matches agree by chance.

    chance: that a wrong match lies within the threshold of where a given similarity puts it.
    """
    others, k = matches - 2, agreeing - 2
    if k <= 0 or chance >= 1:
        return math.log10(max(matches * (matches - 1) / 2, 1))
    terms = [_log_binomial(others, i) + i * math.log(chance) + (others - i) * math.log1p(-chance)
             for i in range(k, others + 1)]
    most = max(terms)
    tail = most + math.log(math.fsum(math.exp(term - most) for term in terms))
    return (math.log(matches * (matches - 1) / 2) + tail) / math.log(10)


def _log_binomial(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
