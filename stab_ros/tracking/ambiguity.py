"""An ambiguous choice of ground, weighed again as the flight goes on: water keeps flowing, a camera hovers."""

from __future__ import annotations

from enum import Enum

import numpy as np

from stab_ros.core.geometry import inflated, normalized, shift
from stab_ros.core.types import FloatArray, Homography
from stab_ros.tracking.drift import drift_odds, drift_px
from stab_ros.tracking.ground_choice import CERTAIN_ODDS, CompetingHypothesis
from stab_ros.tracking.static_map import StaticMap

_PATIENCE_S = 3.0  # from the reference on, before anything is decided
_AT_REST_PX = 5.0  # what has left its place by more is not fixed to the camera


class Verdict(Enum):
    """OPEN: both planes can still be the ground. SETTLED: the chosen one is. TURNED: the other one is."""

    OPEN = 0
    SETTLED = 1
    TURNED = 2


class Ambiguity:
    """Two hypotheses: the chosen plane is the ground, or the other one is."""

    def __init__(self, other: CompetingHypothesis, other_map: StaticMap, start_ns: int, size: tuple[int, int]) -> None:
        """other_map: where ground is by the other hypothesis. start_ns: time of the reference. size: of it, px."""
        self.other, self.other_map = other, other_map
        self._start_ns, self._size = start_ns, size

    def spread(self, ref_H_cur: Homography, time_ns: int) -> FloatArray:
        """Covariance (8, 8) of h00 .. h21: one sigma is how far apart the two hypotheses place the frame."""
        x, y = self._apart_px(time_ns)
        change = np.concatenate([x * ref_H_cur[2], y * ref_H_cur[2], np.zeros(2)])
        return inflated(np.outer(change, change), ref_H_cur, np.eye(2) * self.other.sway_px**2 / 2)

    def weigh(self, ref_H_cur: Homography, time_ns: int) -> Verdict:
        """By how far each plane has drifted until now; the other cues stay as they were.

        What is fixed to the camera never drifts, so that is no evidence for a plane that is still at rest in the image.
        """
        elapsed_s = self._elapsed_s(time_ns)
        if elapsed_s < _PATIENCE_S:
            return Verdict.OPEN
        chosen_px, other_px = (drift_px(H, self._size) for H in (ref_H_cur, self.by_other(ref_H_cur, time_ns)))
        resting = self.other.overlaid and (other_px if self.other.plane.at_rest else chosen_px) < _AT_REST_PX
        if resting:
            return Verdict.OPEN
        odds = self.other.odds_without_drift + drift_odds(chosen_px, other_px, self._size[0], elapsed_s)
        if odds > CERTAIN_ODDS:
            return Verdict.SETTLED
        return Verdict.TURNED if odds < -CERTAIN_ODDS else Verdict.OPEN

    def by_other(self, ref_H_cur: Homography, time_ns: int) -> Homography:
        """Where the frame lies by the other hypothesis, if that plane has moved on at its velocity."""
        x, y = self._apart_px(time_ns)
        return normalized(shift(-x, -y) @ ref_H_cur)

    def _apart_px(self, time_ns: int) -> tuple[float, float]:
        """How far the other plane has moved in the reference while the chosen one stood still, x and y, px."""
        (x, y), elapsed_s = self.other.rate_px, self._elapsed_s(time_ns)
        return x * elapsed_s, y * elapsed_s

    def _elapsed_s(self, time_ns: int) -> float:
        return (time_ns - self._start_ns) / 1e9
