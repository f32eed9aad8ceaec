"""Maps of the structural similarity (SSIM) of kernels over search areas, one map per point."""

from __future__ import annotations

import numpy as np

from stab_ros.core.kernels import F32, F64, I64, filled, kernel, read
from stab_ros.core.types import FloatArray

_C1, _C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2  # of Wang et al. 2004, for 8-bit images


def ssim_maps(kernels: FloatArray, areas: FloatArray, window: int) -> FloatArray:
    """SSIM of each kernel at each integer displacement: (N, m, m) float64 in [-1, 1].

    Wang et al. (2004, eq. 13), averaged over all windows of `window` px inside the kernel. Variances and covariances
    are unbiased (N - 1), as in the reference implementations.

    Args:
        kernels: (N, k, k) float32.
        areas: (N, k + m - 1, k + m - 1) float32 search areas.
        window: side of the averaged windows, px.
    """
    n, side, _ = kernels.shape
    lags = areas.shape[1] - side + 1
    window = min(window, side)
    maps = np.zeros((n, lags, lags))
    kernel_mean, kernel_variance = _window_statistics(kernels, window)
    area_mean, area_variance = _window_statistics(areas, window)
    _fill(kernels, areas, window, kernel_mean, kernel_variance, area_mean, area_variance, _C1, _C2, maps)
    return maps


def _window_statistics(images: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    """Mean and variance, float32, of every window in each of the images (N, s, s), by integral images."""
    values = images.astype(np.float64)
    count = window**2
    mean = _window_sums(values, window) / count
    square = _window_sums(values**2, window)
    variance = (square - count * mean**2) / max(count - 1, 1)
    return mean.astype(np.float32), variance.astype(np.float32)


def _window_sums(images: FloatArray, window: int) -> FloatArray:
    total = np.pad(images, ((0, 0), (1, 0), (1, 0))).cumsum(axis=1).cumsum(axis=2)
    return np.asarray(total[:, window:, window:] - total[:, :-window, window:] - total[:, window:, :-window]
                      + total[:, :-window, :-window])


_STACK = read(F32, 3)


@kernel((_STACK, _STACK, I64, _STACK, _STACK, _STACK, _STACK, F64, F64, filled(F64, 3)), fastmath=True)
def _fill(kernels: FloatArray, areas: FloatArray, window: int, kernel_mean: FloatArray, kernel_variance: FloatArray,
          area_mean: FloatArray, area_variance: FloatArray, c1: float, c2: float, maps: FloatArray) -> None:
    """Fills the maps. Only the covariance is summed again at each lag, by columns first and then along rows."""
    n, lags, _ = maps.shape
    side, places = kernels.shape[1], kernel_mean.shape[1]
    count, less = np.float32(window**2), np.float32(max(window**2 - 1, 1))
    luminance, contrast, two = np.float32(c1), np.float32(c2), np.float32(2)
    columns, scores = np.empty(side, np.float32), np.empty(places, np.float32)
    for i in range(n):
        for dy in range(lags):
            for dx in range(lags):
                total = np.float32(0)
                columns[:] = 0
                for row in range(side):
                    ahead, seen = kernels[i, row], areas[i, row + dy, dx : dx + side]
                    for column in range(side):
                        columns[column] += ahead[column] * seen[column]
                    top = row - window + 1
                    if top < 0:
                        continue
                    scores[:] = 0
                    for k in range(window):
                        part = columns[k : k + places]
                        for column in range(places):
                            scores[column] += part[column]
                    means, variances = kernel_mean[i, top], kernel_variance[i, top]
                    means_there = area_mean[i, top + dy, dx : dx + places]
                    variances_there = area_variance[i, top + dy, dx : dx + places]
                    along = np.float32(0)
                    for column in range(places):
                        a, b = means[column], means_there[column]
                        covariance = (scores[column] - count * a * b) / less
                        over = (two * a * b + luminance) * (two * covariance + contrast)
                        under = (a * a + b * b + luminance) * (variances[column] + variances_there[column] + contrast)
                        along += over / under
                    total += along
                    leaving, left = kernels[i, top], areas[i, top + dy, dx : dx + side]
                    for column in range(side):
                        columns[column] -= leaving[column] * left[column]
                maps[i, dy, dx] = total / places**2
