"""Tracks features of the reference through the frames of the start-up, each by itself: bank, water and leaves alike.

Optical flow predicts a feature from frame to frame, then its template from the reference is aligned: no error adds up,
and it is known which features keep their texture. No plane is assumed; `planes` finds out which features move together.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import apply, normalized, point_jacobian, rms_distance
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.estimation import estimators
from stab_ros.methods import spread
from stab_ros.methods.direct import DirectConfig
from stab_ros.methods.patches import Patches, cut_patches, measure_patches
from stab_ros.tracking import agreement
from stab_ros.tracking.frame_search import FrameSearch
from stab_ros.tracking.frozen_blocks import FrozenBlocks
from stab_ros.tracking.full_size_features import FullSizeFeatures
from stab_ros.tracking.phase_correlation import PhaseCorrelation
from stab_ros.tracking.reference import is_textured
from stab_ros.tracking.relocation import everywhere

_PATCHES = DirectConfig()  # as of the method `direct`
_FLOW_BLOCK_PX = 15
_FLOW_WIDTH_PX = 1600  # or up to twice that: the flow only predicts, the templates are aligned at full size
_COARSEST_PX = 80  # the shorter side of the coarsest pyramid level of the flow
_PASSES = 3  # against the template
_CLOSE_PX = 0.02
_FAR_PX = 3.0  # more than the flow is ever off
_SHAPE_PX, _EXACT_SHAPE_PX = 3.0, 1.0  # by the flow, and by the templates
_APART_PX, _APART_SHARE = 4.0, 0.002  # of the width: what a similarity leaves of a tilt from frame to frame
_TOGETHER, _LEAST_TOGETHER = 0.25, 12  # of the features that match their templates
_MOST_SAMPLES = 2000  # of RANSAC
_SEARCH_PX = 128  # in the reference, for a frame that no flow leads to
_JUMP = 0.05  # of the width, from one frame to the next
_EXCURSION, _TIMES_USUAL, _TIMES_APART = 0.03, 8.0, 4.0  # of the width; the median step; from before it to after it
_LEFT = 0.5  # of what the last two frames show
_FOLLOWED = 0.1  # of the features, at least: with fewer the frame is not followed


@dataclass(frozen=True, eq=False)
class Trajectories:
    """N features over F frames.

    reference_px: (N, 2). current_px: (F, N, 2). information: (F, N, 2, 2) of the reference-side displacement, 1/px^2.
    seen: (F, N) bool, where the other two hold. A frame that could not be followed has none. frozen: (F, N) bool, what
    the codec has copied from earlier frames. shapes: (F, 3, 3), rough ref_H_cur fitted to most features; all planes
    share it up to a translation.
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


@dataclass(frozen=True, eq=False)
class _Measured:
    """Features in a frame. at_px: (N, 2). information: (N, 2, 2), 1/px^2. seen: (N,) bool, where the other two hold."""

    at_px: FloatArray
    information: FloatArray
    seen: BoolArray

    @property
    def share(self) -> float:
        """Of the features, those that are seen."""
        return float(np.mean(self.seen))


@dataclass(frozen=True, eq=False)
class _Followed:
    """A frame in which the features were found.

    small: reduced for the flow. at_px: (N, 2) where they are, or should be. step_px: (N, 2) since the frame before it.
    own_px: (N, 2), the part of it that is not common to most features.
    """

    small: Gray
    at_px: FloatArray
    step_px: FloatArray
    own_px: FloatArray
    ref_H_cur: Homography


@dataclass(frozen=True, eq=False)
class _Found:
    """The features in a frame, and from where the next one is sought."""

    measured: _Measured
    followed: _Followed


