"""Inverses of small matrices by OpenCV, in some microseconds on the calling thread.

OpenBLAS of numpy 1.26 wakes its threads for a system of 20 unknowns: on busy cores one inverse then takes up to 24 ms.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import FloatArray


def inverse(A: FloatArray) -> FloatArray:
    """Inverse (n, n) of a matrix; all 0 where it has none."""
    return np.asarray(cv2.invert(np.ascontiguousarray(A, float))[1])


def solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """Solution (n,) or (n, m) of A x = b, A (n, n), b (n,) or (n, m)."""
    right = np.ascontiguousarray(b, float)
    return np.asarray(cv2.solve(np.ascontiguousarray(A, float), right.reshape(len(right), -1))[1]).reshape(right.shape)
