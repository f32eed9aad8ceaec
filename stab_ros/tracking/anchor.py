"""The anchor: the frame that others are registered to. It is the reference itself, or a later frame placed in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Gray, Homography
from stab_ros.methods import METHODS
from stab_ros.methods.base import Method, RowMethod
from stab_ros.tracking.anchor_pose import AT_REFERENCE, AnchorPose
from stab_ros.tracking.feature_trust import FeatureTrust
from stab_ros.tracking.phase_correlation import PhaseCorrelation
from stab_ros.tracking.points import check_inside, check_used
from stab_ros.tracking.relocation import Relocation
from stab_ros.tracking.static_map import StaticMap

# (pairs, initial ref_H_cur, weight of each pair) -> the homography of the current frame to where reference_px lie
Solve = Callable[[Correspondences, Homography, FloatArray], Fit | None]
# the same with displacements of the rows to start from -> a fit with such; None: no rows swing
SolveRows = Callable[[Correspondences, Homography, FloatArray, RowShifts | None], Fit | None]

_RIGHT_MATCHES = 0.5
_ROW_PASSES, _ROWS_CLOSE_PX = 6, 0.05
_MANY_FEATURES = 200  # enough to tell ground from water all over the image


class Anchor:
    """A frame that others are registered to, and all that depends on it alone."""

    def __init__(self, gray: Gray, pose: AnchorPose, method: Method) -> None:
        """method: made for `gray`, (h, w) uint8, which is not copied."""
        self.gray, self.pose, self._method = gray, pose, method
        self._features = FeatureTrust(len(method.reference_px))

    @property
    def features_px(self) -> FloatArray:
        """(features, 2) in px of the anchor."""
        return self._method.reference_px

    @property
    def trust(self) -> FloatArray:
        """(features,) in [0, 1]: weight of each feature, by how well it has agreed with static ground."""
        return self._features.trust

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.gray.shape[1], self.gray.shape[0]

    @property
    def _features_in_reference(self) -> FloatArray:
        return apply(self.pose.ref_H_anchor, self.features_px)

    def set_prior_weights(self, static_map: StaticMap) -> None:
        """Weights the features by the static map of the reference."""
        self._features.set_prior(static_map.at(self._features_in_reference))

    def inherit_weights(self, old: Anchor, static_map: StaticMap | None) -> None:
        """Weights the features by the static map of the reference, and beyond it by the features of an older anchor."""
        at_px = self._features_in_reference
        trust = StaticMap.of_features(old.features_px, old.trust, self.size).at(old.pose.points_in_anchor(at_px))
        if static_map is not None:
            trust = np.where(inside(at_px, static_map.size), static_map.at(at_px), trust)
        self._features.set_prior(trust)

    def update_weights(self, pairs: Correspondences, fit: Fit) -> None:
        """Moves the weights towards what agreed with an accepted fit."""
        self._features.update(pairs, fit, self._in_view(fit.ref_H_cur))

    def register(self, gray: Gray, guess: Homography, solve: Solve, chain: bool) -> tuple[Correspondences, Fit | None]:
        """Match and fit from an initial ref_H_cur; both in px of the reference, without the anchor's uncertainty.

        chain: fit in px of the anchor and multiply the homographies, else fit to points transferred to the reference.
        """
        near = self.pose.in_anchor(guess)
        pairs = self._method.match(gray, near, self.trust)
        trust, transferred = self.trust[pairs.feature_id], self.pose.transferred(pairs)
        if not chain:
            return transferred, solve(transferred, guess if transferred.ref_H_cur is None else transferred.ref_H_cur,
                                      trust)
        fit = solve(pairs, near if pairs.ref_H_cur is None else pairs.ref_H_cur, trust)
        return transferred, None if fit is None else self.pose.chained(fit)

    def register_rows(self, gray: Gray, guess: Homography, solve: SolveRows,
                      chain: bool) -> tuple[Correspondences, Fit] | None:
        """As `register`, with displacements of the rows; None where there are none to be seen.

        Features are measured again where the rows have gone, from within a few px of `guess`.
        """
        pairs = self._found(gray, self.pose.in_anchor(guess), None)
        fit = solve(pairs, self.pose.in_anchor(guess), self.trust[pairs.feature_id], None)
        for _ in range(_ROW_PASSES if isinstance(self._method, RowMethod) else 0):
            if fit is None or fit.rows is None:
                break
            before, pairs = fit.rows, self._found(gray, fit.ref_H_cur, fit.rows)
            fit = solve(pairs, fit.ref_H_cur, self.trust[pairs.feature_id], before)
            if fit is not None and fit.rows is not None and fit.rows.differs_px(before) < _ROWS_CLOSE_PX:
                break
        transferred = self.pose.transferred(pairs)
        if fit is not None and not chain and transferred is not pairs:
            fit = solve(transferred, self.pose.in_reference(fit.ref_H_cur), self.trust[pairs.feature_id], fit.rows)
        elif fit is not None and chain:
            fit = self.pose.chained(fit)
        return None if fit is None else (transferred, fit)

    def _found(self, gray: Gray, near: Homography, rows: RowShifts | None) -> Correspondences:
        """Features near anchor_H_cur `near` and the rows, in px of the anchor."""
        if isinstance(self._method, RowMethod):
            return self._method.measure(gray, near, rows)
        return self._method.match(gray, near, self.trust)

    @cached_property
    def _phase_correlation(self) -> PhaseCorrelation:
        return PhaseCorrelation(self.gray)

    @cached_property
    def _relocation(self) -> Relocation:
        return Relocation(self.gray)

    def shifted(self, gray: Gray, guess: Homography) -> Homography:
        """`guess` (ref_H_cur) corrected by the shift that phase correlation finds."""
        return self.pose.in_reference(self._phase_correlation.corrected(gray, self.pose.in_anchor(guess)))

    def relocated(self, gray: Gray) -> Homography | None:
        """ref_H_cur by features of the whole image, wherever the frame lies; None where too few agree."""
        many = len(self.features_px) >= _MANY_FEATURES
        ground = StaticMap.of_features(self.features_px, self.trust, self.size) if many else None
        found = self._relocation.find(gray, ground)
        return None if found is None else self.pose.in_reference(found)

    def share_in_view(self, ref_H_cur: Homography) -> float:
        """Share of the trusted features that a frame there shows, in [0, 1]."""
        total = float(self.trust.sum())
        return self.number_in_view(ref_H_cur) / total if total > 0 else 0.0

    def number_in_view(self, ref_H_cur: Homography) -> float:
        """Number of trusted features, summed by weight, that lie in a frame there."""
        return float(self.trust[self._in_view(ref_H_cur)].sum())

    def expected(self, pairs: Correspondences, ref_H_cur: Homography) -> float:
        """Number of trusted features that a frame there should show.

        A detector does not find all of them again, and where the view has changed much, half of its matches are wrong.
        """
        if not self._method.seeks_all:
            return _RIGHT_MATCHES * float(self.trust[pairs.feature_id].sum())
        return self.number_in_view(ref_H_cur)

    def _in_view(self, ref_H_cur: Homography) -> BoolArray:
        """(features,) bool: which of them lie in the frame."""
        seen_px = apply(np.linalg.inv(self.pose.in_anchor(ref_H_cur)), self._method.reference_px)
        return inside(seen_px, self.size)


@dataclass(frozen=True, eq=False)
class AnchorFactory:
    """Makes anchors by one method and its `Config` (None: the defaults).

    allowed: (h, w) bool, where features may lie in the reference. points_px: (n, 2), features named by the user.
    """

    method: str
    method_config: object
    allowed: BoolArray
    points_px: FloatArray

    def makes_as(self, other: AnchorFactory) -> bool:
        """Whether both make the same anchors."""
        return ((self.method, self.method_config) == (other.method, other.method_config)
                and np.array_equal(self.allowed, other.allowed) and np.array_equal(self.points_px, other.points_px))

    def at(self, gray: Gray, pose: AnchorPose) -> Anchor:
        """An anchor of `gray`, (h, w) uint8, at a pose; named points that have left the view are left out."""
        kind = METHODS[self.method]
        named_px = pose.points_in_anchor(self.points_px)
        config = self.method_config or kind.Config()
        return Anchor(gray, pose, kind(gray, pose.mask_in_anchor(self.allowed), config, named_px))

    def reference(self, gray: Gray) -> Anchor:
        """The reference itself as the anchor.

        Raises:
            InputError: a named point cannot be used in it.
        """
        check_inside(self.points_px, (gray.shape[1], gray.shape[0]))
        anchor = self.at(gray, AT_REFERENCE)
        check_used(self.points_px, anchor.features_px, self.method)
        return anchor
