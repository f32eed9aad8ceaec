"""When the frames of a video were taken."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from stab_ros.io.frame_reader import FIRST_STAMP_NS, stamp_ns

_RESTART_S = 1  # a time that goes back further begins a new count, as in recordings that were joined


@dataclass(frozen=True)
class Timing:
    """What a container says of time.

    Attributes:
        fps: nominal frame rate.
        tick_s: unit of its presentation times, s; None: it has none, or they are to be ignored.
    """

    fps: Fraction
    tick_s: Fraction | None


class VideoClock:
    """Turns presentation times, in the order of display, into stamps that increase; the first is 1 s.

    A time that a constant rate explains but for the rounding to ticks becomes `1 s + k/fps`, which is exact. A time
    that is missing follows the last one by a frame, one that repeats or goes back by half a frame.

    Attributes:
        frames: number of times so far.
        missing, wrong: number of times that are missing, and that repeat or go back.
        last_ns: the last stamp.
    """

    def __init__(self, timing: Timing) -> None:
        self.frames = self.missing = self.wrong = 0
        self.last_ns = 0
        self._timing = timing
        self._origin: Fraction | None = None  # the presentation time of the first frame, s
        self._last: Fraction | None = None  # of the last frame, s since the first

    @property
    def duration_s(self) -> float:
        """From the first frame to the last, s."""
        return max(0, self.last_ns - FIRST_STAMP_NS) / 1e9

    def stamp_ns(self, pts: int | None) -> int:
        """pts: presentation time in ticks; None: unknown."""
        self.frames += 1
        time = self._time(pts)
        self._last, self.last_ns = time, max(self._stamp(time), self.last_ns + 1)
        return self.last_ns

    def _time(self, pts: int | None) -> Fraction:
        frame = 1 / self._timing.fps
        if pts is None or self._timing.tick_s is None:
            self.missing += self._timing.tick_s is not None
            return Fraction(0) if self._last is None else self._last + frame
        shown = pts * self._timing.tick_s
        following = Fraction(0) if self._last is None else self._last + frame
        if self._origin is None:
            self._origin = shown - following
        time = shown - self._origin
        if self._last is None or time > self._last:
            return time
        self.wrong += 1
        if time < self._last - _RESTART_S:
            self._origin = shown - following
            return following
        return self._last + frame / 2

    def _stamp(self, time: Fraction) -> int:
        fps = self._timing.fps
        number = round(time * fps)
        if abs(time - number / fps) < (self._timing.tick_s or 1 / fps):
            return stamp_ns(number, float(fps))
        return FIRST_STAMP_NS + round(time * 10**9)


@dataclass(frozen=True)
class Pace:
    """How the frames of a video follow each other.

    Attributes:
        frames: their number.
        duration_s: from the first to the last, s.
        shortest_s, longest_s: the steps between them, s; 0 for a single frame.
        constant: do they keep the nominal rate?
        fps: nominal rate if constant, else the mean one, frames/s.
    """

    frames: int
    duration_s: float
    shortest_s: float
    longest_s: float
    constant: bool
    fps: float


def pace(timing: Timing, times: Iterable[int | None]) -> Pace:
    """Of these presentation times, in any order."""
    known, clock = list(times), VideoClock(timing)
    if None not in known:
        known.sort(key=lambda pts: pts or 0)
    stamps = [clock.stamp_ns(pts) for pts in known]
    nominal = float(timing.fps)
    constant = all(stamp == stamp_ns(number, nominal) for number, stamp in enumerate(stamps))
    steps = [(b - a) / 1e9 for a, b in itertools.pairwise(stamps)]
    mean = len(steps) / math.fsum(steps) if steps else nominal
    return Pace(len(stamps), math.fsum(steps), min(steps, default=0.0), max(steps, default=0.0), constant,
                nominal if constant else mean)
