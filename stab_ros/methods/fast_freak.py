"""FAST corners (Rosten and Drummond 2006), described by FREAK (Alahi et al. 2012) and matched by Hamming distance.

The features of VISION (Ljubicic et al. 2021, section 2.2), which are those of MATLAB: a corner's contrast and quality
are shares of the grey scale and of the strongest corner, an even share of the corners is used, and a match differs in
few of its 512 bits. MATLAB's corners lie at whole px; here they are refined unless `subpixel` is off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray, IdArray
from stab_ros.methods._descriptors import DescriptorMethod, Features, Rule, contrib, spread, within

_BITS = 512
_GREY_LEVELS = 255
_CORNER_PX = 7.0  # size of a FAST corner
_CONTRAST_PX = (1.2, 2.4)  # blur of centre and of surroundings
_STEPS = 3
_FARTHEST_PX = 3.0  # a corner that the refinement moves further is none
_SIGMA_PX, _WHOLE_SIGMA_PX = 0.12, 0.22  # of a refined and of a whole place; against the truth of synthetic flights


@dataclass(frozen=True)
class FastFreakConfig(Checked):
    """Parameters `fast_freak.*`."""

    intensity: float = setting(0.06, "least contrast of a corner, share of the grey scale", 0.004, 1.0)
    quality: float = setting(0.1, "least response of a corner, share of the strongest corner's", 0.0, 1.0)
    uniform: float = setting(1.0, "share of the reference's corners that is used, spread evenly", 0.01, 1.0)
    features: int = setting(5000, "most corners of a picture, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "a match is nearer than this times the second nearest descriptor", 0.1, 1.0)
    max_distance: float = setting(0.2, "largest share of a descriptor's bits in which a match differs", 0.01, 1.0)
    subpixel: bool = setting(True, "refine the corners, which FAST finds at whole px")


class FastFreak(DescriptorMethod):
    """`stab_ros.methods.Method` by FAST and FREAK."""

    Config: ClassVar[type[Any]] = FastFreakConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: FastFreakConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where corners may lie. It takes no `points_px`.

        Raises:
            InputError: this OpenCV has no FREAK.
        """
        self._config = config
        self._fast = cv2.FastFeatureDetector.create(max(1, round(config.intensity * _GREY_LEVELS)))
        self._freak = contrib("FREAK_create")()
        rule = Rule(config.ratio, cv2.NORM_HAMMING, config.max_distance * _BITS)
        features = within(self._found(reference, config.uniform), allowed)
        super().__init__(features, self._found, rule)

    def _found(self, gray: Gray, share: float = 1.0) -> Features:
        """An even `share` of the corners. In a frame, all: of two halves, only a quarter of the corners is in both."""
        corners = self._corners(gray, share)
        px = _refined(gray, corners) if self._config.subpixel else corners
        points = [cv2.KeyPoint(x, y, _CORNER_PX, -1, 0, 0, k) for k, (x, y) in enumerate(px.tolist())]
        kept, descriptor = self._freak.compute(gray, points)  # without those too close to the border
        if not kept:
            return Features(np.empty((0, 2)), np.empty(0), np.empty((0, _BITS // 8), np.uint8))
        sigma_px = _SIGMA_PX if self._config.subpixel else _WHOLE_SIGMA_PX
        return Features(px[[point.class_id for point in kept]], np.full(len(kept), sigma_px), descriptor)

    def _corners(self, gray: Gray, share: float) -> FloatArray:
        """(n, 2), whole px."""
        corners = self._fast.detect(gray)
        px = np.array([corner.pt for corner in corners]).reshape(-1, 2)
        response = np.array([corner.response for corner in corners])
        good = response >= self._config.quality * response.max(initial=0)
        px, response = px[good], response[good]
        count = min(self._config.features, round(share * len(px)))
        return np.asarray(px[spread(px, response, max(1, count), gray.shape)])


def _refined(gray: Gray, corners: FloatArray) -> FloatArray:
    """The extrema of the contrast of centre to surroundings next to the corners: (n, 2), each once.

    FAST compares a pixel with the ring about it, and that contrast has its extremum at a corner; the differences of
    Gaussians are a smooth form of it. Corners without an extremum near by are left out: what stays at whole px agrees
    with all else that does, and draws the camera there.
    """
    blurred = [cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma) for sigma in _CONTRAST_PX]
    contrast = blurred[0] - blurred[1]
    column, row = corners.astype(np.int64).T
    sign = np.where(contrast[row, column] < 0, -1.0, 1.0)
    row, column = _climbed(contrast, sign, row, column)
    about = sign[:, None, None] * _neighbours(contrast, row, column)
    px = np.stack([column + _peak(about[:, 1, :]), row + _peak(about[:, :, 1])], axis=1)
    near = (np.abs(px - corners) <= _FARTHEST_PX).all(axis=1)
    extremum = about[:, 1, 1] >= about.max(axis=(1, 2), initial=-np.inf)
    return np.unique(px[near & extremum], axis=0)


def _climbed(contrast: FloatArray, sign: FloatArray, row: IdArray, column: IdArray) -> tuple[IdArray, IdArray]:
    """The pixels that a few steps to the most marked neighbour lead to, clear of the border."""
    most = np.array(contrast.shape) - 2
    for _ in range(_STEPS):
        best = (sign[:, None] * _neighbours(contrast, row, column).reshape(-1, 9)).argmax(axis=1)
        row = np.clip(row + best // 3 - 1, 1, most[0])
        column = np.clip(column + best % 3 - 1, 1, most[1])
    return row, column


def _neighbours(image: FloatArray, row: IdArray, column: IdArray) -> FloatArray:
    """(n, 3, 3) values about each pixel."""
    span = np.arange(-1, 2)
    return np.asarray(image[row[:, None, None] + span[:, None], column[:, None, None] + span])


def _peak(three: FloatArray) -> FloatArray:
    """Where the parabola through each (n, 3) has its peak, from the middle one; 0 where it is flat."""
    bend = 2 * three[:, 1] - three[:, 0] - three[:, 2]
    return np.asarray((three[:, 2] - three[:, 0]) / np.where(bend > 0, 2 * bend, np.inf))
