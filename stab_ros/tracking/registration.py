"""From matches to a homography, and why it is not accepted."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.geometry import is_plausible, sigma_px
from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography, LostReason
from stab_ros.estimation import estimators
from stab_ros.tracking.anchor_pose import AnchorPose
from stab_ros.tracking.settings import StabilizerConfig


@dataclass(frozen=True)
class Registration:
    """Fits and judges by the settings."""

    config: StabilizerConfig

    def solve(self, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Fit | None:
        """The homography from the current frame to where the pairs' reference_px lie; None where nothing fits.

        guess: the homography to start from. trust: (N,) weight of each pair, in [0, 1].
        """
        config = self.config
        return estimators.fit(pairs, config.model, config.estimator, config.threshold, guess, trust,
                              config.ransac_threshold)

    def rejected(self, fit: Fit, pose: AnchorPose, expected: float, size: tuple[int, int]) -> LostReason | None:
        """Why the fit is not accepted: the camera cannot move so, too few features agree, or it is too uncertain.

        pose: of the anchor. expected: number of trusted features in view. size: width, height, px. None: it is.
        """
        if not is_plausible(pose.in_anchor(fit.ref_H_cur), size):
            return LostReason.IMPLAUSIBLE
        if int(fit.inlier.sum()) < max(self.config.min_inliers, self.config.min_inlier_share * expected):
            return LostReason.FEW_INLIERS
        if sigma_px(fit.ref_H_cur, fit.covariance, size) > self.config.max_sigma:
            return LostReason.UNCERTAIN
        return None
