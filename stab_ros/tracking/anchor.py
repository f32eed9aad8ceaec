"""Which frame the others are compared with: the reference itself, or a later frame whose place in it is known.

* `fixed`: always the reference; no error adds up.
* `updated`: features are found anew in a later frame and their places carried to the reference by that frame's
  homography; the fit is then between those and the places in the current frame (Ljubicic et al. 2021, section 2: for
  large rotation or scale, and less accurate).
* `adjacent`: each frame is compared with the one before, and the homographies are chained (Zhang et al. 2023, section
  2, who compare neighbours; chaining needs no second interpolation).
* `keyframe`: as `updated`, but a later frame becomes a base only where the view leaves the others, and they all stay
  (`keyframes`).

But for the first the uncertainty of the base goes into that of each comparison, to first order, so that `sigma_px`
shows the drift. Each comparison sees the same ground, water and interpolation as the one before, so their errors are
alike: measured, they grow with the number of comparisons and not with its root. So sigmas add up, not their squares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from stab_ros.core.geometry import apply, inside, normalized, point_jacobian, product_jacobians, sigma_px
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Gray, Homography
from stab_ros.methods import METHODS
from stab_ros.methods.base import Method
from stab_ros.tracking.feature_trust import FeatureTrust
from stab_ros.tracking.phase_correlation import PhaseCorrelation
from stab_ros.tracking.points import check_inside, check_used
from stab_ros.tracking.relocation import Relocation
from stab_ros.tracking.static_map import StaticMap

REFERENCES = ("fixed", "updated", "adjacent", "keyframe")

# (pairs, guess, trust of each pair) -> the homography from the current frame to where the pairs' reference_px lie
Solve = Callable[[Correspondences, Homography, FloatArray], Fit | None]

_RIGHT_MATCHES = 0.5
_MANY_FEATURES = 200  # enough to tell ground from water all over the picture


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a base lies in the reference: its homography, and the covariance of that (8, 8)."""

    ref_H_base: Homography
    covariance: FloatArray

    def to_base(self, ref_H_cur: Homography) -> Homography:
        """base_H_cur."""
        return normalized(np.linalg.inv(self.ref_H_base) @ ref_H_cur)

    def to_reference(self, base_H_cur: Homography) -> Homography:
        """ref_H_cur."""
        return normalized(self.ref_H_base @ base_H_cur)

    def points_in_base(self, reference_px: FloatArray) -> FloatArray:
        """(N, 2) points of the reference in base px."""
        return apply(np.linalg.inv(self.ref_H_base), reference_px)

    def mask_in_base(self, allowed: BoolArray) -> BoolArray:
        """(h, w) bool of the reference in base px; what the reference does not show is allowed only if all of it is."""
        if self is REFERENCE or allowed.all():
            return allowed
        size = (allowed.shape[1], allowed.shape[0])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(allowed.astype(np.uint8), self.ref_H_base, size, flags=flags)
        return np.asarray(warped, bool)

    def carried(self, pairs: Correspondences) -> Correspondences:
        """The same with reference_px and information in px of the reference, which were in px of the base."""
        if self is REFERENCE:
            return pairs
        back = np.linalg.inv(point_jacobian(self.ref_H_base, pairs.reference_px))
        information = back.transpose(0, 2, 1) @ pairs.information @ back
        reference_px = apply(self.ref_H_base, pairs.reference_px)
        H = None if pairs.ref_H_cur is None else self.to_reference(pairs.ref_H_cur)
        return replace(pairs, reference_px=reference_px, information=information, ref_H_cur=H)

    def chained(self, fit: Fit) -> Fit:
        """A fit of base_H_cur as one of ref_H_cur; its covariance still leaves out that of the base."""
        _, by_fit = product_jacobians(self.ref_H_base, fit.ref_H_cur)
        return replace(fit, ref_H_cur=self.to_reference(fit.ref_H_cur), covariance=by_fit @ fit.covariance @ by_fit.T)

    def accumulated(self, fit: Fit, size: tuple[int, int]) -> FloatArray:
        """Covariance of the fit's ref_H_cur with that of the base (8, 8), so that their sigma_px add up.

        For any r > 0, (1 + 1/r) A + (1 + r) B bounds the covariance of a sum whose parts are correlated in a way that
        is not known; r is the ratio of the two sigmas.
        """
        if self is REFERENCE:
            return fit.covariance
        by_base, _ = product_jacobians(self.ref_H_base, self.to_base(fit.ref_H_cur))
        carried, own = by_base @ self.covariance @ by_base.T, fit.covariance
        before_px, added_px = (sigma_px(fit.ref_H_cur, part, size) for part in (carried, own))
        if not before_px or not added_px:
            return np.asarray(carried + own)
        return np.asarray((1 + added_px / before_px) * carried + (1 + before_px / added_px) * own)


REFERENCE = Placement(np.eye(3), np.zeros((8, 8)))


