"""Map of R^2 of d(RMSD), Eq. 3 of Ljubicic et al. (2021), over a whole image: candidates for verification points.

An approximation on a grid of 4 px that uses shifts by whole pixels only, which need no interpolation.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.metrics.calibration import coefficients, determination

_STEP_PX = 4
# (dx, dy), up to 5 px in four directions; opposite directions give the same RMSD
_TEST_SHIFTS_PX = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 2), (2, -2), (3, 0), (0, 3), (4, 4), (4, -4), (5, 0), (0, 5))
_PEAK_WINDOW = 5  # side of the window of the peak detection, grid steps


def candidates(reference: Gray, allowed: BoolArray, window_px: int, noise_sigma: float, cell_px: float,
               per_cell: int) -> IdArray:
    """Pixels (n, 2) int64, x and y, of the highest peaks of `quality`, at most `per_cell` in each cell of `cell_px`.

    Args:
        reference: (h, w) uint8.
        allowed: (h, w) bool, where a candidate may lie.
        window_px: side of the RMSD window.
        noise_sigma: standard deviation of the noise of the reference, grey levels.
        cell_px: side of the cells.
        per_cell: largest number of candidates per cell.
    """
    found = quality_map(reference, window_px, noise_sigma)
    found[~_on_grid(allowed)] = 0
    highest = (found > 0) & (found >= cv2.dilate(found, np.ones((_PEAK_WINDOW, _PEAK_WINDOW), np.uint8)))
    row, column = np.nonzero(highest)
    order = np.argsort(-found[row, column], kind="stable")
    places = np.stack([column, row], axis=1)[order] * _STEP_PX + _STEP_PX // 2
    return places[_rank_in_cell(places // cell_px) < per_cell]


def quality(r2: FloatArray | float, strength: FloatArray | float, noise_sigma: float) -> FloatArray:
    """R^2, reduced where the RMSD of a displacement of 1 px (`strength`, grey levels) is close to the noise."""
    square = np.square(strength)
    return np.asarray(r2 * square / (square + 2 + 2 * noise_sigma**2))


def quality_map(reference: Gray, window_px: int, noise_sigma: float) -> FloatArray:
    """`quality` (h // 4, w // 4) float32 of windows centred on the pixels (4 i + 2, 4 j + 2).

    reference: (h, w) uint8. window_px: side of the window. noise_sigma: of the reference, grey levels.
    """
    rmsd = np.stack([_rmsd(reference, test_shift, window_px, noise_sigma) for test_shift in _TEST_SHIFTS_PX])
    shift_px = np.hypot(*np.array(_TEST_SHIFTS_PX, np.float32).T)
    a, b = coefficients(shift_px, rmsd)
    strength = rmsd[:2].mean(axis=0)
    return quality(determination(a, b, shift_px, rmsd), strength, noise_sigma).astype(np.float32)


def _rmsd(reference: Gray, test_shift_px: tuple[int, int], window_px: int, noise_sigma: float) -> FloatArray:
    """RMSD (h // 4, w // 4) float32 against the image shifted by `test_shift_px`, corrected for noise."""
    height, width = (n // _STEP_PX * _STEP_PX for n in reference.shape)
    (dx, dy), square = test_shift_px, np.zeros((height, width), np.uint16)
    here, there = (reference[max(s * dy, 0) : height + min(s * dy, 0), max(s * dx, 0) : width + min(s * dx, 0)]
                   for s in (1, -1))
    difference = cv2.absdiff(here, there)
    square[max(dy, 0) : height + min(dy, 0), max(dx, 0) : width + min(dx, 0)] = cv2.multiply(
        difference, difference, dtype=cv2.CV_16U)
    small = cv2.resize(square, (width // _STEP_PX, height // _STEP_PX), interpolation=cv2.INTER_AREA)
    side = window_px // _STEP_PX | 1
    mean = cv2.boxFilter(small, cv2.CV_32F, (side, side))
    return np.asarray(np.sqrt(np.maximum(mean - np.float32(2 * noise_sigma**2), 0)))


def _on_grid(mask: BoolArray) -> BoolArray:
    return mask[_STEP_PX // 2 :: _STEP_PX, _STEP_PX // 2 :: _STEP_PX][: mask.shape[0] // _STEP_PX,
                                                                      : mask.shape[1] // _STEP_PX]


def _rank_in_cell(cell: FloatArray) -> IdArray:
    """Number (n,) of earlier entries in the same cell (n, 2)."""
    _, number = np.unique(cell, axis=0, return_inverse=True)
    order = np.argsort(number.ravel(), kind="stable")
    sorted_number = number.ravel()[order]
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(sorted_number, sorted_number)
    return rank
