"""AKAZE: extrema of the Hessian in a non-linear scale space, with binary descriptors (Alcantarilla et al. 2013).

The features of FlowVeloTool (Eltner et al. 2020; Ljubicic et al. 2021, section 2.2), in OpenCV's implementation: brute
force over Hamming distances, a match valid "if the second closest match reveals a significantly larger distance".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray
from stab_ros.methods._descriptors import DescriptorMethod, Features, Rule, contrib, spread, within

# Of a place along either axis, measured against the truth of synthetic flights, by the size of the key point.
_SIGMA_PX, _SIGMA_SHARE = 0.025, 0.006


@dataclass(frozen=True)
class AkazeConfig(Checked):
    """Parameters `akaze.*`."""

    threshold: float = setting(0.001, "least response of the detector", 1e-6, 1.0)
    features: int = setting(5000, "most key points of a picture, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "a match is nearer than this times the second nearest descriptor", 0.1, 1.0)
    octaves: int = setting(4, "octaves of the scale space", 1, 8)
    layers: int = setting(4, "scales an octave", 1, 8)


class Akaze(DescriptorMethod):
    """`stab_ros.methods.Method` by AKAZE."""

    Config: ClassVar[type[Any]] = AkazeConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: AkazeConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where key points may lie. It takes no `points_px`.

        Raises:
            InputError: this OpenCV has no AKAZE.
        """
        self._most = config.features
        self._detector = contrib("AKAZE_create")(threshold=config.threshold, nOctaves=config.octaves,
                                                 nOctaveLayers=config.layers)
        rule = Rule(config.ratio, cv2.NORM_HAMMING)
        super().__init__(within(self._found(reference), allowed), self._found, rule)

    def _found(self, gray: Gray) -> Features:
        points, descriptor = self._detector.detectAndCompute(gray, None)
        if not points:
            return Features(np.empty((0, 2)), np.empty(0), np.empty((0, 61), np.uint8))
        px, size = np.array([point.pt for point in points]), np.array([point.size for point in points])
        response = np.array([point.response for point in points])
        found = Features(px, np.hypot(_SIGMA_PX, _SIGMA_SHARE * size), descriptor)
        return found[spread(px, response, self._most, gray.shape)]
