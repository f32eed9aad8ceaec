"""Whether the ground can be found at all: SIFT and MAGSAC++ at full size, on the frame as it is."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import Gray, Homography

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
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors, self._descriptors, 2)
        good = [first for first, second in pairs if first.distance < _RATIO * second.distance]
        if len(good) < _MIN_INLIERS:
            return None
        found = np.array([points[match.queryIdx].pt for match in good])
        wanted = np.array([self._points[match.trainIdx].pt for match in good])
        H, inlier = cv2.findHomography(found, wanted, cv2.USAC_MAGSAC, _THRESHOLD_PX, maxIters=5000, confidence=0.999)
        return None if H is None or inlier.sum() < _MIN_INLIERS else np.asarray(H)
