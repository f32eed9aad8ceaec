"""Where an anchor frame lies in the reference, and what that makes of a registration to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from stab_ros.core.geometry import apply, normalized, point_jacobian, product_jacobians, sigma_px
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Homography


@dataclass(frozen=True, eq=False)
class AnchorPose:
    """The homography of an anchor frame, and its covariance (8, 8)."""

    ref_H_anchor: Homography
    covariance: FloatArray

    def in_anchor(self, ref_H_cur: Homography) -> Homography:
        """anchor_H_cur of a ref_H_cur."""
        return normalized(np.linalg.inv(self.ref_H_anchor) @ ref_H_cur)

    def in_reference(self, anchor_H_cur: Homography) -> Homography:
        """ref_H_cur of an anchor_H_cur."""
        return normalized(self.ref_H_anchor @ anchor_H_cur)

    def points_in_anchor(self, reference_px: FloatArray) -> FloatArray:
        """(N, 2) points of the reference in px of the anchor."""
        return apply(np.linalg.inv(self.ref_H_anchor), reference_px)

    def mask_in_anchor(self, allowed: BoolArray) -> BoolArray:
        """(h, w) bool of the reference in px of the anchor. Beyond the reference nothing is allowed, unless all is."""
        if self is AT_REFERENCE or allowed.all():
            return allowed
        size = (allowed.shape[1], allowed.shape[0])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(allowed.astype(np.uint8), self.ref_H_anchor, size, flags=flags)
        return np.asarray(warped, bool)

    def transferred(self, pairs: Correspondences) -> Correspondences:
        """Matches with the anchor as matches with the reference: their reference_px and information."""
        if self is AT_REFERENCE:
            return pairs
        back = np.linalg.inv(point_jacobian(self.ref_H_anchor, pairs.reference_px))
        information = back.transpose(0, 2, 1) @ pairs.information @ back
        reference_px = apply(self.ref_H_anchor, pairs.reference_px)
        H = None if pairs.ref_H_cur is None else self.in_reference(pairs.ref_H_cur)
        return replace(pairs, reference_px=reference_px, information=information, ref_H_cur=H)

    def chained(self, fit: Fit) -> Fit:
        """A fit of anchor_H_cur as one of ref_H_cur, whose covariance leaves out that of the anchor."""
        _, by_fit = product_jacobians(self.ref_H_anchor, fit.ref_H_cur)
        return replace(fit, ref_H_cur=self.in_reference(fit.ref_H_cur), covariance=by_fit @ fit.covariance @ by_fit.T)

    def accumulated(self, fit: Fit, size: tuple[int, int]) -> FloatArray:
        """Covariance (8, 8) of the fit's ref_H_cur including that of the anchor, so that their sigma_px add up.

        The errors of successive registrations are correlated in an unknown way. For any r > 0,
        (1 + 1/r) A + (1 + r) B bounds the covariance of such a sum; r is the ratio of the two sigmas.
        """
        if self is AT_REFERENCE:
            return fit.covariance
        by_anchor, _ = product_jacobians(self.ref_H_anchor, self.in_anchor(fit.ref_H_cur))
        carried, own = by_anchor @ self.covariance @ by_anchor.T, fit.covariance
        before_px, added_px = (sigma_px(fit.ref_H_cur, part, size) for part in (carried, own))
        if not before_px or not added_px:
            return np.asarray(carried + own)
        return np.asarray((1 + added_px / before_px) * carried + (1 + before_px / added_px) * own)


AT_REFERENCE = AnchorPose(np.eye(3), np.zeros((8, 8)))
