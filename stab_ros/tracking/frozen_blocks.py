"""Blocks that a video codec has copied from an earlier frame: they show where the ground was, not where it is.

Where little changes, H.264 skips a block and a GIF leaves it out. Its pixels then equal those of the reference, or of
the frame before, more often than noise allows. Such a block agrees perfectly with a camera that stands still.

Such blocks are no better than new ones, so they count no more than those. Where the new ones by themselves say
something else, the picture shows two positions at once, and the uncertainty spans both (`registration`). Where hardly
any are new, nothing tells how far the camera has moved, and the user is told (`CopiedBlocks`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from stab_ros.core.geometry import inflated
from stab_ros.core.kernels import BOOL, I64, U8, filled, kernel, read
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.estimation.problem import strongest

_RADIUS_PX = 8
_SIDE_PX = 2 * _RADIUS_PX + 1
_ROW_STEP, _SOME = 4, 300
_EQUAL = 0.5  # of the pixels of a block. Noise of one grey level leaves 0.3, of half a level 0.5
_MUCH_COPIED = 0.6  # of the tracked features, over some frames
_RECENT_FRAMES, _LEAST_FRAMES = 48, 12
_MOST_LAG_PX = 0.2  # a larger displacement changes a block so much that it is sent anew
_FORGETS = 8  # a tenth that is new more than halves the time
_LEAST_STEPS, _STEP_RATE = 3, 0.05
_REPEATED = 0.98  # a picture that is sent twice, or one without any noise


class FrozenBlocks:
    """Compares the surroundings of N features with the reference and with the frame before."""

    def __init__(self, reference: Gray, features_px: FloatArray) -> None:
        """reference: (h, w) uint8. features_px: (N, 2)."""
        self._shape = reference.shape
        self._corners = self._corners_of(features_px)
        self._reference = _windows(reference, self._corners)
        self._last_corners, self._last = self._corners, self._reference

    def find(self, gray: Gray) -> BoolArray:
        """(N,) bool: the features whose surroundings in a frame, (h, w) uint8, are copied.

        None, where not one of some 300 is: then no codec copies.
        """
        found = np.zeros(len(self._corners), bool)
        some = np.arange(0, len(found), max(1, len(found) // _SOME))
        if self._marked(gray, some, found).any():
            self._marked(gray, np.arange(len(found)), found)
        return found

    def _marked(self, gray: Gray, which: IdArray, found: BoolArray) -> BoolArray:
        """(N,) bool: `found`, with those of `which` (n,) marked that are copied."""
        _mark_equal(gray, which, self._corners, _ROW_STEP, self._reference, found)
        if self._last is not self._reference:
            _mark_equal(gray, which, self._last_corners, _ROW_STEP, self._last, found)
        return found

    def remember(self, gray: Gray, at_px: FloatArray) -> None:
        """The frame, (h, w) uint8, is the one before the next, with the features at (N, 2) px."""
        self._last_corners = self._corners_of(at_px)
        self._last = _windows(gray, self._last_corners)

    def _corners_of(self, at_px: FloatArray) -> IdArray:
        most = np.array(self._shape[::-1]) - _SIDE_PX
        return np.clip(np.round(at_px - _RADIUS_PX), 0, most).astype(np.int64)


class CopiedBlocks:
    """How much of what is tracked the codec has copied, and how far that lags behind."""

    def __init__(self) -> None:
        self._recent: deque[float] = deque(maxlen=_RECENT_FRAMES)
        self._most = self._share = 0.0
        self._held = 0.0  # frames since most was new
        self._steps, self._step_px2 = 0, 0.0  # from frame to frame: their number and mean square

    @property
    def much(self) -> float | None:
        """Share of the features, in [0, 1], the most over some frames, if it is so much that the user must know."""
        return self._most if self._most > _MUCH_COPIED else None

    def add(self, frozen: BoolArray, trust: FloatArray) -> None:
        """Takes a registered frame: which of its features, (N,) bool, are copied, and their weights (N,)."""
        self._share = float(trust[frozen].sum() / max(trust.sum(), 1e-9))
        self._held = self._share**_FORGETS * (self._held + 1)
        if self._share < _REPEATED:
            self._recent.append(self._share)
        if len(self._recent) >= _LEAST_FRAMES:
            self._most = max(self._most, self._usual)

    def moved(self, step_px: float) -> None:
        """The frame lies so far from the one before it, which tells nothing where all was copied."""
        if self._share < _REPEATED:
            self._steps += 1
            self._step_px2 += max(_STEP_RATE, 1 / self._steps) * (step_px**2 - self._step_px2)

    def covariance(self, covariance: FloatArray, ref_H_cur: Homography) -> FloatArray:
        """Covariance (8, 8) of the frame's homography, inflated by how far the ground may have moved on since.

        A copied block shows it where it was a frame ago, or where it was when most of the picture was new.
        """
        lag_px = max(self._share, self._usual) * self._lag_px
        return inflated(covariance, ref_H_cur, np.eye(2) * lag_px**2 / 2)

    @property
    def _usual(self) -> float:
        return float(np.mean(self._recent)) if self._recent else 0.0

    @property
    def _lag_px(self) -> float:
        if self._steps < _LEAST_STEPS:
            return _MOST_LAG_PX
        step_px = float(np.sqrt(self._step_px2))
        return max(min(step_px, _MOST_LAG_PX), step_px * self._held if self._held > 1 else 0.0)


def no_better(pairs: Correspondences, frozen: BoolArray) -> Correspondences:
    """N pairs, of which the frozen ones, (N,) bool, claim no more information than most of the others do."""
    strength = strongest(pairs.information)
    if frozen.all() or not frozen.any():
        return pairs
    most = float(np.median(strength[~frozen]))
    scale = np.where(frozen, np.minimum(1.0, most / np.maximum(strength, 1e-9)), 1.0)
    return replace(pairs, information=pairs.information * scale[:, None, None])


def _windows(gray: Gray, corners: IdArray) -> Gray:
    """(N, rows, s) uint8: every fourth row of the windows with the upper left corners (N, 2)."""
    windows = np.empty((len(corners), len(range(0, _SIDE_PX, _ROW_STEP)), _SIDE_PX), np.uint8)
    _copy(gray, corners, _ROW_STEP, windows)
    return windows


@kernel((read(U8, 2), read(I64, 2), I64, filled(U8, 3)))
def _copy(gray: Gray, corners: IdArray, step: int, windows: Gray) -> None:
    """Fills the windows (N, rows, s) from their corners (N, 2)."""
    _, rows, side = windows.shape
    for i in range(len(corners)):
        x, y = corners[i]
        for row in range(rows):
            windows[i, row] = gray[y + step * row, x : x + side]


@kernel((read(U8, 2), read(I64, 1), read(I64, 2), I64, read(U8, 3), filled(BOOL, 1)))
def _mark_equal(gray: Gray, which: IdArray, corners: IdArray, step: int, windows: Gray, found: BoolArray) -> None:
    """Marks those of the windows `which` (n,) of (N, rows, s) that the frame repeats at their corners (N, 2)."""
    _, rows, side = windows.shape
    least = int(np.ceil(_EQUAL * rows * side))
    for i in which:
        x, y = corners[i]
        equal = 0
        for row in range(rows):
            for column in range(side):
                equal += gray[y + step * row, x + column] == windows[i, row, column]
        if equal >= least:
            found[i] = True
