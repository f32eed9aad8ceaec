"""From matches to a homography, and whether it is accepted."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.geometry import is_plausible, sigma_px
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography
from stab_ros.estimation import estimators
from stab_ros.estimation.rows import fit_rows
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

    def solve_rows(self, pairs: Correspondences, guess: Homography, trust: FloatArray,
                   rows: RowShifts | None, size: tuple[int, int]) -> Fit | None:
        """As `solve`, with displacements of the rows, from `rows` on; None where held-out features do not confirm any.

        size: width and height of the frame, px.
        """
        config = self.config
        found = fit_rows(pairs, trust, config.model, config.threshold, guess, size, rows)
        return found.fit if found is not None and found.holds else None

    def accepts(self, fit: Fit, pose: AnchorPose, expected: float, size: tuple[int, int]) -> bool:
        """Whether the camera can move so, enough features agree, and the uncertainty of this registration is small.

        pose: of the anchor. expected: number of trusted features in view. size: width, height, px.
        """
        if not is_plausible(pose.in_anchor(fit.ref_H_cur), size):
            return False
        return (
            int(fit.inlier.sum()) >= max(self.config.min_inliers, self.config.min_inlier_share * expected)
            and sigma_px(fit.ref_H_cur, fit.covariance, size) <= self.config.max_sigma
        )
