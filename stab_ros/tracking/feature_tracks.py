"""Tracks features of the reference through the frames of the start-up, each by itself: bank, water and leaves alike.

Optical flow predicts a feature from frame to frame, then its template from the reference is aligned: no error adds up,
and it is known which features keep their texture. No plane is assumed; `planes` finds out which features move together.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import apply, point_jacobian
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.estimation import estimators
from stab_ros.methods import spread
from stab_ros.methods.direct import DirectConfig
from stab_ros.methods.patches import Patches, cut_patches, measure_patches
from stab_ros.tracking.frozen_blocks import FrozenBlocks
from stab_ros.tracking.phase_correlation import PhaseCorrelation

_PATCHES = DirectConfig()  # as of the method `direct`
_FLOW_BLOCK_PX = 15
_FLOW_WIDTH_PX = 1600  # or up to twice that: the flow only predicts, the templates are aligned at full size
_COARSEST_PX = 80  # the shorter side of the coarsest pyramid level of the flow
_PASSES = 3  # against the template
_CLOSE_PX = 0.02
_FAR_PX = 3.0  # more than the flow is ever off
_SHAPE_PX = 3.0
_FOLLOWED = 0.1  # of the features, at least: with fewer the frame is not followed


@dataclass(frozen=True, eq=False)
class Trajectories:
    """N features over F frames.

    reference_px: (N, 2). current_px: (F, N, 2). information: (F, N, 2, 2) of the reference-side displacement, 1/px^2.
    seen: (F, N) bool, where the other two hold. frozen: (F, N) bool, what the codec has copied from earlier frames. A frame that could not be followed has none. shapes: (F, 3, 3),
    rough ref_H_cur fitted to most features; all planes share it up to a translation.
    """

    reference_px: FloatArray
    current_px: FloatArray
    information: FloatArray
    seen: BoolArray
    frozen: BoolArray
    shapes: FloatArray

    def pairs(self, frame: int, which: BoolArray | None = None) -> Correspondences:
        """Matches of one frame with the reference, of all features or of `which`, (N,) bool."""
        found = np.flatnonzero(self.seen[frame] if which is None else self.seen[frame] & which)
        return Correspondences(found, self.reference_px[found], self.current_px[frame, found],
                               self.information[frame, found])


class FeatureTracks:
    """Tracks the features of one reference."""

    def __init__(self, reference: Gray, allowed: BoolArray) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where features may lie."""
        centres = spread.choose(reference, allowed, _PATCHES.patches, _PATCHES.radius, _PATCHES.min_texture)
        self._patches = cut_patches(reference, centres, _PATCHES.radius)
        self.reference_px: FloatArray = self._patches.centres.astype(np.float64)
        self._shrinking = Downscaling.to_width(reference, _FLOW_WIDTH_PX)
        self._last = self._shrinking.picture(reference)
        self._at_px, self._step_px = self.reference_px.copy(), np.zeros_like(self.reference_px)
        self._ref_H_cur: Homography = np.eye(3)
        self._rows: list[tuple[FloatArray, FloatArray, BoolArray]] = []
        self._blocks = FrozenBlocks(reference, self.reference_px)
        self._frozen: list[BoolArray] = []
        self._shapes: list[Homography] = []

    @property
    def patches(self) -> Patches:
        """The features' templates."""
        return self._patches

    def follow(self, gray: Gray) -> bool:
        """Finds all features in the next frame, (h, w) uint8; whether enough were found."""
        small = self._shrinking.picture(gray)
        self._frozen.append(self._blocks.find(gray))
        followed = (self._try(gray, small, self._at_px + self._step_px)
                    or self._try(gray, small, self._jumped(small)))
        if not followed:
            n = len(self.reference_px)
            self._rows.append((np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, bool)))
        self._shapes.append(self._ref_H_cur)
        self._blocks.remember(gray, self._at_px)
        return followed

    def trajectories(self) -> Trajectories:
        """The trajectories so far."""
        n = len(self.reference_px)
        current, information, seen = zip(*self._rows, strict=True) if self._rows else ((), (), ())
        return Trajectories(self.reference_px, np.array(current).reshape(-1, n, 2),
                            np.array(information).reshape(-1, n, 2, 2), np.array(seen, bool).reshape(-1, n),
                            np.array(self._frozen, bool).reshape(-1, n),
                            np.array(self._shapes).reshape(-1, 3, 3))

    def _as_bright(self, small: Gray) -> Gray:
        """The previous image with mean and contrast of the next: the flow assumes constant brightness."""
        (mean, spread), (wanted, wide) = (cv2.meanStdDev(picture) for picture in (self._last, small))
        gain = float(wide[0, 0]) / max(float(spread[0, 0]), 1.0)
        levels = (np.arange(256) - float(mean[0, 0])) * gain + float(wanted[0, 0])
        return np.asarray(cv2.LUT(self._last, np.clip(np.round(levels), 0, 255).astype(np.uint8)))

    def _try(self, gray: Gray, small: Gray, start_px: FloatArray) -> bool:
        """One attempt from predicted positions; kept if enough features are found there."""
        scale = self._shrinking.scale
        moved, found = _flowed(self._as_bright(small), small, apply(scale, self._at_px), apply(scale, start_px))
        at_px = apply(np.linalg.inv(scale), moved)
        shape = self._shape(at_px, found)
        if shape is None:
            return False
        at_px, information, seen = self._against_templates(gray, shape, at_px, found)
        if seen.sum() < max(12, _FOLLOWED * len(seen)):
            return False
        step = np.median((at_px - self._at_px)[seen], axis=0)
        self._step_px = np.where(seen[:, None], at_px - self._at_px, step)
        self._at_px = np.where(seen[:, None], at_px, self._at_px + step)
        self._last, self._ref_H_cur = small, shape
        self._rows.append((at_px, information, seen))
        return True

    def _shape(self, at_px: FloatArray, found: BoolArray) -> Homography | None:
        """ref_H_cur, roughly, of most features: rotation and scale are common to all planes."""
        which = np.flatnonzero(found)
        pairs = Correspondences(which, self.reference_px[which], at_px[which], np.tile(np.eye(2), (len(which), 1, 1)))
        return estimators.refine(pairs, "projective", _SHAPE_PX, self._ref_H_cur, np.ones(len(which)))

    def _against_templates(self, gray: Gray, ref_H_cur: Homography, at_px: FloatArray,
                           found: BoolArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Positions (N, 2) and information (N, 2, 2) by the templates, and which features still match theirs."""
        cur_H_ref = np.linalg.inv(ref_H_cur)
        cur_J_ref = point_jacobian(cur_H_ref, self.reference_px)
        start_px, at_px, chosen = at_px, at_px.copy(), np.flatnonzero(found)
        information, seen = np.zeros((len(at_px), 2, 2)), np.zeros(len(at_px), bool)
        for _ in range(_PASSES):
            measured = measure_patches(self._patches, chosen, gray, cur_H_ref, at_px[chosen])
            moved = np.einsum("nij,nj->ni", cur_J_ref[chosen], measured.displacement)
            at_px[chosen] += moved
            off = np.abs(at_px[chosen] - start_px[chosen]).max(axis=1, initial=0)
            good = (measured.correlation >= _PATCHES.min_correlation) & (off < _FAR_PX)
            information[chosen], seen[chosen] = measured.information, good
            chosen = chosen[good & (np.abs(moved).max(axis=1, initial=0) > _CLOSE_PX)]
        return at_px, information, seen

    def _jumped(self, small: Gray) -> FloatArray:
        """Positions of the features if the whole image has shifted since the last frame."""
        last_H_cur = self._shrinking.whole(PhaseCorrelation(self._last).corrected(small, np.eye(3)))
        return apply(np.linalg.inv(last_H_cur), self._at_px)


def _flowed(first: Gray, second: Gray, from_px: FloatArray, start_px: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Points of the first image in the second, (N, 2), by optical flow, and which of them were found."""
    levels = max(0, int(np.log2(min(first.shape) / _COARSEST_PX)))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.03)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, from_px.astype(np.float32), start_px.astype(np.float32), winSize=(_FLOW_BLOCK_PX,) * 2,
        maxLevel=levels, criteria=criteria, flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    return moved.astype(np.float64), status.ravel().astype(bool)
