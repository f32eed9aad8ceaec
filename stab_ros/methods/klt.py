"""Shi-Tomasi corners followed by the pyramidal Lucas-Kanade tracker, checked there and back.

The tracker of KLT-IV (Perks 2020, section 2.1) in OpenCV's implementation (Bouguet 2001), run from the reference
straight to the current frame with the predicted homography as the start, so that no drift accumulates. The corners are
spread evenly: ranked over the whole picture, most would lie where the texture is strongest, which may be the water.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.config import Checked, setting
from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import _patches

_SIGMA_PX = 0.1  # of one tracked corner; measured on synthetic scenes with 2 grey levels of noise


@dataclass(frozen=True)
class KltConfig(Checked):
    """Parameters `klt.*`."""

    corners: int = setting(1000, "number of corners to follow, spread evenly", 8, 10000)
    min_texture: float = setting(0.5, "least mean squared gradient of a window, grey levels^2 per px^2", 0.01, 1e4)
    block: int = setting(21, "side of the window that is followed, px", 5, 101)
    levels: int = setting(5, "pyramid levels", 1, 8)
    max_bidirectional: float = setting(0.5, "a corner that misses itself there and back by more is dropped, px",
                                       0.01, 10.0)


class Klt:
    """`stab_ros.methods.Method` by corners and optical flow."""

    Config: ClassVar[type[Any]] = KltConfig
    takes_points: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: KltConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where corners may lie. points_px: (n, 2), or none."""
        self._config, self._reference = config, reference
        radius = config.block // 2
        if len(points_px):
            within = inside(points_px - radius, (reference.shape[1] - 2 * radius, reference.shape[0] - 2 * radius))
            self._corners = points_px[within].astype(np.float32)
        else:
            centres = _patches.choose(reference, allowed, config.corners, radius, config.min_texture)
            self._corners = centres.astype(np.float32)

    @property
    def reference_px(self) -> FloatArray:
        return self._corners.astype(np.float64)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        if not len(self._corners):
            return self._pairs(np.zeros(0, np.int64), np.zeros((0, 2)))
        start = apply(np.linalg.inv(guess), self.reference_px).astype(np.float32)
        forward, seen = self._flow(self._reference, current, self._corners, start)
        backward, seen_again = self._flow(current, self._reference, forward, self._corners)
        error = np.abs(backward - self._corners).max(axis=1)
        kept = np.flatnonzero(seen & seen_again & (error <= self._config.max_bidirectional))
        return self._pairs(kept, forward[kept].astype(np.float64))

    def _flow(self, first: Gray, second: Gray, points: FloatArray, start: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Where `points` of the first picture are in the second, and which of them were found."""
        block, levels = self._config.block, self._config.levels
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.005)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(first, second, points, start.copy(), winSize=(block, block),
                                                    maxLevel=levels - 1, criteria=criteria,
                                                    flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        return moved, status.ravel().astype(bool)

    def _pairs(self, kept: IdArray, current_px: FloatArray) -> Correspondences:
        information = np.tile(np.eye(2) / _SIGMA_PX**2, (len(kept), 1, 1))
        return Correspondences(kept, self.reference_px[kept], current_px, information)
