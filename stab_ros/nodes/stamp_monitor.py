"""Irregular header stamps of an image stream: counted for the diagnostics, and described for the log."""

from __future__ import annotations

from collections import Counter

from stab_ros.core.timeline import Advance, judge
from stab_ros.io.stamp_check import StampCheck

_CHECKED = 50  # images after each other
_FACTOR = 20.0  # replays are slower and faster by less

_WORDS = {
    Advance.ZERO: "a header stamp is zero, the camera driver must stamp its images; the motion is not predicted",
    Advance.SAME: "an image has the header stamp of the previous image, it is dropped as a duplicate",
    Advance.BACK: "header stamps went back by {step_s:.3f} s, the motion prediction is reset",
    Advance.AHEAD: "header stamps jumped ahead by {step_s:.3f} s, the motion prediction is reset",
}


class StampMonitor:
    """Follows the stamps of the images of one stream that are tracked."""

    def __init__(self) -> None:
        self._last_ns: int | None = None  # of the last image with a stamp other than zero
        self._step_s = 0.0
        self._counts: Counter[Advance] = Counter()
        self._check, self._checked = _new_check(), 0

    def is_duplicate(self, stamp_ns: int) -> bool:
        """Whether the last tracked image has this stamp; counts it if so. Stamps of zero are never duplicates."""
        duplicate = judge(stamp_ns, self._last_ns) is Advance.SAME
        self._counts[Advance.SAME] += duplicate
        return duplicate

    def suspend(self) -> None:
        """Images are left out from here on: the next stamp is that of a first image."""
        self._last_ns = None
        self._check, self._checked = _new_check(), 0

    def take(self, stamp_ns: int) -> Advance:
        """Counts the stamp of the next tracked image."""
        step, self._step_s = judge(stamp_ns, self._last_ns), abs(stamp_ns - (self._last_ns or 0)) / 1e9
        self._counts[step] += 1
        self._last_ns = stamp_ns or self._last_ns
        return step

    def words(self, step: Advance) -> str:
        """The message about the last stamp; "" for a regular one."""
        return _WORDS.get(step, "").format(step_s=self._step_s)

    def rate_fault(self, stamp_ns: int, source_ns: int) -> str:
        """Takes a tracked image and the time of its publication, ns; says what is wrong with the steps of the stamps.

        An empty string where nothing is, and until enough images have come.
        """
        self._check.add(stamp_ns, source_ns, source_ns)
        self._checked += 1
        if self._checked < _CHECKED:
            return ""
        fault = self._check.rate_fault()
        self._check, self._checked = _new_check(), 0
        return f"{fault}; the camera driver must stamp its images with the time in nanoseconds" if fault else ""

    @property
    def counts(self) -> dict[str, str]:
        """For /diagnostics: stamps_zero, stamps_duplicate, stamps_back, stamps_ahead."""
        return {f"stamps_{step.value}": str(self._counts[step]) for step in _WORDS}


def _new_check() -> StampCheck:
    return StampCheck(_FACTOR, "they are published every")
