"""Hot and dead pixels: single pixels that differ from all around them, which no lens can draw.

They stand still whatever the camera sees. In a dim scene they are most of the texture, and would pass for ground.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, Gray, Homography

_LEAST_STEP = 30  # grey levels between the pixel and the nearest of its neighbours
_LEAST_SHARE = 3e-4  # of the pixels, in a camera that has them; of a scene at most a fifth of that
_AROUND_PX = 5  # side of the median: the warp spreads a pixel over two by two
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)


class HotPixels:
    """Those of the camera that has taken a reference. any: whether it has so many that they matter."""

    def __init__(self, reference: Gray) -> None:
        """reference: (h, w) uint8."""
        self._where = _isolated(reference)
        self.any = float(self._where.mean()) >= _LEAST_SHARE

    def removed(self, gray: Gray, fixed_H_ref: Homography | None) -> Gray:
        """A picture, (h, w) uint8, with the median around it in place of each hot or dead pixel.

        fixed_H_ref: (3, 3), from a place in the reference to that in `gray` where the same pixel of the camera is;
            None: unknown, and those that the warp has blurred stay.
        """
        if not self.any:
            return gray
        where = _isolated(gray) if fixed_H_ref is None else self._where_now(fixed_H_ref)
        return np.asarray(np.where(where, cv2.medianBlur(gray, _AROUND_PX), gray))

    def _where_now(self, fixed_H_ref: Homography) -> BoolArray:
        height, width = self._where.shape
        return np.asarray(cv2.warpPerspective(self._where.astype(np.uint8) * 255, fixed_H_ref, (width, height)) > 0)


def _isolated(gray: Gray) -> BoolArray:
    """(h, w) bool: beyond all eight neighbours by more than those differ among themselves."""
    highest, lowest = cv2.dilate(gray, _RING), cv2.erode(gray, _RING)
    step = np.maximum(cv2.subtract(gray, highest), cv2.subtract(lowest, gray))  # 0 between the two
    return np.asarray((step >= _LEAST_STEP) & (step > cv2.subtract(highest, lowest)))
