"""Tracks a flight with the engine as the commands do, and says which answers are lies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from lies.oracle import Oracle
from lies.render import Flight
from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import Frame, Track
from stab_ros.parameters.engines import make_stabilizer

GRAVE, DOUBTFUL, FAR, LOST = "grave", "sigma", "far", "lost"
LIES = (GRAVE, DOUBTFUL, LOST)
_FAR_PX, _MANY_SIGMAS = 1.0, 4.0
_EXACT_PX = 0.02  # below this, the truth of the pictures itself is not known well enough
_FOUND_PX = 0.3  # of an oracle that has found the ground


@dataclass(frozen=True)
class Verdict:
    """What is to be said of one frame.

    Attributes:
        seed: of the flight.
        frame: its number.
        reference: number of the frame it was registered to.
        tracked: whether it was.
        garbage: whether the frame shows anything else.
        error_px: distance from the truth, RMS over the grid; of a LOST frame that of the oracle; NaN: unknown.
        sigma_px: as the tracker has it.
        said: one of grave (over 1 px and 4 sigma), sigma (over 4 sigma), far (over 1 px, and sigma says so), lost
            (although the oracle finds the ground); empty: nothing.
        reason: why the frame is LOST, in the tracker's words; empty: it is not.
    """

    seed: int
    frame: int
    reference: int
    tracked: bool
    garbage: bool
    error_px: float
    sigma_px: float
    said: str
    reason: str = ""

    @property
    def lie(self) -> bool:
        """Whether it is a lie."""
        return self.said in LIES

    @property
    def counts(self) -> bool:
        """Whether error and sigma count in the statistics: a tracked frame of the ground that is no reference."""
        return self.tracked and not self.garbage and self.frame != self.reference


def judge(flight: Flight, values: Mapping[str, Value]) -> list[Verdict]:
    """Tracks a flight.

    Args:
        flight: the flight.
        values: parameters of the tracker by name, which differ from the default.

    Returns:
        A verdict on every frame, in order.
    """
    jury = _Jury(flight)
    return [jury.verdict(track) for track in _tracks(flight, {"threads": 1, **values})]


def _tracks(flight: Flight, values: Mapping[str, Value]) -> list[Track]:
    stabilizer, tracks = make_stabilizer(values), []
    for k, picture in enumerate(flight.pictures):
        tracks += stabilizer.answers(Frame(picture, "mono8", flight.stamp_ns(k)))
    return sorted([*tracks, *stabilizer.finish()], key=lambda track: track.index)


class _Jury:
    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._oracle = lru_cache(maxsize=2)(lambda k: Oracle(flight.pictures[k]))

    def verdict(self, track: Track) -> Verdict:
        reference = self._reference(track)
        if track.ref_H_cur is None or track.sigma_px is None:
            reason = track.lost_reason.value if track.lost_reason else ""
            return replace(self._of_lost(track.index, reference), reason=reason)
        true_H = self._flight.true_H(track.index, reference)
        error_px = rms_distance(track.ref_H_cur, true_H, self._flight.recipe.size)
        said = "" if track.index == reference else said_of(error_px, track.sigma_px)
        return self._verdict(track.index, reference, error_px, track.sigma_px, said)

    def _reference(self, track: Track) -> int:
        """The frame that was or should have been the reference: the first good one where there is none."""
        first = int(self._flight.garbage.argmin())
        own = self._flight.frame_of(track.reference_stamp_ns) if track.reference_stamp_ns else first
        return own if track.tracked or not self._flight.garbage[own] else first

    def _of_lost(self, k: int, reference: int) -> Verdict:
        if self._flight.garbage[k] or k == reference:
            return self._verdict(k, reference, math.nan, math.nan, "")
        error_px = self._found(k, reference)
        return self._verdict(k, reference, error_px, math.nan, LOST if error_px <= _FOUND_PX else "")

    def _found(self, k: int, reference: int) -> float:
        """Error of the oracle, px; infinite where it finds nothing."""
        H = self._oracle(reference).homography(self._flight.pictures[k])
        return math.inf if H is None else rms_distance(H, self._flight.true_H(k, reference), self._flight.recipe.size)

    def _verdict(self, k: int, reference: int, error_px: float, sigma_px: float, said: str) -> Verdict:
        return Verdict(self._flight.recipe.seed, k, reference, not math.isnan(sigma_px), bool(self._flight.garbage[k]),
                       error_px, sigma_px, said)


def said_of(error_px: float, sigma_px: float) -> str:
    """The word for a tracked frame that is off by this much."""
    beyond = error_px > _MANY_SIGMAS * sigma_px and error_px > _EXACT_PX
    if error_px > _FAR_PX:
        return GRAVE if beyond else FAR
    return DOUBTFUL if beyond else ""
