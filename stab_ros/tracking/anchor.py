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
from stab_ros.tracking.frame_search import FrameSearch
from stab_ros.tracking.frozen_blocks import FrozenBlocks
from stab_ros.tracking.full_size_features import FullSizeFeatures
from stab_ros.tracking.letterbox import within_bars
from stab_ros.tracking.points import check_inside, check_used
from stab_ros.tracking.relocation import OnGround, everywhere
from stab_ros.tracking.sensor_fixed import InPlaceCheck
from stab_ros.tracking.static_map import StaticMap
from stab_ros.tracking.support import Support, support_of

# (pairs, initial ref_H_cur, weight of each pair) -> the homography of the current frame to where reference_px lie
Solve = Callable[[Correspondences, Homography, FloatArray], Fit | None]
# the same with displacements of the rows to start from -> a fit with such; None: no rows swing
SolveRows = Callable[[Correspondences, Homography, FloatArray, RowShifts | None], Fit | None]

_RIGHT_MATCHES = 0.5
_TRUSTED = 0.5
_ROW_PASSES, _ROWS_CLOSE_PX = 6, 0.05
_MANY_FEATURES = 200  # enough to tell ground from water all over the image


class Anchor:
    """A frame that others are registered to, and all that depends on it alone.

    frozen: (features,) bool, which of them the codec has copied in the last frame that was looked at.
    """

    def __init__(self, gray: Gray, pose: AnchorPose, method: Method) -> None:
        """method: made for `gray`, (h, w) uint8, which is not copied."""
        self.gray, self.pose, self._method = gray, pose, method
        self._features = FeatureTrust(len(method.reference_px))
        self._blocks = FrozenBlocks(gray, method.reference_px)
        self.frozen: BoolArray = np.zeros(len(method.reference_px), bool)

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

    def block(self, fixed_to_camera: BoolArray) -> None:
        """Leaves out the features that lie on what is fixed to the camera, (h, w) bool, wherever the frame is."""
        column, row = np.clip(np.round(self.features_px), 0, np.array(self.size) - 1).astype(int).T
        self._features.block(fixed_to_camera[row, column])

    def fixed_to_camera(self, gray: Gray, ref_H_cur: Homography) -> FloatArray:
        """(n, 2) px, where a registered frame, (h, w) uint8, shows something fixed to the camera that was not known."""
        return self._in_place.found(gray, self.pose.in_anchor(ref_H_cur))

    @cached_property
    def _in_place(self) -> InPlaceCheck:
        return InPlaceCheck(self.gray, self.features_px)

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

    def look(self, gray: Gray) -> None:
        """Finds out which features of a frame, (h, w) uint8, are frozen: what the codec has copied."""
        self.frozen = self._blocks.find(gray)

    def update_weights(self, gray: Gray, pairs: Correspondences, fit: Fit) -> None:
        """Moves the weights towards what agreed with an accepted fit of a frame, (h, w) uint8."""
        seen_px = self._seen_px(fit.ref_H_cur)
        self._features.update(pairs, fit, inside(seen_px, self.size) & ~self.frozen)
        self._blocks.remember(gray, seen_px)

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
    def _search(self) -> FrameSearch:
        return FrameSearch(self.gray)

    def shifted(self, gray: Gray, guess: Homography) -> Homography | None:
        """`guess` (ref_H_cur) corrected by the shift that phase correlation finds; None: no clear one."""
        return self._in_reference(self._search.by_shift(gray, self.pose.in_anchor(guess)))

    def searched(self, gray: Gray, guess: Homography, radius_px: int) -> Homography | None:
        """ref_H_cur by areas of static ground, searched within a radius of `guess`; None where too few agree."""
        trusted_px = self.features_px[self.trust > _TRUSTED]
        return self._in_reference(self._search.by_areas(gray, self.pose.in_anchor(guess), trusted_px, radius_px))

    def relocated(self, gray: Gray) -> Homography | None:
        """ref_H_cur by features of small pictures, wherever the frame lies; None where too few agree."""
        return self._in_reference(self._search.by_small_pictures(gray, self._on_ground()))

    def recognized(self, features: FullSizeFeatures, last: Homography) -> Homography | None:
        """ref_H_cur by features at full size, around what was seen of the ground at `last`; None: too few agree."""
        seen_px = self.ground_seen(last)
        centre_px = apply(self.pose.in_anchor(last), seen_px[None])[0]
        return self._in_reference(self._search.by_full_size(features, centre_px, self._on_ground()))

    def ground_seen(self, ref_H_cur: Homography) -> FloatArray:
        """(2,) px of a frame there: the middle of the ground that it shows; of the frame, where it shows none."""
        shown = self.features_px[self._in_view(ref_H_cur) & (self.trust > _TRUSTED)]
        at_px = apply(np.linalg.inv(self.pose.in_anchor(ref_H_cur)), shown)
        return np.asarray(at_px.mean(axis=0) if len(shown) else np.array(self.size) / 2)

    def _on_ground(self) -> OnGround:
        """Which points of the anchor lie on static ground; all, where the features are too few to tell."""
        if len(self.features_px) < _MANY_FEATURES:
            return everywhere
        ground = StaticMap.of_features(self.features_px, self.trust, self.size)
        return lambda points_px: ground.at(points_px) > _TRUSTED

    def _in_reference(self, anchor_H_cur: Homography | None) -> Homography | None:
        return None if anchor_H_cur is None else self.pose.in_reference(anchor_H_cur)

    def share_in_view(self, ref_H_cur: Homography) -> float:
        """Share of the trusted features that a frame there shows, in [0, 1]."""
        total = float(self.trust.sum())
        return self.number_in_view(ref_H_cur) / total if total > 0 else 0.0

    def number_in_view(self, ref_H_cur: Homography) -> float:
        """Number of trusted features, summed by weight, that lie in a frame there."""
        return float(self.trust[self._in_view(ref_H_cur)].sum())

    def support(self, pairs: Correspondences, fit: Fit) -> Support:
        """How much of the ground in view agrees with a fit.

        A detector does not find all features again, and where the view has changed much, half of its matches are wrong.
        """
        agrees = np.zeros(len(self.trust), bool)
        agrees[pairs.feature_id[fit.inlier]] = True
        if self._method.seeks_all:
            which, expected = np.flatnonzero(self._in_view(fit.ref_H_cur)), None
        else:
            which, expected = pairs.feature_id, _RIGHT_MATCHES * float(self.trust[pairs.feature_id].sum())
        return support_of(self.features_px[which], self.trust[which], agrees[which], self.size, expected)

    def _in_view(self, ref_H_cur: Homography) -> BoolArray:
        """(features,) bool: which of them lie in the frame."""
        return inside(self._seen_px(ref_H_cur), self.size)

    def _seen_px(self, ref_H_cur: Homography) -> FloatArray:
        """(features, 2) where they lie in the frame."""
        return apply(np.linalg.inv(self.pose.in_anchor(ref_H_cur)), self._method.reference_px)


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
        return Anchor(gray, pose, kind(gray, self.allowed_in(gray, pose), config, named_px))

    def allowed_in(self, gray: Gray, pose: AnchorPose) -> BoolArray:
        """(h, w) bool: where features may lie in a frame, (h, w) uint8, at a pose."""
        return pose.mask_in_anchor(self.allowed) & within_bars(gray)

    def reference(self, gray: Gray) -> Anchor:
        """The reference itself as the anchor.

        Raises:
            InputError: a named point cannot be used in it.
        """
        check_inside(self.points_px, (gray.shape[1], gray.shape[0]))
        anchor = self.at(gray, AT_REFERENCE)
        check_used(self.points_px, anchor.features_px, self.method)
        return anchor
