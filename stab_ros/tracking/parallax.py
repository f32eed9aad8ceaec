"""Whether the ground is no plane: residuals that neighbouring cells share, along one direction.

A camera that moves sideways sees what stands above the plane move further: the homography then is a compromise. Noise
differs from feature to feature, stray water from cell to cell of the picture, so what neighbouring cells share is
neither. A lens bends the picture to or from its middle, parallax along the way the camera has gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray

_CELLS = (8, 6)  # across and down
_LEAST_FEATURES = 5  # in a cell
_LEAST_PAIRS = 8  # of such cells, side by side
_NUMBERS = np.arange(_CELLS[0] * _CELLS[1]).reshape(_CELLS[::-1])
_NEIGHBOURS = np.hstack([[_NUMBERS[:, :-1].ravel(), _NUMBERS[:, 1:].ravel()],
                         [_NUMBERS[:-1].ravel(), _NUMBERS[1:].ravel()]])
_FAR_PX = 3.0  # what is off by more is no ground
_RATE = 0.05  # of a frame: the last second counts
_SETTLED = 20  # frames, before anything is said
_WARN_PX, _CALM_PX = 0.06, 0.045  # over planes it is at most 0.04 (docs/lens_and_parallax.md)
_ONE_WAY = 0.75  # of the squares lie along one direction


@dataclass(frozen=True)
class Relief:
    """px: RMS of the shared residuals; the homography has absorbed more of the parallax, and errs by that.

    deg: the direction along which, in the reference, 0 right and 90 down.
    """

    px: float
    deg: float


class Parallax:
    """Of a reference of `size` (width, height), fed with every accepted fit."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._shared = np.zeros((2, 2))  # px^2
        self._frames = 0
        self._relief: Relief | None = None

    def add(self, pairs: Correspondences, fit: Fit, ground: BoolArray) -> None:
        """ground: (N,) bool, which of the pairs are static ground."""
        off = pairs.reference_px - apply(fit.ref_H_cur, pairs.current_px)
        chosen = ground & (np.abs(off).max(axis=1, initial=0) < _FAR_PX)
        shared = _shared_by_neighbours(pairs.reference_px[chosen], off[chosen], self._size)
        if shared is None:
            return
        self._frames += 1
        self._shared += max(_RATE, 1 / self._frames) * (shared - self._shared)
        self._relief = self._judged() if self._frames >= _SETTLED else None

    @property
    def relief(self) -> Relief | None:
        """The parallax, if it is enough for a warning; else None."""
        return self._relief

    def _judged(self) -> Relief | None:
        """With hysteresis: a warning stays until there is clearly less."""
        values, axes = np.linalg.eigh(self._shared)
        px = math.sqrt(max(values[1], 0.0))
        one_way = values[1] > _ONE_WAY * np.abs(values).sum()
        if not one_way or px <= (_CALM_PX if self._relief else _WARN_PX):
            return None
        return Relief(px, math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180)


def _shared_by_neighbours(places_px: FloatArray, off_px: FloatArray, size: tuple[int, int]) -> FloatArray | None:
    """(2, 2) mean product of the residuals of neighbouring cells, px^2, in which noise and single cells cancel out."""
    cell = (places_px / np.array(size) * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    index, cells = cell[:, 1] * _CELLS[0] + cell[:, 0], _CELLS[0] * _CELLS[1]
    count = np.bincount(index, minlength=cells)
    sums = np.stack([np.bincount(index, off_px[:, k], cells) for k in range(2)], axis=1)
    used = (count >= _LEAST_FEATURES)[_NEIGHBOURS].all(axis=0)
    if used.sum() < _LEAST_PAIRS:
        return None
    one, other = (sums / np.maximum(count, 1)[:, None])[_NEIGHBOURS[:, used]]
    product = one.T @ other / used.sum()
    return np.asarray((product + product.T) / 2)
