"""Ensemble correlation: correlations of many pairs of pictures are averaged before the peak is sought.

Meinhart, Wereley and Santiago (2000): averaged correlations have a peak where single ones have only noise, and no
outliers that would have to be filtered. Displacements are first sought over a wide area by FFT (`searched`), then
measured in pictures that are drawn along them (`Ensemble`), where only lags of one pixel are left to be correlated.
Pictures are band-passed, and their contrast is made the same everywhere; this is done once for each (`prepared`).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from stab_ros.core.threads import in_parallel
from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.metrics.window_spectra import HIGH_PASS_PX, LOW_PASS_PX, gaussian_peak
from stab_ros.velocimetry.correlation_blocks import as_spline, block_correlations, from_spline

_LAGS = np.arange(-1, 2)
_LEAST = 16  # windows that a thread takes
_CHUNK = 32  # windows transformed at once, which stay in the cache
_MOST_LAGS = 8_000_000  # whose correlations are kept at once
_PEAK_RADIUS_PX = 5  # within it no other peak is sought
_CONTRAST_FLOOR = 1.0  # grey levels, of the band-passed picture: below it contrast is noise


def prepared(picture: Gray, side_px: int) -> IdArray:
    """The spline (h, w) int16 of a picture (h, w) uint8 that is ready to be correlated.

    It has neither slow changes nor the finest detail, and the same contrast in each square of side_px.
    """
    fine = cv2.GaussianBlur(np.asarray(picture, np.float32), (0, 0), LOW_PASS_PX)
    band = cv2.subtract(fine, cv2.GaussianBlur(fine, (0, 0), HIGH_PASS_PX))
    power = cv2.boxFilter(cv2.multiply(band, band), -1, (side_px, side_px))
    return as_spline(np.asarray(cv2.divide(band, cv2.sqrt(cv2.add(power, _CONTRAST_FLOOR**2)))))


class Ensemble:
    """Correlations at lags of one pixel of blocks of a grid, in pictures drawn along a field of velocities."""

    def __init__(self, pictures: Sequence[IdArray], block_px: int) -> None:
        """Args: pictures (h, w) int16, of `prepared`; block_px, side of the blocks."""
        self._pictures, self._block_px = pictures, block_px

    def blocks(self, pair: tuple[int, int], shift_px: FloatArray, first_px: float, step_px: float,
               wanted: BoolArray) -> FloatArray:
        """Correlations of a pair in the blocks, (rows, columns, 10): see `block_correlations`.

        Args:
            pair: numbers of the pictures.
            shift_px: (r, c, 2), the displacements that are expected at the nodes.
            first_px: x and y of the first node.
            step_px: distance of the nodes.
            wanted: (rows, columns) of blocks; the others are 0.
        """
        first, second = (self._pictures[k] for k in pair)
        return block_correlations(first, second, shift_px, first_px, step_px, self._block_px, wanted)


def searched(pictures: Sequence[IdArray], pairs: IdArray, centres_px: FloatArray, side_px: int,
             reach_px: int) -> tuple[FloatArray, FloatArray]:
    """Displacements within a square, by the highest peak of the averaged normalized cross-correlation.

    Args:
        pictures: (h, w) int16, of `prepared`.
        pairs: (P, 2), numbers of pictures, which should be equally far apart in time.
        centres_px: (N, 2), of the windows.
        side_px: of the windows in the first picture of a pair; in the second they are wider by reach_px on each side.
        reach_px: longest displacement in x and y.

    Returns:
        (N, 2) px; and (N,) the highest peak over the second one.
    """
    batch = max(_MOST_LAGS // (2 * reach_px + 1) ** 2, 1)
    starts = range(0, max(len(centres_px), 1), batch)
    parts = [_peaks(correlations(pictures, pairs, centres_px[k : k + batch], side_px, reach_px)) for k in starts]
    shift_px, ratio = (np.concatenate(values) for values in zip(*parts, strict=True))
    return shift_px, ratio


def correlations(pictures: Sequence[IdArray], pairs: IdArray, centres_px: FloatArray, side_px: int,
                 reach_px: int) -> FloatArray:
    """The normalized cross-correlations (N, 2 reach_px + 1, 2 reach_px + 1), y before x; arguments of `searched`."""
    planes = np.zeros((len(centres_px), 2 * reach_px + 1, 2 * reach_px + 1), np.float32)
    corners = np.round(centres_px - (side_px - 1) / 2).astype(np.int64)
    for a, b in pairs.tolist():
        first, second = (np.pad(from_spline(pictures[k]), reach_px) for k in (a, b))
        _add_planes(planes, first, second, corners, side_px)
    return planes / len(pairs)


def _add_planes(planes: FloatArray, first: FloatArray, second: FloatArray, corners: IdArray, side_px: int) -> None:
    """Adds the correlation of a pair; pictures with a border as wide as the planes reach."""
    reach = planes.shape[1] // 2
    wide = side_px + 2 * reach
    length = next_fast_len(wide, real=True)
    sums = cv2.boxFilter(second * second, -1, (side_px, side_px), anchor=(0, 0), normalize=False)
    small, large, powers = (sliding_window_view(picture, (n, n)) for picture, n in
                            ((first, side_px), (second, wide), (sums, planes.shape[1])))

    def part(start: int, end: int) -> None:
        for k in range(start, end, _CHUNK):
            at = slice(k, min(k + _CHUNK, end))
            x, y = corners[at].T
            template = small[y + reach, x + reach]
            cross = np.conj(_spectra(template, length)) * _spectra(large[y, x], length)
            lags = irfft2(cross, (length, length))[:, : planes.shape[1], : planes.shape[1]]
            power = np.einsum("nij,nij->n", template, template)[:, None, None] * powers[y, x]
            planes[at] += lags / np.sqrt(np.maximum(power, 1e-6))

    in_parallel(part, len(corners), _LEAST)


def _spectra(windows: FloatArray, length: int) -> NDArray[np.complex64]:
    return np.asarray(rfft2(windows, (length, length)))


def _peaks(planes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place (N, 2) of the highest value of each plane, px from its middle, and its ratio (N,) to the next peak."""
    side = planes.shape[1]
    each, reach = np.arange(len(planes)), side // 2
    y, x = np.divmod(planes.reshape(len(planes), side**2).argmax(axis=1), side)
    dx, dy = np.arange(side) - x[:, None], np.arange(side) - y[:, None]
    away = (dx**2)[:, None, :] + (dy**2)[:, :, None] > _PEAK_RADIUS_PX**2
    second = np.where(away, planes, 0.0).max(axis=(1, 2))
    ratio = planes[each, y, x] / np.maximum(second, 1e-6)
    inner = [np.clip(at, 1, side - 2)[:, None] + _LAGS for at in (y, x)]
    near = planes[each[:, None, None], inner[0][:, :, None], inner[1][:, None, :]]
    return np.stack([x, y], axis=1) - float(reach) + np.nan_to_num(gaussian_peak(near)), ratio
