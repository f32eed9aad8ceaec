"""AKAZE: extrema of the Hessian in a nonlinear scale space, with binary descriptors (Alcantarilla et al. 2013).

The features of FlowVeloTool (Eltner et al. 2020; Ljubicic et al. 2021, section 2.2), in OpenCV's implementation.
Matching is brute force over Hamming distances with a ratio test: a match is valid "if the second closest match reveals
a significantly larger distance".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray
from stab_ros.methods._descriptors import DescriptorMethod, Features, MatchRule, contrib, spread_evenly, within

# Standard deviation of a position along either axis: a constant, and a share of the key point's size. Calibrated
# against ground truth of synthetic flights.
_SIGMA_PX, _SIGMA_SHARE = 0.025, 0.006


@dataclass(frozen=True)
class AkazeConfig(Checked):
    """Parameters `akaze.*`."""

    threshold: float = setting(0.001, "Minimum response of the detector", 1e-6, 1.0)
    features: int = setting(5000, "Maximum number of key points per image, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "Ratio test: maximum ratio of the nearest to the second nearest descriptor distance",
                           0.1, 1.0)
    octaves: int = setting(4, "Number of octaves of the scale space", 1, 8)
    layers: int = setting(4, "Number of scales per octave", 1, 8)


class Akaze(DescriptorMethod):
    """`stab_ros.methods.Method` by AKAZE."""

    Config: ClassVar[type[Any]] = AkazeConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: AkazeConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Detects the key points of the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where key points may lie.
            config: parameters.
            points_px: not used.

        Raises:
            InputError: this OpenCV has no AKAZE.
        """
        self._max_features = config.features
        self._detector = contrib("AKAZE_create")(threshold=config.threshold, nOctaves=config.octaves,
                                                 nOctaveLayers=config.layers)
        rule = MatchRule(config.ratio, cv2.NORM_HAMMING)
        super().__init__(within(self._detect(reference), allowed), self._detect, rule)

    def _detect(self, gray: Gray) -> Features:
        points, descriptor = self._detector.detectAndCompute(gray, None)
        if not points:
            return Features(np.empty((0, 2)), np.empty(0), np.empty((0, 61), np.uint8))
        px, size = np.array([point.pt for point in points]), np.array([point.size for point in points])
        response = np.array([point.response for point in points])
        found = Features(px, np.hypot(_SIGMA_PX, _SIGMA_SHARE * size), descriptor)
        return found[spread_evenly(px, response, self._max_features, gray.shape)]
