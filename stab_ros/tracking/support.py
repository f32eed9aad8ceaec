"""How much of the ground agrees with a homography: the evidence by which it is accepted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray

_CELLS = (8, 6)  # across and down
_LEAST_IN_CELL = 4.0
_LEAST_SOLID = 24.0  # over wrong homographies it is 9 at most
_ENOUGH, _HALF = 16.0, 0.5
_SOLID = 0.5  # of the weight in a cell, and of that of all inliers


@dataclass(frozen=True)
class Support:
    """The weight of features.

    agreeing: of the inliers. expected: of those that should be. solid: of the inliers around which most others are so.
    """

    agreeing: float
    expected: float
    solid: float

    @property
    def share(self) -> float:
        """Of the expected features, in [0, 1]."""
        return self.agreeing / max(self.expected, 1.0)

    @property
    def is_enough(self) -> bool:
        """Whether so many agree that it is not by chance; of a few, half."""
        return self.agreeing >= min(_ENOUGH, _HALF * self.expected)

    @property
    def is_solid(self) -> bool:
        """Whether part of the picture agrees so well that the rest need not: small ground among much water."""
        return self.solid >= max(_LEAST_SOLID, _SOLID * self.agreeing)


def support_of(places_px: FloatArray, weight: FloatArray, agrees: BoolArray, size: tuple[int, int],
               expected: float | None = None) -> Support:
    """The support by N features that lie in view.

    places_px: (N, 2) in an image of `size` (width, height). weight: (N,) trust. agrees: (N,) bool, the inliers.
    expected: see `Support`; None: all of them.
    """
    cell = (places_px / np.array(size) * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    index, cells = cell[:, 1] * _CELLS[0] + cell[:, 0], _CELLS[0] * _CELLS[1]
    total = np.bincount(index, weight, cells)
    agreeing = np.bincount(index, weight * agrees, cells)
    solid = (total >= _LEAST_IN_CELL) & (agreeing >= _SOLID * total)
    return Support(float(agreeing.sum()), float(total.sum()) if expected is None else expected,
                   float(agreeing[solid].sum()))
