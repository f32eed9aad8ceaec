"""Hot and dead pixels: single pixels that differ from all around them, which no lens can draw.

They stand still whatever the camera sees. In a dim scene they are most of the texture, and would pass for ground.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, Gray

_LEAST_STEP = 30  # grey levels between the pixel and the nearest of its neighbours
_LEAST_SHARE = 3e-4  # of the pixels, in a camera that has them; of a scene at most a fifth of that
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)


def has_hot_pixels(gray: Gray) -> bool:
    """Whether a picture, (h, w) uint8, has so many that the camera must have made them."""
    return float(_hot(gray).mean()) >= _LEAST_SHARE


def without_hot_pixels(gray: Gray) -> Gray:
    """The picture, (h, w) uint8, with the median of 3x3 in place of each hot or dead pixel."""
    return np.asarray(np.where(_hot(gray), cv2.medianBlur(gray, 3), gray))


def _hot(gray: Gray) -> BoolArray:
    """(h, w) bool: beyond all eight neighbours by more than those differ among themselves."""
    highest, lowest = cv2.dilate(gray, _RING), cv2.erode(gray, _RING)
    step = np.maximum(cv2.subtract(gray, highest), cv2.subtract(lowest, gray))  # 0 between the two
    return np.asarray((step >= _LEAST_STEP) & (step > cv2.subtract(highest, lowest)))
