"""From matches to a homography, and why it is not accepted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import is_plausible, rms_distance, sigma_px
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Homography, LostReason
from stab_ros.estimation import estimators
from stab_ros.tracking.anchor_pose import AnchorPose
from stab_ros.tracking.frozen_blocks import no_better
from stab_ros.tracking.settings import StabilizerConfig

_LEAST_NEW = 24  # matches that no codec has copied, to tell where the ground is by themselves


@dataclass(frozen=True)
class Registration:
    """Fits and judges by the settings. size: width, height of the reference, px."""

    config: StabilizerConfig
    size: tuple[int, int]

    def solve(self, pairs: Correspondences, guess: Homography, trust: FloatArray, frozen: BoolArray) -> Fit | None:
        """The homography from the current frame to where the pairs' reference_px lie; None where nothing fits.

        guess: the homography to start from. trust: (N,) weight of each pair, in [0, 1]. frozen: (N,) bool, copied by
        the codec from an earlier frame.
        """
        if not frozen.any():
            return self._fitted(pairs, guess, trust)
        fit = self._fitted(no_better(pairs, frozen), guess, trust)
        new = self._fitted(pairs, guess, np.where(frozen, 0.0, trust))
        if fit is None or new is None or new.inlier[~frozen].sum() < _LEAST_NEW:
            return fit
        return self._reconciled(fit, new)

    def _reconciled(self, fit: Fit, new: Fit) -> Fit:
        """The fit to all matches, with an uncertainty that spans the fit to new ones alone; that one if it is far off.

        Their distance counts by half, as both show a part of the picture, and less what is the noise of few new ones.
        """
        apart_px = rms_distance(fit.ref_H_cur, new.ref_H_cur, self.size)
        if apart_px > self.config.threshold:
            return new
        by_noise_px = sigma_px(new.ref_H_cur, new.covariance, self.size)
        beyond_noise = max(0.0, 1 - (by_noise_px / apart_px) ** 2) if apart_px else 0.0
        apart = (new.ref_H_cur - fit.ref_H_cur).ravel()[:8]
        return replace(fit, covariance=fit.covariance + beyond_noise / 4 * np.outer(apart, apart))

    def _fitted(self, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Fit | None:
        config = self.config
        return estimators.fit(pairs, config.model, config.estimator, config.threshold, guess, trust,
                              config.ransac_threshold)

    def rejected(self, fit: Fit, pose: AnchorPose, trust: FloatArray, expected: float) -> LostReason | None:
        """Why the fit is not accepted: the camera cannot move so, too few features agree, or it is too uncertain.

        pose: of the anchor. trust: (N,) of the matches. expected: number of trusted features in view. None: it is.
        """
        if not is_plausible(pose.in_anchor(fit.ref_H_cur), self.size):
            return LostReason.IMPLAUSIBLE
        if fit.inlier.sum() < self.config.min_inliers:
            return LostReason.FEW_INLIERS
        if trust[fit.inlier].sum() < self.config.min_inlier_share * expected:
            return LostReason.FEW_INLIERS
        if sigma_px(fit.ref_H_cur, fit.covariance, self.size) > self.config.max_sigma:
            return LostReason.UNCERTAIN
        return None
