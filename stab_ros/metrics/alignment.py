"""Windows that are moved by a known displacement, so that the remaining difference is not due to displacement."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.metrics.rmsd import cut

_REACH_PX = 4  # radius of the interpolation kernel


def follow(image: Gray, centres_px: IdArray, window_px: int, shifts_px: FloatArray) -> FloatArray:
    """Windows (P, N, N) float64 of an image about `centres_px + shifts_px`, interpolated by a Lanczos kernel.

    NaN where the shift is NaN or the window is not completely inside the image.

    Args:
        image: (h, w) uint8.
        centres_px: (P, 2), x and y.
        window_px: N, odd.
        shifts_px: (P, 2), x and y.
    """
    windows = np.full((len(centres_px), window_px, window_px), np.nan)
    whole = np.floor(np.nan_to_num(shifts_px)).astype(np.int64)
    at = centres_px + whole
    inside = np.isfinite(shifts_px).all(axis=1) & _fits(at, window_px + 2 * _REACH_PX, image)
    if inside.any():
        wide = cut(image, at[inside], window_px + 2 * _REACH_PX).astype(np.float64)
        fraction = (shifts_px - whole)[inside]
        windows[inside] = _taps(fraction[:, 1], window_px) @ wide @ _taps(fraction[:, 0], window_px).transpose(0, 2, 1)
    return windows


def _fits(centres_px: IdArray, window_px: int, image: Gray) -> BoolArray:
    half = window_px // 2
    return np.asarray(((centres_px >= half) & (centres_px < np.array(image.shape[::-1]) - half)).all(axis=1))


def _taps(fraction: FloatArray, window_px: int) -> FloatArray:
    """Interpolation matrices (P, N, N + 2 radius) for a shift by `fraction` (P,) of a pixel, in [0, 1)."""
    row, column = np.arange(window_px)[:, None], np.arange(window_px + 2 * _REACH_PX)
    distance = (column - row - _REACH_PX) - fraction[:, None, None]
    taps = np.where(np.abs(distance) < _REACH_PX, np.sinc(distance) * np.sinc(distance / _REACH_PX), 0.0)
    return np.asarray(taps / taps.sum(axis=2, keepdims=True))


def kept_share(shifts_px: FloatArray) -> FloatArray:
    """Share (P,) of the variance of white noise after the interpolation of `follow`; NaN where the shift is NaN."""
    fraction = shifts_px - np.floor(shifts_px)
    known = np.nan_to_num(fraction)
    squares = [np.square(_taps(known[:, axis], 1)).sum(axis=(1, 2)) for axis in (0, 1)]
    return np.asarray(np.where(np.isfinite(fraction).all(axis=1), squares[0] * squares[1], np.nan))
