"""Where a frame is looked for: initial guesses of its homography, in growing order of cost.

A usual frame pays for the first only. Each of the others is limited in its number of pixels or features, so that a
frame that is found nowhere costs at most about ten tracked ones at any size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from stab_ros.core.geometry import apply, normalized, rms_distance
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography
from stab_ros.tracking.anchor import Anchor
from stab_ros.tracking.frame_search import FrameSearch
from stab_ros.tracking.full_size_features import FullSizeFeatures
from stab_ros.tracking.ground import Ground
from stab_ros.tracking.motion import CameraMotion
from stab_ros.tracking.reference import is_textured
from stab_ros.tracking.strategies import Strategy

_NEAR = (1 / 30, 32, 64)  # radius of the first search: share of the width, least and most px
_WIDE = (1 / 7.5, 96, 192)  # of the second one at least, and at most
_SPREAD = 3.0  # times what is usual
_SAME_PX = 2.0  # guesses that are closer lead to the same result

Guess = tuple[Anchor, Homography]
Find = Callable[[], Homography | None]


class Recovery:
    """Looks for the frames of one reference. It keeps the last frame that was found."""

    def __init__(self, ground: Ground) -> None:
        """ground: static ground of the reference, which changes as it becomes known."""
        self._ground = ground
        self._last: tuple[FrameSearch, Homography] | None = None

    def keep(self, gray: Gray, ref_H_cur: Homography) -> None:
        """A frame, (h, w) uint8, was found there."""
        self._last = FrameSearch(gray.copy()), ref_H_cur

    def guesses(self, strategy: Strategy, motion: CameraMotion, gray: Gray, time_ns: int) -> Iterator[Guess]:
        """Anchors and initial ref_H_cur for a frame, (h, w) uint8, taken at `time_ns`."""
        expected = motion.predict(time_ns)
        anchor = strategy.choose(expected)
        yield anchor, expected
        if not is_textured(gray):
            return
        for one, find in self._searches(strategy, anchor, motion, gray, time_ns):
            found = find()
            if found is not None:
                yield one, found

    def _searches(self, strategy: Strategy, anchor: Anchor, motion: CameraMotion, gray: Gray,
                  time_ns: int) -> Iterator[tuple[Anchor, Find]]:
        """Anchors, and what finds the frame in each."""
        expected, last = motion.predict(time_ns), motion.last
        near_px, wide_px = _radii(anchor.size, motion.usual_px(time_ns))
        yield anchor, lambda: anchor.searched(gray, expected, near_px)
        if rms_distance(expected, last, anchor.size) > _SAME_PX:
            yield anchor, lambda: last
        yield anchor, lambda: anchor.searched(gray, last, wide_px)
        features, others = FullSizeFeatures.of(gray, anchor.ground_seen(last)), strategy.others(last)
        yield from ((one, partial(one.recognized, features, last)) for one in (anchor, *others[:1]))
        yield anchor, lambda: self._from_last(features)
        yield anchor, lambda: anchor.shifted(gray, last)
        yield from ((one, partial(one.relocated, gray)) for one in (anchor, *others))

    def _from_last(self, features: FullSizeFeatures) -> Homography | None:
        """ref_H_cur by features at full size that the last frame showed, too."""
        if self._last is None:
            return None
        search, ref_H_last = self._last
        found = search.by_full_size(features, features.centre_px, lambda px: self._on_ground(ref_H_last, px))
        return None if found is None else normalized(ref_H_last @ found)

    def _on_ground(self, ref_H_last: Homography, last_px: FloatArray) -> BoolArray:
        return self._ground.contains(apply(ref_H_last, last_px))


def _radii(size: tuple[int, int], usual_px: float | None) -> tuple[int, int]:
    """Radii of the two searches for a frame of `size` that is usually so far off."""
    off_px = 0.0 if usual_px is None else _SPREAD * usual_px
    near, wide = (int(np.clip(max(share * size[0], off_px), least, most)) for share, least, most in (_NEAR, _WIDE))
    return near, wide
