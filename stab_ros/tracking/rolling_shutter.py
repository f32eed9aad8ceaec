"""Whether the rows of a stream's frames swing: asked of the last frames together, since one cannot tell.

In a single frame a river across the picture, or a bank above the plane, looks much as rows do that have swung. Over
frames they differ: such a shape grows and shrinks as the camera and the water move, but stays the same shape, while
rows swing in waves whose phase changes from frame to frame.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import inflated
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import FloatArray, Homography
from stab_ros.estimation.rows import RowResiduals, changing_share, independent_share

_FRAMES, _LEAST_FRAMES, _SPARED = 12, 7, 2
_INDEPENDENT = 0.2  # share of the common variance that no single shape explains
_CHANGING = 0.6  # of what unrelated frames would change
_TOLD_FRAMES = 3
_PATIENCE = 100  # frames without swinging rows


@dataclass(frozen=True)
class Swing:
    """frames: number of frames whose rows swung. most_px: the largest displacement of a row in any of them."""

    frames: int
    most_px: float


class RollingShutter:
    """Of one reference, fed with every registered frame."""

    def __init__(self) -> None:
        self._last: deque[RowResiduals] = deque(maxlen=_FRAMES)
        self._left = 0  # frames for which rows are still sought
        self._swing = Swing(0, 0.0)

    @property
    def known(self) -> bool:
        """Whether the rows of this stream swing, so that they are sought in every frame that shows something."""
        return self._left > 0

    @property
    def swing(self) -> Swing | None:
        """What has been seen so far, if it is enough to be told."""
        return self._swing if self._swing.frames >= _TOLD_FRAMES else None

    def found(self) -> None:
        """The rows of the last frames swing, or those of the start-up do."""
        self._left = _PATIENCE

    def add(self, residuals: RowResiduals, rows: RowShifts | None) -> None:
        """Takes a registered frame: its residuals by the homography alone, and the displacements, if any."""
        self._last.append(residuals)
        self._left = max(0, self._left - 1)
        if rows is not None:
            self._swing = Swing(self._swing.frames + 1, max(self._swing.most_px, rows.most_px))
        if self._swings():
            self.found()

    def covariance(self, covariance: FloatArray, ref_H_cur: Homography, rows: RowShifts | None) -> FloatArray:
        """Covariance (8, 8) of the last frame's homography, inflated by what it leaves of the rows.

        Where rows swing but those of this frame were not confirmed, as they look alike in the reference, that is what
        both halves of its features share.
        """
        if rows is not None or self.swing is None or not self.known:
            return with_rows(covariance, ref_H_cur, rows)
        return inflated(covariance, ref_H_cur, np.eye(2) * max(self._last[-1].shared, 0.0))

    def _swings(self) -> bool:
        """Whether the last frames show waves, even without the largest: homographies that are off show some too."""
        if sum(residuals.show for residuals in self._last) < _LEAST_FRAMES or not self._last[-1].show:
            return False
        one, other = np.stack([residuals.halves for residuals in self._last], axis=1)
        rest = np.sort(np.argsort([residuals.shared for residuals in self._last])[:-_SPARED])
        return _wave(one, other) and _wave(one[rest], other[rest])


def _wave(one: FloatArray, other: FloatArray) -> bool:
    """Whether two measurements (F, bands, 2) of curves show more than one shape, and change from frame to frame."""
    return independent_share(one, other) > _INDEPENDENT and changing_share(one, other) > _CHANGING


def with_rows(covariance: FloatArray, ref_H_cur: Homography, rows: RowShifts | None) -> FloatArray:
    """Covariance (8, 8) of a homography, inflated by what it leaves of the rows: one sigma is their RMS."""
    return covariance if rows is None else inflated(covariance, ref_H_cur, rows.values.T @ rows.values / rows.height)
