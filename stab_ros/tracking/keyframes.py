"""Strategy `keyframe`: frames that stay anchors where the view leaves the reference, each placed by an earlier one.

A frame is registered to the keyframe with the smallest uncertainty that it overlaps enough: to the reference itself
whenever that is in view again. The keyframe left behind then takes the better pose that this frame gives it, and with
it all keyframes that were placed by it: the loop is closed. Keyframes are few, and the farthest are dropped.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply, normalized, product_jacobians, sigma_px
from stab_ros.core.types import Fit, FloatArray, Homography
from stab_ros.tracking.anchor import Anchor
from stab_ros.tracking.anchor_pose import AnchorPose
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.strategies import Check

_ENOUGH = 0.5  # of a keyframe's trusted features in view: one with a smaller uncertainty is taken
_SCARCE = 0.35  # with fewer, any keyframe that shows more is taken
_NEW = 0.7  # with fewer, a new one is made
_OTHERS = 3  # that a lost frame is searched in


@dataclass(eq=False)
class _Keyframe:
    anchor: Anchor
    parent: _Keyframe | None
    sigma_px: float


class Keyframes:
    """All keyframes of one reference, that one first. anchor: of the last tracked frame."""

    chains = False

    def __init__(self, reference: Anchor, most: int) -> None:
        """most: number of keyframes kept, the reference among them."""
        self.anchor = reference
        self._most = most
        self._all = [_Keyframe(reference, None, 0.0)]
        self._current = self._all[0]

    def __len__(self) -> int:
        return len(self._all)

    @property
    def anchors(self) -> list[Anchor]:
        """All of them, the reference first."""
        return [one.anchor for one in self._all]

    def choose(self, ref_H_cur: Homography) -> Anchor:
        """The keyframe for a frame expected there: the one with the smallest uncertainty that it shows enough of."""
        shares = {id(one): one.anchor.share_in_view(ref_H_cur) for one in self._all}
        enough = [one for one in self._all if shares[id(one)] >= _ENOUGH]
        best = min(enough, key=lambda one: one.sigma_px, default=None)
        if best is not None and (best.sigma_px < self._current.sigma_px or shares[id(self._current)] < _SCARCE):
            self._current = best
        elif shares[id(self._current)] < _SCARCE:
            self._current = max(self._all, key=lambda one: shares[id(one)])
        return self._current.anchor

    def others(self, ref_H_cur: Homography) -> list[Anchor]:
        """The other keyframes that lie nearest to a frame there."""
        rest = [one for one in self._all if one is not self._current]
        return [one.anchor for one in sorted(rest, key=lambda one: self._apart_px(one, ref_H_cur))][:_OTHERS]

    def registered(self, anchor: Anchor, fit: Fit, check: Check) -> None:
        """Closes a loop: the anchor of the frames until now takes the pose that a frame of another anchor gives it."""
        previous, self.anchor = self.anchor, anchor
        if previous is anchor:
            return
        self._current = next(one for one in self._all if one.anchor is anchor)
        seen = check(previous)
        if seen is not None:
            both = anchor.pose.accumulated(fit, previous.size) + seen.covariance  # two registrations of one frame
            self._correct(previous, previous.pose.in_anchor(seen.ref_H_cur), dataclasses.replace(fit, covariance=both))

    def wants_anchor(self, ref_H_cur: Homography, _config: StabilizerConfig) -> bool:
        """Whether a frame there should become a keyframe: no keyframe shows most of it."""
        return max(one.anchor.share_in_view(ref_H_cur) for one in self._all) < _NEW

    def add(self, anchor: Anchor) -> None:
        """Adds a keyframe placed by the current one; the farthest from it is dropped if there are too many."""
        sigma = sigma_px(anchor.pose.ref_H_anchor, anchor.pose.covariance, anchor.size)
        self._all.append(_Keyframe(anchor, self._current, sigma))
        if len(self._all) > self._most:
            old = [one for one in self._all[1:] if one is not self._current]
            self._drop(max(old, key=lambda one: self._apart_px(one, anchor.pose.ref_H_anchor)))

    def resume(self, anchor: Anchor) -> None:
        """Goes on from a keyframe that is not the reference."""
        self.add(anchor)
        self.anchor, self._current = anchor, self._all[-1]

    def _drop(self, gone: _Keyframe) -> None:
        self._all.remove(gone)
        for one in self._all:
            if one.parent is gone:
                one.parent = gone.parent

    def _correct(self, anchor: Anchor, anchor_H_cur: Homography, fit: Fit) -> None:
        """Places `anchor` by a frame that lies at `anchor_H_cur` in it and at `fit`, if that is more certain."""
        keyframe = next((one for one in self._all if one.anchor is anchor), None)
        sigma = sigma_px(fit.ref_H_cur, fit.covariance, anchor.size)
        if keyframe is None or keyframe.parent is None or sigma >= keyframe.sigma_px:
            return
        ref_H_anchor = normalized(fit.ref_H_cur @ np.linalg.inv(anchor_H_cur))
        by_fit, _ = product_jacobians(fit.ref_H_cur, np.linalg.inv(anchor_H_cur))
        moved = ref_H_anchor @ np.linalg.inv(anchor.pose.ref_H_anchor)
        for one in self._all:
            if one is not keyframe and self._descends(one, keyframe):
                pose = one.anchor.pose
                one.anchor.pose = AnchorPose(normalized(moved @ pose.ref_H_anchor), pose.covariance)
        anchor.pose = AnchorPose(ref_H_anchor, by_fit @ fit.covariance @ by_fit.T)
        keyframe.sigma_px = sigma

    @staticmethod
    def _descends(one: _Keyframe, ancestor: _Keyframe) -> bool:
        while one.parent is not None:
            if one.parent is ancestor:
                return True
            one = one.parent
        return False

    @staticmethod
    def _apart_px(one: _Keyframe, ref_H_cur: Homography) -> float:
        """Between the centres of a keyframe and of a frame, px of the reference."""
        width, height = one.anchor.size
        centre = np.array([[width / 2, height / 2]])
        away: FloatArray = apply(one.anchor.pose.ref_H_anchor, centre) - apply(ref_H_cur, centre)
        return float(np.hypot(*away[0]))
