"""Texture that repeats, as ripples of one length: a shift by one more repetition looks nearly the same.

What a window's correlation with itself shows beside its middle is how high a wrong peak stands beside the right one. A
wrong peak within the range of a search loses to the right one; alone in the range, it is taken for it.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.velocimetry.correlation_ensemble import correlations

_LEAST_ALIKE = 0.5  # correlation of a window with itself, one repetition on; of random texture 0.35 or less
_NEAR_PX = 5  # within it lies the peak at no shift
_HILL_PX = 3  # radius in which a peak is the highest


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
    far_px = np.hypot(x, y)
    far_px[(far_px <= _NEAR_PX) | (np.maximum(abs(x), abs(y)) > reach - _HILL_PX)] = np.inf
    return np.array([np.where((plane >= _LEAST_ALIKE) & (plane >= cv2.dilate(plane, hill)), far_px, np.inf).min()
                     for plane in planes])