class Anchor:
    """The frame that others are compared with, and all that depends on it alone."""

    def __init__(self, gray: Gray, place: Placement, method: Method) -> None:
        """method: made for `gray`, (h, w) uint8, which is not copied."""
        self.gray, self.place, self._method = gray, place, method
        self._features = FeatureTrust(len(method.reference_px))

    @property
    def features_px(self) -> FloatArray:
        """(features, 2) in px of the base."""
        return self._method.reference_px

    @property
    def trust(self) -> FloatArray:
        """(features,) in [0, 1]: how far each has proved to be static ground."""
        return self._features.trust

    def believe(self, static_map: StaticMap) -> None:
        """Trusts the features as the map of the reference says."""
        self._features.believe(static_map.at(self._features_in_reference))

    def inherit(self, old: Anchor, static_map: StaticMap | None) -> None:
        """Trusts the features as the map of the reference says, and where that tells nothing, as an older base does."""
        at_px = self._features_in_reference
        trust = StaticMap.of_features(old.features_px, old.trust, self.size).at(old.place.points_in_base(at_px))
        if static_map is not None:
            trust = np.where(inside(at_px, static_map.size), static_map.at(at_px), trust)
        self._features.believe(trust)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.gray.shape[1], self.gray.shape[0]

    @property
    def _features_in_reference(self) -> FloatArray:
        return apply(self.place.ref_H_base, self.features_px)

    def align(self, gray: Gray, guess: Homography, solve: Solve, chain: bool) -> tuple[Correspondences, Fit | None]:
        """Match and fit from a guess (ref_H_cur); both in px of the reference, without the uncertainty of the base.

        chain: fit to the base and chain, else fit to what is carried to the reference.
        """
        near = self.place.to_base(guess)
        pairs = self._method.match(gray, near, self._features.trust)
        trust, carried = self._features.trust[pairs.feature_id], self.place.carried(pairs)
        if not chain:
            return carried, solve(carried, guess if carried.ref_H_cur is None else carried.ref_H_cur, trust)
        fit = solve(pairs, near if pairs.ref_H_cur is None else pairs.ref_H_cur, trust)
        return carried, None if fit is None else self.place.chained(fit)

    @cached_property
    def _overview(self) -> PhaseCorrelation:
        return PhaseCorrelation(self.gray)

    @cached_property
    def _relocation(self) -> Relocation:
        return Relocation(self.gray)

    def jumped(self, gray: Gray, guess: Homography) -> Homography:
        """`guess` (ref_H_cur) with the shift that a rough look at the whole picture shows."""
        return self.place.to_reference(self._overview.corrected(gray, self.place.to_base(guess)))

    def relocated(self, gray: Gray) -> Homography | None:
        """ref_H_cur by features of the whole picture, wherever the frame lies; None where too few agree."""
        many = len(self.features_px) >= _MANY_FEATURES
        ground = StaticMap.of_features(self.features_px, self.trust, self.size) if many else None
        found = self._relocation.find(gray, ground)
        return None if found is None else self.place.to_reference(found)

    def share_in_view(self, ref_H_cur: Homography) -> float:
        """How much of the trusted features a frame there shows, in [0, 1]."""
        total = float(self.trust.sum())
        return self.in_view(ref_H_cur) / total if total > 0 else 0.0

    def in_view(self, ref_H_cur: Homography) -> float:
        """How many trusted features lie in a frame there."""
        return float(self.trust[self._in_view(ref_H_cur)].sum())

    def expected(self, pairs: Correspondences, ref_H_cur: Homography) -> float:
        """How many trusted features a frame there should show.

        A detector does not find all of them again, and where the view has changed much, half of its matches are wrong.
        """
        if not self._method.seeks_all:
            return _RIGHT_MATCHES * float(self._features.trust[pairs.feature_id].sum())
        return self.in_view(ref_H_cur)

    def learn(self, pairs: Correspondences, fit: Fit) -> None:
        """Remember which features agreed with an accepted fit."""
        self._features.learn(pairs, fit, self._in_view(fit.ref_H_cur))

    def _in_view(self, ref_H_cur: Homography) -> BoolArray:
        """(features,) bool: which of them lie in the frame."""
        seen_px = apply(np.linalg.inv(self.place.to_base(ref_H_cur)), self._method.reference_px)
        return inside(seen_px, self.size)


def make_base(gray: Gray, place: Placement, method: str, method_config: object, allowed: BoolArray,
              points_px: FloatArray) -> Anchor:
    """A base that looks for what is allowed, (h, w) bool, and named, (n, 2) px, in the reference.

    method_config: the method's own `Config`; None: its defaults.
    """
    kind = METHODS[method]
    named_px = place.points_in_base(points_px)
    return Anchor(gray, place, kind(gray, place.mask_in_base(allowed), method_config or kind.Config(), named_px))


def reference_base(gray: Gray, method: str, method_config: object, allowed: BoolArray, points_px: FloatArray) -> Anchor:
    """The reference itself as the base.

    Raises:
        InputError: a point is of no use in it. (In a later base, which it may have left, the others do without it.)
    """
    check_inside(points_px, (gray.shape[1], gray.shape[0]))
    base = make_base(gray, REFERENCE, method, method_config, allowed, points_px)
    check_used(points_px, base.features_px, method)
    return base
