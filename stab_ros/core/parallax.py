"""Whether what is taken for one plane is none: residuals that neighbours share and that lie along one direction.

A camera that moves sideways sees what stands above the plane move further: the homography then is a compromise. Noise
differs from feature to feature, so the mean over a cell of the picture tells what its features share; a lens bends the
picture to or from its middle, parallax along the way the camera has gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray

_CELLS = (8, 6)  # across and down
_LEAST_FEATURES = 5  # in a cell
_LEAST_CELLS = 8
_FAR_PX = 3.0  # what is off by more is no ground
_RATE = 0.05  # of a frame: the last second counts
_SETTLED = 20  # frames, before anything is said
_WARN_PX, _CALM_PX = 0.1, 0.07
_ONE_WAY = 0.75  # of the squares lie along one direction


@dataclass(frozen=True)
class Relief:
    """px: RMS of what neighbours share. deg: the direction along which, in the reference, 0 right and 90 down."""

    px: float
    deg: float

    def __str__(self) -> str:
        return (f"parallax: parts of the ground are shifted against the rest by {self.px:.2f} px towards "
                f"{self.deg:.0f} or {self.deg + 180:.0f} degrees, as if they were no plane; homographies may "
                "be off by as much, name ground at the height of the water in roi")


class Parallax:
    """Of a reference of `size` (width, height), fed with every accepted fit."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._shared = np.zeros((2, 2))  # px^2
        self._frames = 0
        self._warned = False

    def add(self, pairs: Correspondences, fit: Fit, ground: BoolArray) -> None:
        """ground: (N,) bool, which of the pairs are static ground."""
        off = pairs.reference_px - apply(fit.ref_H_cur, pairs.current_px)
        chosen = ground & (np.abs(off).max(axis=1, initial=0) < _FAR_PX)
        shared = _shared_by_cells(pairs.reference_px[chosen], off[chosen], self._size)
        if shared is None:
            return
        self._frames += 1
        self._shared += max(_RATE, 1 / self._frames) * (shared - self._shared)

    @property
    def relief(self) -> Relief | None:
        """What there is to warn of, with some patience; None: nothing."""
        if self._frames < _SETTLED:
            return None
        values, axes = np.linalg.eigh(self._shared)
        px = math.sqrt(max(values[1], 0.0))
        one_way = values[1] > _ONE_WAY * max(np.abs(values).sum(), 1e-12)
        self._warned = bool(one_way and px > (_CALM_PX if self._warned else _WARN_PX))
        deg = math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180
        return Relief(px, deg) if self._warned else None


def _shared_by_cells(places_px: FloatArray, off_px: FloatArray, size: tuple[int, int]) -> FloatArray | None:
    """(2, 2) mean square of what the features of a cell are off by together, px^2, without the share of noise."""
    cell = (places_px / np.array(size) * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    index, cells = cell[:, 1] * _CELLS[0] + cell[:, 0], _CELLS[0] * _CELLS[1]
    count = np.bincount(index, minlength=cells)
    used = count >= _LEAST_FEATURES
    if used.sum() < _LEAST_CELLS:
        return None
    n = np.maximum(count, 1)
    mean = np.stack([np.bincount(index, off_px[:, k], cells) / n for k in range(2)], axis=1)
    rest = off_px - mean[index]
    noise = np.stack([[np.bincount(index, rest[:, a] * rest[:, b], cells) for a in range(2)] for b in range(2)])
    noise = noise[:, :, used] / ((n - 1) * n)[used]  # of each mean
    return np.asarray((mean[used].T @ mean[used]) / used.sum() - noise.mean(axis=2))
