"""A choice of ground that was ambiguous, weighed again as the flight goes on: water keeps going, a camera hovers."""

from __future__ import annotations

from enum import Enum

import numpy as np

from stab_ros.core.geometry import normalized, shift
from stab_ros.core.types import FloatArray, Homography
from stab_ros.tracking.ground_choice import CompetingHypothesis, drift_odds, drift_px
from stab_ros.tracking.static_map import StaticMap

_PATIENCE_S = 3.0  # from the reference on, before anything is decided
_DECIDED = 1.5  # logarithm of the odds


class Verdict(Enum):
    """OPEN: both planes may still be the ground. SETTLED: the chosen one is. TURNED: the rival is."""

    OPEN = 0
    SETTLED = 1
    TURNED = 2


class Ambiguity:
    """Between the chosen ground and its rival, since a reference of `size` (width, height) at `start_ns`."""

    def __init__(self, rival: CompetingHypothesis, rival_map: StaticMap, start_ns: int, size: tuple[int, int]) -> None:
        """rival_map: where ground is if the rival is it."""
        self.rival, self.rival_map = rival, rival_map
        self._start_ns, self._size = start_ns, size

    def spread(self, ref_H_cur: Homography, time_ns: int) -> FloatArray:
        """Covariance (8, 8) of h00 .. h21: one sigma is how far apart the two planes put the frame."""
        x, y = self._away_px(time_ns)
        change = np.concatenate([x * ref_H_cur[2], y * ref_H_cur[2], np.zeros(2)])
        return np.asarray(np.outer(change, change))

    def weigh(self, ref_H_cur: Homography, time_ns: int) -> Verdict:
        """By how far each plane has been carried until now; the other cues stay what they were."""
        elapsed_s = self._elapsed_s(time_ns)
        if elapsed_s < _PATIENCE_S:
            return Verdict.OPEN
        chosen_px, other_px = (drift_px(H, self._size) for H in (ref_H_cur, self.by_rival(ref_H_cur, time_ns)))
        odds = self.rival.odds_without_drift + drift_odds(chosen_px, other_px, self._size[0], elapsed_s)
        if odds > _DECIDED:
            return Verdict.SETTLED
        return Verdict.TURNED if odds < -_DECIDED else Verdict.OPEN

    def by_rival(self, ref_H_cur: Homography, time_ns: int) -> Homography:
        """Where the frame lies if the rival is the ground, and has gone on as it did."""
        x, y = self._away_px(time_ns)
        return normalized(shift(-x, -y) @ ref_H_cur)

    def _away_px(self, time_ns: int) -> tuple[float, float]:
        """Where the rival has gone in the reference while the chosen plane stood still, x and y, px."""
        (x, y), elapsed_s = self.rival.rate_px, self._elapsed_s(time_ns)
        return x * elapsed_s, y * elapsed_s

    def _elapsed_s(self, time_ns: int) -> float:
        return (time_ns - self._start_ns) / 1e9
