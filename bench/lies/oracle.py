"""Whether the ground can be found at all: SIFT and MAGSAC++ at full size, on the frame as it is."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import Float32Array, Gray, Homography, IdArray

_FEATURES, _RATIO, _THRESHOLD_PX, _MIN_INLIERS = 6000, 0.8, 1.0, 12


class Oracle:
    """SIFT's view of one reference."""

    def __init__(self, reference: Gray) -> None:
        self._sift = cv2.SIFT.create(nfeatures=_FEATURES)
        self._points, self._descriptors = self._sift.detectAndCompute(reference, None)

    def homography(self, picture: Gray) -> Homography | None:
        """From the picture to the reference; None: too little is found again."""
        points, descriptors = self._sift.detectAndCompute(picture, None)
        if min(len(points), len(self._points)) < _MIN_INLIERS:
            return None
        which, nearest = _matches(descriptors, self._descriptors)
        if len(which) < _MIN_INLIERS:
            return None
        found = np.array([points[k].pt for k in which])
        wanted = np.array([self._points[k].pt for k in nearest])
        H, inlier = cv2.findHomography(found, wanted, cv2.USAC_MAGSAC, _THRESHOLD_PX, maxIters=5000, confidence=0.999)
        return None if H is None or inlier.sum() < _MIN_INLIERS else np.asarray(H)


def _matches(descriptors: Float32Array, others: Float32Array) -> tuple[IdArray, IdArray]:
    """Rows of `descriptors`, and of their nearest in `others`, that pass the ratio test (Lowe 2004)."""
    square = (descriptors**2).sum(1)[:, None] + (others**2).sum(1) - 2 * descriptors @ others.T
    rows, nearest = np.arange(len(square)), square.argmin(1)
    least = square[rows, nearest].copy()
    square[rows, nearest] = np.inf
    good = least < _RATIO**2 * square.min(1)
    return rows[good], nearest[good]
