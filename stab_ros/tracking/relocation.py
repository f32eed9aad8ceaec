"""Relocalisation: where a frame lies without a prediction, as one that is rotated, far off, or seen after a loss.

The method `sift` on reduced images, and a similarity on which enough of its matches on static ground agree. It is an
initial guess: the chosen method measures there, and the acceptance test decides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography
from stab_ros.methods.sift import Sift, SiftConfig
from stab_ros.tracking import agreement

_WIDTH_PX = 480  # of the reduced images, at most twice that
_SIFT = SiftConfig(features=1000, contrast=0.02)
_THRESHOLD_PX = 3.0  # of the reduced images

OnGround = Callable[[FloatArray], BoolArray]  # which of (N, 2) points lie on static ground: (N,) bool


class Relocation:
    """Finds frames in one anchor frame."""

    def __init__(self, anchor: Gray) -> None:
        """anchor: (h, w) uint8, the anchor frame."""
        self._shrinking = Downscaling.to_width(anchor, _WIDTH_PX)
        small = self._shrinking.picture(anchor)
        self._shape = small.shape
        self._sift = Sift(small, np.ones(small.shape, bool), _SIFT)

    def find(self, current: Gray, on_ground: OnGround) -> Homography | None:
        """anchor_H_cur of a frame, (h, w) uint8, roughly; None where too little of it agrees on one.

        on_ground: of points in the anchor frame.
        """
        pairs = self._sift.match(self._shrinking.picture(current), np.eye(3), np.ones(len(self._sift.reference_px)))
        pairs = pairs[on_ground(apply(np.linalg.inv(self._shrinking.scale), pairs.reference_px))]
        height, width = self._shape
        small_H = agreement.motion(pairs.current_px, pairs.reference_px, _THRESHOLD_PX, width * height)
        return None if small_H is None else self._shrinking.whole(small_H)


def everywhere(points_px: FloatArray) -> BoolArray:
    """Where it is not known what is ground: all (N, 2) points are."""
    return np.ones(len(points_px), bool)
