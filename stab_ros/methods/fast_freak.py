"""FAST corners (Rosten and Drummond 2006), described by FREAK (Alahi et al. 2012) and matched by Hamming distance.

The features of VISION (Ljubicic et al. 2021, section 2.2), with the parameters of MATLAB: the minimum contrast is a
share of the grey scale, the minimum quality a share of the strongest corner's response, a uniformly distributed share
of the corners is used, and a match differs in few of its 512 bits. MATLAB's corners lie at integer positions; here they
are refined unless `subpixel` is off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray, IdArray
from stab_ros.methods._descriptors import DescriptorMethod, Features, MatchRule, contrib, spread_evenly, within

_BITS = 512
_GREY_LEVELS = 255
_CORNER_PX = 7.0  # diameter of a FAST corner
_CONTRAST_PX = (1.2, 2.4)  # standard deviations of the difference of Gaussians
_STEPS = 3
_MAX_SHIFT_PX = 3.0  # corners that the refinement moves further are dropped
# standard deviations of refined and of integer positions, calibrated against ground truth of synthetic flights
_SIGMA_PX, _WHOLE_SIGMA_PX = 0.12, 0.22


@dataclass(frozen=True)
class FastFreakConfig(Checked):
    """Parameters `fast_freak.*`."""

    intensity: float = setting(0.06, "Minimum contrast of a corner, as a share of the grey scale", 0.004, 1.0)
    quality: float = setting(0.1, "Minimum response of a corner, as a share of the strongest corner's", 0.0, 1.0)
    uniform: float = setting(1.0, "Share of the reference's corners to use, spread evenly", 0.01, 1.0)
    features: int = setting(5000, "Maximum number of corners per image, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "Ratio test: maximum ratio of the nearest to the second nearest descriptor distance",
                           0.1, 1.0)
    max_distance: float = setting(0.2, "Maximum Hamming distance of a match, as a share of the descriptor's bits",
                                  0.01, 1.0)
    subpixel: bool = setting(True, "Refine the corners to sub-pixel positions")


class FastFreak(DescriptorMethod):
    """`stab_ros.methods.Method` by FAST and FREAK."""

    Config: ClassVar[type[Any]] = FastFreakConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: FastFreakConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Detects the corners of the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where corners may lie.
            config: parameters.
            points_px: not used.

        Raises:
            InputError: this OpenCV has no FREAK.
        """
        self._config = config
        self._fast = cv2.FastFeatureDetector.create(max(1, round(config.intensity * _GREY_LEVELS)))
        self._freak = contrib("FREAK_create")()
        rule = MatchRule(config.ratio, cv2.NORM_HAMMING, config.max_distance * _BITS)
        features = within(self._detect(reference, config.uniform), allowed)
        super().__init__(features, self._detect, rule)

    def _detect(self, gray: Gray, share: float = 1.0) -> Features:
        """Features of an evenly spread `share` of the corners.

        All corners of a frame are used: if reference and frame each kept a half, only a quarter would be in both.
        """
        corners = self._corners(gray, share)
        px = _refined(gray, corners) if self._config.subpixel else corners
        points = [cv2.KeyPoint(x, y, _CORNER_PX, -1, 0, 0, k) for k, (x, y) in enumerate(px.tolist())]
        kept, descriptor = self._freak.compute(gray, points)  # without those too close to the border
        if not kept:
            return Features(np.empty((0, 2)), np.empty(0), np.empty((0, _BITS // 8), np.uint8))
        sigma_px = _SIGMA_PX if self._config.subpixel else _WHOLE_SIGMA_PX
        return Features(px[[point.class_id for point in kept]], np.full(len(kept), sigma_px), descriptor)

    def _corners(self, gray: Gray, share: float) -> FloatArray:
        """Corners (n, 2) at integer positions, px."""
        corners = self._fast.detect(gray)
        px = np.array([corner.pt for corner in corners]).reshape(-1, 2)
        response = np.array([corner.response for corner in corners])
        good = response >= self._config.quality * response.max(initial=0)
        px, response = px[good], response[good]
        count = min(self._config.features, round(share * len(px)))
        return np.asarray(px[spread_evenly(px, response, max(1, count), gray.shape)])


def _refined(gray: Gray, corners: FloatArray) -> FloatArray:
    """Sub-pixel extrema of the difference of Gaussians near the corners: (n, 2), px, without duplicates.

    FAST compares a pixel with the ring around it. The difference of Gaussians is a smooth form of that contrast and
    has an extremum at a corner. Corners without an extremum nearby are dropped: positions that stay at whole pixels
    would bias the motion towards whole pixels.
    """
    blurred = [cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma) for sigma in _CONTRAST_PX]
    contrast = blurred[0] - blurred[1]
    column, row = corners.astype(np.int64).T
    sign = np.where(contrast[row, column] < 0, -1.0, 1.0)
    row, column = _hill_climb(contrast, sign, row, column)
    about = sign[:, None, None] * _neighbours(contrast, row, column)
    px = np.stack([column + _parabola_vertex(about[:, 1, :]), row + _parabola_vertex(about[:, :, 1])], axis=1)
    near = (np.abs(px - corners) <= _MAX_SHIFT_PX).all(axis=1)
    extremum = about[:, 1, 1] >= about.max(axis=(1, 2), initial=-np.inf)
    return np.unique(px[near & extremum], axis=0)


def _hill_climb(contrast: FloatArray, sign: FloatArray, row: IdArray, column: IdArray) -> tuple[IdArray, IdArray]:
    """Rows and columns after a few steps to the neighbour of largest contrast, at least one px from the border."""
    most = np.array(contrast.shape) - 2
    for _ in range(_STEPS):
        best = (sign[:, None] * _neighbours(contrast, row, column).reshape(-1, 9)).argmax(axis=1)
        row = np.clip(row + best // 3 - 1, 1, most[0])
        column = np.clip(column + best % 3 - 1, 1, most[1])
    return row, column


def _neighbours(image: FloatArray, row: IdArray, column: IdArray) -> FloatArray:
    """Values (n, 3, 3) around each pixel."""
    span = np.arange(-1, 2)
    return np.asarray(image[row[:, None, None] + span[:, None], column[:, None, None] + span])


def _parabola_vertex(three: FloatArray) -> FloatArray:
    """Offset of the vertex of the parabola through each row of (n, 3) from the middle value, px; 0 where it is flat."""
    curvature = 2 * three[:, 1] - three[:, 0] - three[:, 2]
    return np.asarray((three[:, 2] - three[:, 0]) / np.where(curvature > 0, 2 * curvature, np.inf))
