"""Root mean square difference (RMSD) of two images around a point (Ljubicic et al. 2021, Eq. 2)."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray, IdArray, Image


def cut(image: Image, centres_px: IdArray, window_px: int) -> FloatArray:
    """Windows (P, N, N) float32 of an image.

    Args:
        image: (h, w).
        centres_px: (P, 2), x and y.
        window_px: N, odd.

    Raises:
        ValueError: N is even, or a window is not completely inside the image.
    """
    if window_px < 1 or window_px % 2 == 0:
        raise ValueError(f"a window of {window_px} px, it must be odd")
    half = window_px // 2
    height, width = image.shape
    x, y = np.asarray(centres_px, np.int64).reshape(-1, 2).T
    outside = (x < half) | (y < half) | (x >= width - half) | (y >= height - half)
    if outside.any():
        at = np.flatnonzero(outside)[0]
        raise ValueError(f"the window of {window_px} px about ({x[at]}, {y[at]}) leaves the {width}x{height} image")
    span = np.arange(-half, half + 1)
    return np.asarray(image[(y[:, None] + span)[:, :, None], (x[:, None] + span)[:, None, :]], np.float32)


def rmsd(a: FloatArray, b: FloatArray) -> FloatArray:
    """RMSD (P,) float64, grey levels, of windows `a` and `b`, (P, N, N) each (Ljubicic et al. 2021, Eq. 2).

    Raises:
        ValueError: different shapes.
    """
    if a.shape != b.shape:
        raise ValueError(f"windows of {a.shape} and {b.shape}, they must have one shape")
    difference = np.subtract(a, b, dtype=np.float64)
    return np.asarray(np.sqrt(np.mean(difference * difference, axis=(1, 2))))
