"""Texture that repeats, as ripples of one length: a shift by one more repetition looks nearly the same.

What a window's correlation with itself shows beside its middle is how high a wrong peak stands beside the right one. A
wrong peak within the range of a search loses to the right one; alone in the range, it is taken for it.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Gray, IdArray
from stab_ros.velocimetry.correlation_ensemble import correlations, prepared

_LEAST_ALIKE = 0.5  # correlation of a window with itself, one repetition on; of random texture 0.35 or less
_NEAR_PX = 5  # within it lies the peak at no shift
_HILL_PX = 3  # radius in which a peak is the highest
_VALLEY = 0.5  # of a repetition lies half way to it, at most; along an edge all shifts look alike
_SIDE_PX = 48  # of the windows around features
_ABOUT_PX = 64  # half side of what is made ready around a feature
_ENOUGH, _FEWEST = 32, 8  # features that are looked at
_MOST = 0.5  # share of them that repeat


def periods_px(picture: IdArray, centres_px: FloatArray, side_px: int) -> FloatArray:
    """(N,) shift to the next repetition, px; inf: none within half a window.

    Args:
        picture: (h, w) int16, of `prepared`.
        centres_px: (N, 2) of the windows.
        side_px: of the windows.
    """
    reach = side_px // 2
    planes = correlations([picture], np.zeros((1, 2), np.int64), centres_px, side_px, reach)
    hill = np.ones((2 * _HILL_PX + 1, 2 * _HILL_PX + 1), np.uint8)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    half = reach + y // 2, reach + x // 2
    far_px = np.hypot(x, y)
    far_px[(far_px <= _NEAR_PX) | (np.maximum(abs(x), abs(y)) > reach - _HILL_PX)] = np.inf

    def nearest_px(plane: FloatArray) -> float:
        peak = (plane >= _LEAST_ALIKE) & (plane >= cv2.dilate(plane, hill)) & (plane[half] < _VALLEY * plane)
        return float(np.where(peak, far_px, np.inf).min())

    return np.array([nearest_px(plane) for plane in planes])


def usual_period_px(gray: Gray, features_px: FloatArray) -> float:
    """Shift to the next repetition, px, of the texture around most of the features (N, 2); inf: it does not repeat."""
    inside = ((features_px >= _SIDE_PX / 2) & (features_px <= np.array(gray.shape[::-1]) - _SIDE_PX / 2)).all(axis=1)
    seen = features_px[inside]
    if len(seen) < _FEWEST:
        return np.inf
    period_px = np.array([_period_px(gray, feature) for feature in seen[:: len(seen) // _ENOUGH + 1]])
    known = np.isfinite(period_px)
    return float(np.median(period_px[known])) if known.mean() > _MOST else np.inf


def _period_px(gray: Gray, feature_px: FloatArray) -> float:
    """That of the texture around one; only what lies about it is made ready, as pictures are large."""
    first = np.maximum(np.round(feature_px).astype(np.int64) - _ABOUT_PX, 0)
    x, y = first.tolist()
    about = gray[y : y + 2 * _ABOUT_PX, x : x + 2 * _ABOUT_PX]
    return float(periods_px(prepared(about, _SIDE_PX), (feature_px - first)[None], _SIDE_PX)[0])
