"""Detection of verification points on moving objects or water, over several frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.types import BoolArray, FloatArray, IdArray

_TOLERANCE_PX, _TOLERANCE_SHARE = 0.5, 0.05  # inlier threshold: constant, and share of the median displacement
_MIN_POINTS = 4  # two points always agree on a similarity
_MAX_SAMPLES = 300
_MIN_VOTES, _SHARE = 2, 0.25  # a point is not static from so many frames and this share of the frames on


class StaticPoints:
    """Classifies P points as static or moving by votes over the frames.

    Whatever the residual camera motion, the displacements of ground points follow one similarity, which most points
    agree on. A point that does not follow it, or is not found, gets a vote for moving.
    """

    def __init__(self, centres_px: IdArray) -> None:
        """centres_px: (P, 2) positions of the points, px."""
        self._positions = _complex(centres_px)
        self._seen = np.zeros(len(centres_px), np.int64)
        self._moved = np.zeros(len(centres_px), np.int64)

    @property
    def static(self) -> BoolArray:
        """(P,) bool: points that moved in less than a quarter of the frames, or only once in several."""
        least = np.minimum(_MIN_VOTES, np.maximum(self._seen, 1))
        return np.asarray((self._moved < least) | (self._moved < _SHARE * self._seen))

    def vote(self, shifts_px: FloatArray, usable: BoolArray) -> None:
        """Adds the votes of one frame.

        Args:
            shifts_px: (P, 2) displacements, NaN where a point was not found.
            usable: (P,) bool, points that could be measured.
        """
        found = usable & np.isfinite(shifts_px).all(axis=1)
        if found.sum() < max(_MIN_POINTS, usable.sum() / 2):
            return
        shifts = _complex(shifts_px[found])
        tolerance_px = _TOLERANCE_PX + _TOLERANCE_SHARE * float(np.median(np.abs(shifts)))
        residual_px = np.full(len(found), np.inf)
        residual_px[found] = _similarity_residuals_px(self._positions[found], shifts, tolerance_px)
        self._seen += usable
        self._moved += usable & (residual_px > tolerance_px)


def _complex(points: FloatArray | IdArray) -> NDArray[np.complex128]:
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def _similarity_residuals_px(positions: NDArray[np.complex128], shifts: NDArray[np.complex128],
                       tolerance_px: float) -> FloatArray:
    """Residuals (n,) of the displacements from the similarity through two points with the smallest MSAC loss."""
    one, other = _pairs(len(positions))
    rotation_scale = (shifts[one] - shifts[other]) / (positions[one] - positions[other])
    residual_px = np.abs(shifts[one, None] + rotation_scale[:, None] * (positions - positions[one, None]) - shifts)
    return np.asarray(residual_px[np.minimum(residual_px**2, tolerance_px**2).sum(axis=1).argmin()])


def _pairs(count: int) -> tuple[IdArray, IdArray]:
    """All pairs, or an evenly spaced subset if there are many."""
    one, other = np.triu_indices(count, 1)
    every = -(-len(one) // _MAX_SAMPLES)
    return one[::every], other[::every]
