"""A rough look at the whole picture, for when a frame is not where it was expected: how far has it jumped?"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import level_scale, normalized
from stab_ros.core.types import Gray, Homography, Image

_WIDTH_PX = 240  # of the small pictures, at most twice that


class Overview:
    """Shifts found by phase correlation (Kuglin and Hines 1975) of small pictures; no rotation, no scale."""

    def __init__(self, reference: Gray) -> None:
        """reference: (h, w) uint8."""
        self._level = max(0, int(np.log2(max(1.0, reference.shape[1] / _WIDTH_PX))))
        self._small = self._shrunk(reference)
        self._window = cv2.createHanningWindow(self._small.shape[::-1], cv2.CV_32F)

    def corrected(self, current: Gray, guess: Homography) -> Homography:
        """`guess` (ref_H_cur) with the shift that brings `current`, (h, w) uint8, best onto the reference."""
        scale = level_scale(self._level)
        small_guess = normalized(scale @ guess @ np.linalg.inv(scale))
        warped = cv2.warpPerspective(self._shrunk(current), small_guess, self._small.shape[::-1],
                                     borderMode=cv2.BORDER_REFLECT)
        shift, _ = cv2.phaseCorrelate(self._small, warped, self._window)
        back = np.array([[1.0, 0.0, -shift[0]], [0.0, 1.0, -shift[1]], [0.0, 0.0, 1.0]])
        return normalized(np.linalg.inv(scale) @ back @ small_guess @ scale)

    def _shrunk(self, gray: Gray) -> Image:
        """float32, zero mean; an incomplete last row or column of blocks is left out, so that `level_scale` holds."""
        block = 2**self._level
        height, width = gray.shape[0] // block, gray.shape[1] // block
        small = cv2.resize(gray[: height * block, : width * block], (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float32) - np.float32(small.mean())
