"""The shift of a frame that is not where it was predicted, by phase correlation of reduced images."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import shift
from stab_ros.core.types import Gray, Homography, Image

_WIDTH_PX = 240  # of the reduced images, at most twice that
_LEAST_RESPONSE = 0.03  # share of the correlation within 5x5 px of its peak


class PhaseCorrelation:
    """Shifts found by phase correlation (Kuglin and Hines 1975) of reduced images; no rotation, no scale."""

    def __init__(self, reference: Gray) -> None:
        """reference: (h, w) uint8."""
        self._shrinking = Downscaling.to_width(reference, _WIDTH_PX)
        self._small = self._shrunk(reference)
        self._window = cv2.createHanningWindow(self._small.shape[::-1], cv2.CV_32F)

    def corrected(self, current: Gray, guess: Homography) -> Homography | None:
        """`guess` (ref_H_cur) with the shift that brings `current`, (h, w) uint8, best onto the reference.

        None where the correlation has no clear peak.
        """
        small_guess = self._shrinking.small(guess)
        warped = cv2.warpPerspective(self._shrunk(current), small_guess, self._small.shape[::-1],
                                     borderMode=cv2.BORDER_REFLECT)
        (x, y), response = cv2.phaseCorrelate(self._small, warped, self._window)
        return self._shrinking.whole(shift(-x, -y) @ small_guess) if response >= _LEAST_RESPONSE else None

    def _shrunk(self, gray: Gray) -> Image:
        """float32, zero mean."""
        small = self._shrinking.picture(gray)
        return np.asarray(small, np.float32) - np.float32(small.mean())
