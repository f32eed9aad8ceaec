"""Where a verification point may stand: R^2 of d(RMSD), Eq. 3 of Ljubicic et al. (2021), all over a picture at once.

A first choice, on a grid of 4 px, from shifts by whole pixels alone: those cost no more than a subtraction.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.metrics.calibration import coefficients, determination

_STEP_PX = 4
# (dx, dy): up to 5 px, in four directions; the opposite ones would say the same
_PROBES_PX = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 2), (2, -2), (3, 0), (0, 3), (4, 4), (4, -4), (5, 0), (0, 5))
_APART = 5  # grid steps over which a candidate is the best


def candidates(reference: Gray, possible: BoolArray, window_px: int, noise_sigma: float, cell_px: float,
               per_cell: int) -> IdArray:
    """(n, 2) pixels, x then y: where `quality` has its highest peaks, at most `per_cell` in any cell of `cell_px`.

    reference: (h, w) uint8. possible: (h, w) bool, where a candidate may lie.
    """
    found = quality_map(reference, window_px, noise_sigma)
    found[~_on_grid(possible)] = 0
    highest = (found > 0) & (found >= cv2.dilate(found, np.ones((_APART, _APART), np.uint8)))
    row, column = np.nonzero(highest)
    order = np.argsort(-found[row, column], kind="stable")
    places = np.stack([column, row], axis=1)[order] * _STEP_PX + _STEP_PX // 2
    return places[_rank_in_cell(places // cell_px) < per_cell]


def quality(r2: FloatArray | float, strength: FloatArray | float, noise_sigma: float) -> FloatArray:
    """R^2, less where a displacement of 1 px makes a RMSD (`strength`, grey levels) that noise and rounding reach."""
    square = np.square(strength)
    return np.asarray(r2 * square / (square + 2 + 2 * noise_sigma**2))


def quality_map(reference: Gray, window_px: int, noise_sigma: float) -> FloatArray:
    """(h // 4, w // 4) float32, for windows about the pixels (4 i + 2, 4 j + 2)."""
    rmsd = np.stack([_rmsd(reference, probe, window_px, noise_sigma) for probe in _PROBES_PX])
    shift_px = np.hypot(*np.array(_PROBES_PX, np.float32).T)
    a, b = coefficients(shift_px, rmsd)
    strength = rmsd[:2].mean(axis=0)
    return quality(determination(a, b, shift_px, rmsd), strength, noise_sigma).astype(np.float32)


def _rmsd(reference: Gray, probe_px: tuple[int, int], window_px: int, noise_sigma: float) -> FloatArray:
    """(h // 4, w // 4) float32: RMSD against the picture shifted by `probe_px`, free of noise."""
    height, width = (n // _STEP_PX * _STEP_PX for n in reference.shape)
    (dx, dy), square = probe_px, np.zeros((height, width), np.uint16)
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
    """(n,) how many earlier places lie in the same cell (n, 2)."""
    _, number = np.unique(cell, axis=0, return_inverse=True)
    order = np.argsort(number.ravel(), kind="stable")
    sorted_number = number.ravel()[order]
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(sorted_number, sorted_number)
    return rank
