"""Centres of boards in pictures, as a user finds them: a click, refined to the corner of the quadrants."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Gray

BORDER_PX = 14  # least distance from the border of the picture
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


def picked(image: Gray, px: FloatArray) -> FloatArray:
    """The corner (2,) near `px` by OpenCV, in a blurred window of twice the resolution, where it is free of bias."""
    left, top = np.rint(px).astype(int) - 12
    window = cv2.GaussianBlur(image[top:top + 25, left:left + 25].astype(np.float32), (0, 0), 1.0)
    doubled = cv2.resize(window, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    start = 2 * (px - [left, top]) + 0.5
    corner = cv2.cornerSubPix(doubled, start.reshape(1, 1, 2).astype(np.float32), (10, 10), (-1, -1), _CRITERIA)[0, 0]
    return np.asarray((corner - 0.5) / 2 + [left, top])
