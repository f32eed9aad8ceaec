"""SAR-SIFT: SIFT for speckle, by gradients that are ratios (Dellinger et al. 2015).

What Zhang et al. 2023 use in place of SIFT for radar video (section 3.6.2). Corners of the SAR-Harris function at eight
scales, all at full resolution; orientation and GLOH-like descriptor from the gradient by ratio. Not in the paper:
matches that agree roughly on one plane are then placed anew by correlation, from a pixel or two down to 0.2 px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stab_ros.core.geometry import apply, is_plausible
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.estimation import estimators
from stab_ros.methods import _ratio_descriptor, _refine, _roewa
from stab_ros.methods._descriptors import DescriptorMethod, Features, Rule, spread, within

_SIGMA_SHARE = 0.2  # of a corner's place along either axis, in alpha; measured against the truth of speckled flights
_ROUGHLY_PX, _CLOSELY_PX = 3.0, 1.0  # what agrees before and after the correlation
_PASSES = 2
_SIGMAS = 3.0


@dataclass(frozen=True)
class SarSiftConfig(Checked):
    """Parameters `sar_sift.*`."""

    threshold: float = setting(0.1, "least response of the SAR-Harris function; 0.8 in published code", 1e-6, 100.0)
    scales: int = setting(8, "scales, from 2 px in steps of the cube root of 2", 1, 12)
    features: int = setting(3000, "most corners of a picture, spread evenly over scales and picture", 16, 50000)
    ratio: float = setting(0.8, "a match is nearer than this times the second nearest descriptor", 0.1, 1.0)
    upright: bool = setting(False, "the camera does not turn: descriptors without orientation tell more")
    refine: bool = setting(True, "place the matches anew by correlation")
    radius: int = setting(16, "refine: half the side of a window, px", 5, 64)
    min_correlation: float = setting(0.5, "refine: a window that looks less like the reference is left out", 0.0, 1.0)


class SarSift(DescriptorMethod):
    """`stab_ros.methods.Method` by SAR-SIFT."""

    Config: ClassVar[type[Any]] = SarSiftConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: SarSiftConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where corners may lie. It takes no `points_px`."""
        self._config = config
        self._logarithm = _refine.logarithm(reference)
        super().__init__(within(self._found(reference), allowed), self._found, Rule(config.ratio))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        pairs = super().match(current, guess, trust)
        return self._refined(current, pairs, guess, trust) if self._config.refine else pairs

    def _refined(self, current: Gray, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Correspondences:
        """What agrees on a plane, placed by correlation; as they are where there is no plane."""
        H = estimators.refine(pairs, "projective", _ROUGHLY_PX, guess, trust[pairs.feature_id])
        logarithm, size = _refine.logarithm(current), current.shape[::-1]
        for _ in range(_PASSES):
            if H is None or not is_plausible(H, size):
                return pairs
            near = pairs[_near(pairs, H)]
            placed = _refine.correlated(self._logarithm, logarithm, near, H, self._config.radius,
                                        self._config.min_correlation)
            H = estimators.refine(placed, "projective", _CLOSELY_PX, H, trust[placed.feature_id])
        return placed

    def _found(self, gray: Gray) -> Features:
        found = [self._at_scale(gray, _roewa.FINEST_PX * _roewa.STEP**k) for k in range(self._config.scales)]
        return Features(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _at_scale(self, gray: Gray, alpha_px: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places, their sigma and descriptors."""
        config = self._config
        scale = _roewa.scale_of(gray, alpha_px)
        px, response = _roewa.corners(scale, config.threshold)
        px = px[spread(px, response, max(1, config.features // config.scales), gray.shape)]
        angle: FloatArray = np.zeros(len(px))
        if not config.upright:
            which, angle = _ratio_descriptor.orientations(scale, px)
            px = px[which]
        return px, np.full(len(px), _SIGMA_SHARE * alpha_px), _ratio_descriptor.describe(scale, px, angle)


def _near(pairs: Correspondences, H: Homography) -> BoolArray:
    """Which pairs (n,) lie as near to H as their uncertainty lets expect."""
    squared = np.sum((apply(H, pairs.current_px) - pairs.reference_px) ** 2, axis=1)
    return np.asarray(squared * pairs.information[:, 0, 0] < _SIGMAS**2)  # of a corner, alike in all directions
