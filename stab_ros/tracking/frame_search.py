"""The ways to find a frame in another one: around a position that is roughly known, and anywhere."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.tracking.area_search import find_by_areas
from stab_ros.tracking.full_size_features import FullSizeFeatures
from stab_ros.tracking.phase_correlation import PhaseCorrelation
from stab_ros.tracking.relocation import OnGround, Relocation


class FrameSearch:
    """Finds frames in one frame, called "own". What is made of that frame is made once, when it is needed first."""

    def __init__(self, gray: Gray) -> None:
        """gray: (h, w) uint8, not copied."""
        self._gray = gray
        self._full_size: tuple[FloatArray, FullSizeFeatures] | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self._gray.shape[1], self._gray.shape[0]

    @cached_property
    def _phase_correlation(self) -> PhaseCorrelation:
        return PhaseCorrelation(self._gray)

    @cached_property
    def _relocation(self) -> Relocation:
        return Relocation(self._gray)

    def by_areas(self, current: Gray, guess: Homography, ground_px: FloatArray, radius_px: int) -> Homography | None:
        """own_H_cur near `guess`, by areas around points of static ground, (N, 2); None where too few agree."""
        return find_by_areas(self._gray, current, guess, ground_px, radius_px)

    def by_shift(self, current: Gray, guess: Homography) -> Homography | None:
        """own_H_cur: `guess` corrected by the shift that phase correlation finds; None: no clear one."""
        return self._phase_correlation.corrected(current, guess)

    def by_small_pictures(self, current: Gray, on_ground: OnGround) -> Homography | None:
        """own_H_cur by SIFT features of reduced images on static ground, anywhere; None where too few agree."""
        return self._relocation.find(current, on_ground)

    def by_full_size(self, current: FullSizeFeatures, centre_px: FloatArray, on_ground: OnGround) -> Homography | None:
        """own_H_cur by features at full size on static ground around a point (2,); None where too few agree."""
        own = self._features_around(centre_px)
        return own.among(on_ground(own.px)).locate(current)

    def _features_around(self, centre_px: FloatArray) -> FullSizeFeatures:
        """Those found for an earlier point if it was near."""
        before = self._full_size
        if before is None or np.abs(before[0] - centre_px).max() > FullSizeFeatures.NEAR_PX:
            before = self._full_size = centre_px, FullSizeFeatures.of(self._gray, centre_px)
        return before[1]
