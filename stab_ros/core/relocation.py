"""Where a frame lies that nothing leads to: turned, far off, or seen again after a loss.

SIFT features (Lowe 2004) of small pictures, matched to those of static ground in a base, and a similarity on which
enough of them agree. It is a place to start from: the method measures there, and the gate judges.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import level_scale, normalized
from stab_ros.core.static_map import StaticMap
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography

_WIDTH_PX = 640  # of the small pictures, at most twice that
_FEATURES = 1500
_RATIO = 0.8  # of the distances to the best match and the next (Lowe 2004, section 7.1)
_THRESHOLD_PX = 3.0  # of the small pictures
_LEAST_AGREEING = 10  # by chance, four to six do
_LEAST_SHARE = 0.1  # of the matches


class Relocation:
    """The features of one base, found when they are first needed."""

    def __init__(self, base: Gray) -> None:
        """base: (h, w) uint8."""
        level = max(0, int(np.log2(max(1.0, base.shape[1] / _WIDTH_PX))))
        self._scale = level_scale(level)
        self._small = _shrunk(base, level)
        self._level = level
        self._features: tuple[FloatArray, FloatArray] | None = None

    def find(self, current: Gray, ground: StaticMap | None) -> Homography | None:
        """base_H_cur of a frame, (h, w) uint8, roughly; None where too little of it agrees on one.

        ground: where static ground is in the base; None: not known.
        """
        at_px, looks = self._of_base()
        if ground is not None:
            static = ground.at(_enlarged(at_px, self._scale)) > 0.5
            at_px, looks = at_px[static], looks[static]
        found_px, found = _features(_shrunk(current, self._level))
        if min(len(looks), len(found)) < _LEAST_AGREEING:
            return None
        ours, theirs = _matched(looks, found)
        H = _similarity(found_px[theirs], at_px[ours])
        return None if H is None else normalized(np.linalg.inv(self._scale) @ H @ self._scale)

    def _of_base(self) -> tuple[FloatArray, FloatArray]:
        if self._features is None:
            self._features = _features(self._small)
        return self._features


def _shrunk(gray: Gray, level: int) -> Gray:
    """2^level px averaged to one; an incomplete last row or column is left out, so that `level_scale` holds."""
    height, width = (n >> level for n in gray.shape)
    whole = gray[: height << level, : width << level]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _enlarged(points_px: FloatArray, scale: Homography) -> FloatArray:
    return np.asarray((points_px - scale[:2, 2]) / scale[0, 0])


def _features(small: Gray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) px and descriptors (n, 128) float32."""
    points, looks = cv2.SIFT.create(nfeatures=_FEATURES).detectAndCompute(small, None)
    places = np.array([point.pt for point in points]).reshape(-1, 2)
    return places, np.empty((0, 128), np.float32) if looks is None else np.asarray(looks)


def _matched(ours: FloatArray, theirs: FloatArray) -> tuple[list[int], list[int]]:
    """Indices of pairs that are clearly nearer than the next best."""
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(ours, theirs, k=2)
    clear = [best for best, after in pairs if best.distance < _RATIO * after.distance]
    return [match.queryIdx for match in clear], [match.trainIdx for match in clear]


def _similarity(from_px: FloatArray, to_px: FloatArray) -> Homography | None:
    """The similarity that most of the (n, 2) points agree on, if enough do."""
    if len(from_px) < _LEAST_AGREEING:
        return None
    affine, agrees = cv2.estimateAffinePartial2D(from_px, to_px, method=cv2.RANSAC, maxIters=2000,
                                                 ransacReprojThreshold=_THRESHOLD_PX)
    if affine is None or _spread_out(to_px, agrees) < max(_LEAST_AGREEING, _LEAST_SHARE * len(from_px)):
        return None
    return np.vstack([affine, [0.0, 0.0, 1.0]])


def _spread_out(points_px: FloatArray, agrees: BoolArray) -> int:
    """How many different px the agreeing points have: SIFT reports one place several times, turned."""
    chosen = np.round(points_px[agrees.ravel().astype(bool)]).astype(int)
    return len(np.unique(chosen, axis=0))
