"""Windows of images as spectra: the weights, the band-pass and the sub-pixel peak of FFT cross-correlation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.types import FloatArray

HIGH_PASS_PX, LOW_PASS_PX = 4.0, 1.0  # standard deviations of the Gaussians of the band-pass
_TAPER = 0.5  # share of the window in which it rises and falls


def gaussian_peak(near: FloatArray) -> FloatArray:
    """Offset (m, 2), px, of the peak of a Gaussian from the centre of correlations (m, 3, 3), at most 1 px per axis.

    PIVlab's 2x3-point Gaussian with the mixed term of a 2-D Gaussian (Nobach and Honkanen 2005), without which oblique
    textures converge slowly. NaN where the correlations are not concave.
    """
    level = np.log(np.maximum(near, 1e-9))
    gx, gy = (level[:, 1, 2] - level[:, 1, 0]) / 2, (level[:, 2, 1] - level[:, 0, 1]) / 2
    xx = level[:, 1, 2] + level[:, 1, 0] - 2 * level[:, 1, 1]
    yy = level[:, 2, 1] + level[:, 0, 1] - 2 * level[:, 1, 1]
    xy = (level[:, 2, 2] + level[:, 0, 0] - level[:, 2, 0] - level[:, 0, 2]) / 4
    determinant = np.where((xx < 0) & (xx * yy > xy**2), xx * yy - xy**2, np.nan)
    step = np.stack([xy * gy - yy * gx, xy * gx - xx * gy], axis=1) / determinant[:, None]
    return np.clip(step, -1.0, 1.0)


def window_spectra(patches: NDArray[Any], fraction_px: FloatArray) -> NDArray[np.complex128]:
    """Spectra (m, N, N/2+1) of patches (m, N, N) minus their weighted means, with windows moved by `fraction_px`."""
    columns, rows = (taper(patches.shape[1], fraction_px[:, axis]) for axis in (0, 1))
    weights = rows[:, :, None] * columns[:, None, :]
    weighted = patches * weights
    mean = weighted.sum(axis=(1, 2)) / weights.sum(axis=(1, 2))
    weighted -= mean[:, None, None] * weights
    return np.asarray(np.fft.rfft2(weighted))


def taper(side: int, fraction_px: FloatArray) -> FloatArray:
    """Tukey windows (m, N), moved by `fraction_px` (m,)."""
    from_middle = np.abs(np.arange(side) - (side - 1) / 2 - fraction_px[:, None])
    rise = np.clip((side / 2 - from_middle) / (_TAPER * side / 2), 0, 1)
    return np.asarray(np.sin(np.pi / 2 * rise) ** 2)


def correlation_at(cross: NDArray[np.complex128], lags_px: FloatArray) -> FloatArray:
    """Correlation (m, L, L), not normalized, at any lags: the inverse Fourier transform at a few places.

    Args:
        cross: (m, N, N/2+1), cross spectra.
        lags_px: (m, 2, L), the lags in x and those in y; row i and column j of the result are for y[i] and x[j].
    """
    side = cross.shape[1]
    k = 2 * np.pi * np.fft.fftfreq(side)
    half, both = np.abs(k[: cross.shape[2]]), both_halves(side)
    rows = np.exp(1j * lags_px[:, 1, :, None] * k)
    columns = both[:, None] * np.exp(1j * lags_px[:, 0, None, :] * half[:, None])
    return np.asarray((rows @ cross @ columns).real)


def band_pass(side: int) -> FloatArray:
    """Weights (N, N/2+1) of the frequencies of the cross spectrum."""
    k = 2 * np.pi * np.fft.fftfreq(side)
    k2 = k[:, None] ** 2 + k[None, : side // 2 + 1] ** 2
    return np.asarray((1 - np.exp(-k2 * HIGH_PASS_PX**2 / 2)) ** 2 * np.exp(-k2 * LOW_PASS_PX**2))


def both_halves(side: int) -> FloatArray:
    """Multiplicity (N/2+1,) of each column of a half spectrum in the full one."""
    return np.array([1.0] + [2.0] * (side // 2 - 1) + [1.0])
