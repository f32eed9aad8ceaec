"""SAR-SIFT: SIFT for speckle, by gradients that are ratios (Dellinger et al. 2015).

Zhang et al. (2023, section 3.6.2) use it in place of SIFT for radar video. Key points are corners of the SAR-Harris
function at eight scales, all at full resolution; orientation and GLOH-like descriptor come from the gradient by ratio.
Not in the paper: matches that roughly agree on one homography are then refined by correlation, which reduces their
error from one or two px to 0.2 px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stab_ros.core.geometry import apply, is_plausible
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.estimation import estimators
from stab_ros.methods import _ratio_descriptor, _roewa, _window_correlation
from stab_ros.methods._descriptors import DescriptorMethod, Features, MatchRule, spread_evenly, within

# standard deviation of a corner along either axis, in alpha; calibrated against ground truth of speckled flights
_SIGMA_SHARE = 0.2
_COARSE_THRESHOLD_PX, _FINE_THRESHOLD_PX = 3.0, 1.0  # inlier thresholds before and after the correlation
_PASSES = 2
_SIGMAS = 3.0


@dataclass(frozen=True)
class SarSiftConfig(Checked):
    """Parameters `sar_sift.*`."""

    threshold: float = setting(0.1, "Minimum response of the SAR-Harris function (0.8 in published code)", 1e-6, 100.0)
    scales: int = setting(8, "Number of scales, from 2 px in steps of the cube root of 2", 1, 12)
    features: int = setting(3000, "Maximum number of corners per image, spread evenly over scales and image", 16, 50000)
    ratio: float = setting(0.8, "Ratio test: maximum ratio of the nearest to the second nearest descriptor distance",
                           0.1, 1.0)
    upright: bool = setting(False, "Compute descriptors without orientation; more distinctive if the camera does not "
                                   "rotate")
    refine: bool = setting(True, "Refine the matches by cross-correlation of windows")
    radius: int = setting(16, "With refine: half the side of a window, px", 5, 64)
    min_correlation: float = setting(0.5, "With refine: minimum correlation of a window with the reference", 0.0, 1.0)


class SarSift(DescriptorMethod):
    """`stab_ros.methods.Method` by SAR-SIFT."""

    Config: ClassVar[type[Any]] = SarSiftConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: SarSiftConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Detects the key points of the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where key points may lie.
            config: parameters.
            points_px: not used.
        """
        self._config = config
        self._logarithm = _window_correlation.logarithm(reference)
        super().__init__(within(self._detect(reference), allowed), self._detect, MatchRule(config.ratio))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        pairs = super().match(current, guess, trust)
        return self._refined(current, pairs, guess, trust) if self._config.refine else pairs

    def _refined(self, current: Gray, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Correspondences:
        """The pairs that agree on one homography, refined by correlation; all pairs unchanged where none agree."""
        H = estimators.refine(pairs, "projective", _COARSE_THRESHOLD_PX, guess, trust[pairs.feature_id])
        logarithm, size = _window_correlation.logarithm(current), current.shape[::-1]
        for _ in range(_PASSES):
            if H is None or not is_plausible(H, size):
                return pairs
            near = pairs[_consistent(pairs, H)]
            placed = _window_correlation.match_windows(self._logarithm, logarithm, near, H, self._config.radius,
                                        self._config.min_correlation)
            H = estimators.refine(placed, "projective", _FINE_THRESHOLD_PX, H, trust[placed.feature_id])
        return placed

    def _detect(self, gray: Gray) -> Features:
        found = [self._detect_at_scale(gray, _roewa.FINEST_PX * _roewa.STEP**k) for k in range(self._config.scales)]
        return Features(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _detect_at_scale(self, gray: Gray, alpha_px: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, their standard deviations and descriptors at one scale."""
        config = self._config
        scale = _roewa.ratio_gradient(gray, alpha_px)
        px, response = _roewa.corners(scale, config.threshold)
        px = px[spread_evenly(px, response, max(1, config.features // config.scales), gray.shape)]
        angle: FloatArray = np.zeros(len(px))
        if not config.upright:
            which, angle = _ratio_descriptor.orientations(scale, px)
            px = px[which]
        return px, np.full(len(px), _SIGMA_SHARE * alpha_px), _ratio_descriptor.describe(scale, px, angle)


def _consistent(pairs: Correspondences, H: Homography) -> BoolArray:
    """(n,) bool: which pairs agree with H within three standard deviations."""
    squared = np.sum((apply(H, pairs.current_px) - pairs.reference_px) ** 2, axis=1)
    return np.asarray(squared * pairs.information[:, 0, 0] < _SIGMAS**2)  # a corner's covariance is isotropic
