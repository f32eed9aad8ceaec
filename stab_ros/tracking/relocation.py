"""Relocalisation: where a frame lies without a prediction, as one that is rotated, far off, or seen after a loss.

The method `sift` on reduced images, and a similarity on which enough of its matches on static ground agree. It is an
initial guess: the chosen method measures there, and the acceptance test decides.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import apply
from stab_ros.core.types import Correspondences, Gray, Homography
from stab_ros.methods.sift import Sift, SiftConfig
from stab_ros.tracking.static_map import StaticMap

_WIDTH_PX = 640  # of the reduced images, at most twice that
_SIFT = SiftConfig(features=1500)
_THRESHOLD_PX = 3.0  # of the reduced images
_LEAST_AGREEING = 10  # by chance, four to six do
_LEAST_SHARE = 0.1  # of the matches


class Relocation:
    """Finds frames in one anchor frame."""

    def __init__(self, anchor: Gray) -> None:
        """anchor: (h, w) uint8, the anchor frame."""
        self._shrinking = Downscaling.to_width(anchor, _WIDTH_PX)
        small = self._shrinking.picture(anchor)
        self._sift = Sift(small, np.ones(small.shape, bool), _SIFT)

    def find(self, current: Gray, ground: StaticMap | None) -> Homography | None:
        """anchor_H_cur of a frame, (h, w) uint8, roughly; None where too little of it agrees on one.

        ground: where static ground is in the anchor frame; None: not known.
        """
        pairs = self._sift.match(self._shrinking.picture(current), np.eye(3), np.ones(len(self._sift.reference_px)))
        if ground is not None:
            pairs = pairs[ground.at(apply(np.linalg.inv(self._shrinking.scale), pairs.reference_px)) > 0.5]
        small_H = _similarity(pairs)
        return None if small_H is None else self._shrinking.whole(small_H)


def _similarity(pairs: Correspondences) -> Homography | None:
    """The similarity that most of the matches agree on, if enough do."""
    if len(pairs) < _LEAST_AGREEING:
        return None
    affine, agrees = cv2.estimateAffinePartial2D(pairs.current_px, pairs.reference_px, method=cv2.RANSAC, maxIters=2000,
                                                 ransacReprojThreshold=_THRESHOLD_PX)
    if affine is None or agrees.sum() < max(_LEAST_AGREEING, _LEAST_SHARE * len(pairs)):
        return None
    return np.vstack([affine, [0.0, 0.0, 1.0]])
