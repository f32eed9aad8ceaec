"""The usual way in OpenCV: features, descriptors, brute-force matching with the ratio test, robust homography."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography

FEATURES = 4000  # of both; without a limit SIFT finds ten times as many on such pictures and takes minutes to match
_RATIO = 0.75  # Lowe (2004), section 7.1
_THRESHOLD_PX = 1.0
_ITERATIONS, _CONFIDENCE = 5000, 0.9999


@dataclass(frozen=True)
class Recipe:
    """Which features, how their descriptors differ, and which estimator."""

    name: str
    features: Any  # a cv2.Feature2D
    norm: int
    estimator: int


def sift_magsac() -> Recipe:
    """SIFT (Lowe 2004) and MAGSAC++ (Barath 2020), the most exact that OpenCV has."""
    return Recipe("SIFT + MAGSAC++", cv2.SIFT.create(nfeatures=FEATURES), cv2.NORM_L2, cv2.USAC_MAGSAC)


def orb_ransac() -> Recipe:
    """ORB (Rublee 2011) and RANSAC, the fastest of the usual."""
    return Recipe("ORB + RANSAC", cv2.ORB.create(nfeatures=FEATURES), cv2.NORM_HAMMING, cv2.RANSAC)


class Peer:
    """Registers frames to a reference, whose features are found once."""

    def __init__(self, recipe: Recipe, reference: Gray) -> None:
        self._recipe, self._matcher = recipe, cv2.BFMatcher(recipe.norm)
        self._reference_px, self._reference = self._describe(reference)

    def ref_H_cur(self, gray: Gray) -> Homography | None:
        """None where OpenCV finds no homography."""
        return self.homography(*self.matches(gray))[0]

    def matches(self, gray: Gray) -> tuple[FloatArray, FloatArray]:
        """Places (n, 2) in the frame and in the reference, px, of the features that pass the ratio test."""
        current_px, current = self._describe(gray)
        pairs = [pair for pair in self._matcher.knnMatch(current, self._reference, k=2) if len(pair) == 2]
        good = [first for first, second in pairs if first.distance < _RATIO * second.distance]
        source = current_px[[match.queryIdx for match in good]]
        return source, self._reference_px[[match.trainIdx for match in good]]

    def homography(self, source: FloatArray, target: FloatArray) -> tuple[Homography | None, BoolArray]:
        """From source to target, each (n, 2), by the recipe's estimator, and which of them agree, (n,) bool."""
        if len(source) < 4:
            return None, np.zeros(len(source), bool)
        H, inlier = cv2.findHomography(source, target, self._recipe.estimator, _THRESHOLD_PX, maxIters=_ITERATIONS,
                                       confidence=_CONFIDENCE)
        found = np.zeros(len(source), bool) if inlier is None else inlier.ravel().astype(bool)
        return (None if H is None else np.asarray(H, np.float64)), found

    def _describe(self, gray: Gray) -> tuple[FloatArray, Any]:
        """Places (n, 2), px, and descriptors."""
        points, descriptors = self._recipe.features.detectAndCompute(gray, None)
        return np.array([point.pt for point in points], np.float64).reshape(-1, 2), descriptors