class FeatureTracks:
    """Tracks the features of one reference.

    A frame counts as followed if its features match their templates from the reference and most of these have moved
    together. Any other is left out: the next one is sought from the frames before it, then in the reference.
    """

    def __init__(self, reference: Gray, allowed: BoolArray) -> None:
        """reference: (h, w) uint8, not copied. allowed: (h, w) bool, where features may lie."""
        centres = spread.choose(reference, allowed, _PATCHES.patches, _PATCHES.radius, _PATCHES.min_texture)
        self._patches = cut_patches(reference, centres, _PATCHES.radius)
        self.reference_px: FloatArray = self._patches.centres.astype(np.float64)
        self._shrinking = Downscaling.to_width(reference, _FLOW_WIDTH_PX)
        self._search = FrameSearch(reference)
        at_rest = np.zeros_like(self.reference_px)
        first = _Followed(self._shrinking.picture(reference), self.reference_px, at_rest, at_rest, np.eye(3))
        self._followed = [first]  # the last two
        self._blocks = FrozenBlocks(reference, self.reference_px)
        self._rows: list[_Measured] = []
        self._frozen: list[BoolArray] = []
        self._shapes: list[Homography] = []

    @property
    def patches(self) -> Patches:
        """The features' templates."""
        return self._patches

    def follow(self, gray: Gray) -> float:
        """Finds all features in the next frame, (h, w) uint8; the share of them that it shows, 0 if not followed."""
        self._frozen.append(self._blocks.find(gray))
        found = self._found(gray, self._shrinking.picture(gray))
        self._rows.append(self._unseen if found is None else found.measured)
        if found is not None:
            self._followed = [self._followed[-1], found.followed]
        self._shapes.append(self._followed[-1].ref_H_cur)
        self._blocks.remember(gray, self._followed[-1].at_px)
        return self._rows[-1].share

    @property
    def has_jumped(self) -> bool:
        """Whether the last frame that was followed lies far from the one before it."""
        shapes = [np.eye(3), *self._shapes]
        return rms_distance(shapes[-1], shapes[-2], self._search.size) > _JUMP * self._search.size[0]

    def trajectories(self) -> Trajectories:
        """The trajectories so far; without frames that lie elsewhere than both those before and after them."""
        n = len(self.reference_px)
        rows = [self._unseen if out else row for row, out in zip(self._rows, self._excursions(), strict=True)]
        return Trajectories(self.reference_px, np.array([row.at_px for row in rows]).reshape(-1, n, 2),
                            np.array([row.information for row in rows]).reshape(-1, n, 2, 2),
                            np.array([row.seen for row in rows], bool).reshape(-1, n),
                            np.array(self._frozen, bool).reshape(-1, n),
                            np.array(self._shapes).reshape(-1, 3, 3))

    def _excursions(self) -> list[bool]:
        """Of each frame, whether the camera would have gone far away for it and come back: it has inertia."""
        followed = [k for k, row in enumerate(self._rows) if row.seen.any()]
        n = len(self.reference_px)
        reference = _Measured(self.reference_px, np.zeros((n, 2, 2)), np.ones(n, bool))
        rows = [reference, *(self._rows[k] for k in followed)]
        steps_px = [_moved_px(one, other) for one, other in itertools.pairwise(rows)]
        least_px = max(_EXCURSION * self._search.size[0], _TIMES_USUAL * float(np.median(steps_px or [0.0])))
        out = [False] * len(self._rows)
        for k, (there_px, back_px) in enumerate(itertools.pairwise(steps_px)):
            apart_px = _moved_px(rows[k], rows[k + 2])
            out[followed[k]] = min(there_px, back_px) > max(least_px, _TIMES_APART * apart_px)
        return out

    @property
    def _unseen(self) -> _Measured:
        n = len(self.reference_px)
        return _Measured(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, bool))

    def _found(self, gray: Gray, small: Gray) -> _Found | None:
        """The features in the frame; by the frame before the last one, too, if few are left: that may be damaged."""
        found = next((one for one in self._attempts(gray, small) if one is not None), None)
        lately = max((row.share for row in self._rows[-2:]), default=0.0)
        if found is None or found.measured.share >= _LEFT * lately:
            return found
        others = (self._by_flow(gray, small, one, one.at_px + one.step_px) for one in self._followed[-2::-1])
        return max([found, *(one for one in others if one is not None)], key=lambda one: one.measured.share)

    def _attempts(self, gray: Gray, small: Gray) -> Iterator[_Found | None]:
        """The features in the frame, if it was followed: from the last frames, and as it lies in the reference."""
        last = self._followed[-1]
        yield self._by_flow(gray, small, last, last.at_px + last.step_px)
        if not is_textured(gray):
            return
        yield self._by_jump(gray, small, last)
        for before in self._followed[-2::-1]:
            yield self._by_flow(gray, small, before, before.at_px + before.step_px)
        for ref_H_cur in self._located(gray, last.ref_H_cur):
            yield self._by_position(gray, small, ref_H_cur)

    def _by_flow(self, gray: Gray, small: Gray, before: _Followed, start_px: FloatArray) -> _Found | None:
        """One attempt from an earlier frame and predicted positions."""
        scale = self._shrinking.scale
        moved, found = _flowed(_as_bright(before.small, small), small, apply(scale, before.at_px),
                               apply(scale, start_px))
        at_px = apply(np.linalg.inv(scale), moved)
        cur_H_before, together = _common_motion(before.at_px, at_px, found, self._apart_px)
        if not together.any():
            return None
        shape = self._shape(at_px, together, normalized(before.ref_H_cur @ np.linalg.inv(cur_H_before)), _SHAPE_PX)
        measured = self._against_templates(gray, shape, at_px, found)
        together &= measured.seen
        if together.sum() < _TOGETHER * measured.seen.sum():
            return None
        shape = self._shape(measured.at_px, together, shape, _EXACT_SHAPE_PX)
        return self._kept(gray, small, before, shape, measured)

    def _by_jump(self, gray: Gray, small: Gray, before: _Followed) -> _Found | None:
        """One attempt as if the whole image had shifted."""
        small_H = PhaseCorrelation(before.small).corrected(small, np.eye(3))
        if small_H is None:
            return None
        return self._by_flow(gray, small, before, apply(np.linalg.inv(self._shrinking.whole(small_H)), before.at_px))

    def _located(self, gray: Gray, near: Homography) -> Iterator[Homography]:
        """ref_H_cur of most features, by whatever finds the frame in the reference."""
        centre_px = np.array(self._search.size) / 2
        before = self._rows[-1].seen if self._rows else self._unseen.seen
        seen = before if before.any() else ~before
        searches: tuple[Callable[[], Homography | None], ...] = (
            lambda: self._search.by_areas(gray, near, self.reference_px[seen], _SEARCH_PX),
            lambda: self._search.by_full_size(FullSizeFeatures.of(gray, centre_px), centre_px, everywhere),
            lambda: self._search.by_small_pictures(gray, everywhere))
        return (found for found in (search() for search in searches) if found is not None)

    def _by_position(self, gray: Gray, small: Gray, ref_H_cur: Homography) -> _Found | None:
        """One attempt where the frame was located."""
        return self._kept(gray, small, self._followed[-1], ref_H_cur, self._unseen)

    def _kept(self, gray: Gray, small: Gray, before: _Followed, ref_H_cur: Homography,
              measured: _Measured) -> _Found | None:
        """The features, if enough are seen, once those that were not are sought where the others have moved."""
        moved_px = apply(np.linalg.inv(ref_H_cur) @ before.ref_H_cur, before.at_px)
        again = self._against_templates(gray, ref_H_cur, moved_px + before.own_px, ~measured.seen)
        seen = measured.seen | again.seen
        if seen.sum() < max(12, _FOLLOWED * len(seen)):
            return None
        at_px = np.where(measured.seen[:, None], measured.at_px, again.at_px)
        information = np.where(measured.seen[:, None, None], measured.information, again.information)
        at_px = np.where(seen[:, None], at_px, moved_px)
        own_px = np.where(seen[:, None], at_px - moved_px, 0.0)
        return _Found(_Measured(at_px, information, seen),
                      _Followed(small, at_px, at_px - before.at_px, own_px, ref_H_cur))

    @property
    def _apart_px(self) -> float:
        """Largest distance of features that have moved together."""
        return max(_APART_PX, _APART_SHARE * self._search.size[0])

    def _shape(self, at_px: FloatArray, which: BoolArray, guess: Homography, threshold_px: float) -> Homography:
        """ref_H_cur, roughly, of most features of `which`, (N,) bool: all planes share rotation and scale."""
        chosen = np.flatnonzero(which)
        pairs = Correspondences(chosen, self.reference_px[chosen], at_px[chosen],
                                np.tile(np.eye(2), (len(chosen), 1, 1)))
        found = estimators.refine(pairs, "projective", threshold_px, guess, np.ones(len(chosen)))
        return guess if found is None else found

    def _against_templates(self, gray: Gray, ref_H_cur: Homography, start_px: FloatArray,
                           which: BoolArray) -> _Measured:
        """Where the features `which`, (N,) bool, are by their templates, from rough positions (N, 2)."""
        cur_H_ref = np.linalg.inv(ref_H_cur)
        cur_J_ref = point_jacobian(cur_H_ref, self.reference_px)
        at_px, chosen = start_px.copy(), np.flatnonzero(which)
        information, seen = np.zeros((len(at_px), 2, 2)), np.zeros(len(at_px), bool)
        for _ in range(_PASSES):
            measured = measure_patches(self._patches, chosen, gray, cur_H_ref, at_px[chosen])
            moved = np.einsum("nij,nj->ni", cur_J_ref[chosen], measured.displacement)
            at_px[chosen] += moved
            off = np.abs(at_px[chosen] - start_px[chosen]).max(axis=1, initial=0)
            good = (measured.correlation >= _PATCHES.min_correlation) & (off < _FAR_PX)
            information[chosen], seen[chosen] = measured.information, good
            chosen = chosen[good & (np.abs(moved).max(axis=1, initial=0) > _CLOSE_PX)]
        return _Measured(at_px, information, seen)


def _moved_px(one: _Measured, other: _Measured) -> float:
    """How far most of the features that both show lie apart; infinite where they are few."""
    both = one.seen & other.seen
    if both.sum() < _LEAST_TOGETHER:
        return math.inf
    return float(np.median(np.hypot(*(one.at_px - other.at_px)[both].T)))


def _as_bright(before: Gray, small: Gray) -> Gray:
    """The earlier image with mean and contrast of this one: the flow assumes constant brightness."""
    (mean, spread), (wanted, wide) = (cv2.meanStdDev(picture) for picture in (before, small))
    gain = float(wide[0, 0]) / max(float(spread[0, 0]), 1.0)
    levels = (np.arange(256) - float(mean[0, 0])) * gain + float(wanted[0, 0])
    return np.asarray(cv2.LUT(before, np.clip(np.round(levels), 0, 255).astype(np.uint8)))


def _common_motion(before_px: FloatArray, at_px: FloatArray, found: BoolArray,
                   apart_px: float) -> tuple[Homography, BoolArray]:
    """The similarity by which most of the features that were found have moved, and (N,) bool: these."""
    together = np.zeros(len(found), bool)
    most = agreement.similarity(before_px[found], at_px[found], apart_px, _LEAST_TOGETHER, _MOST_SAMPLES)
    if most is None:
        return np.eye(3), together
    cur_H_before, together[found] = most
    return cur_H_before, together


def _flowed(first: Gray, second: Gray, from_px: FloatArray, start_px: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Points of the first image in the second, (N, 2), by optical flow, and which of them were found."""
    levels = max(0, int(np.log2(min(first.shape) / _COARSEST_PX)))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.03)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, from_px.astype(np.float32), start_px.astype(np.float32), winSize=(_FLOW_BLOCK_PX,) * 2,
        maxLevel=levels, criteria=criteria, flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    return moved.astype(np.float64), status.ravel().astype(bool)
