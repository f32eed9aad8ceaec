"""Irregular header stamps of an image stream: counted for the diagnostics, and described for the log."""

from __future__ import annotations

from collections import Counter

from stab_ros.core.timeline import Advance, judge

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

    def is_duplicate(self, stamp_ns: int) -> bool:
        """Whether the last tracked image has this stamp; counts it if so. Stamps of zero are never duplicates."""
        duplicate = judge(stamp_ns, self._last_ns) is Advance.SAME
        self._counts[Advance.SAME] += duplicate
        return duplicate

    def take(self, stamp_ns: int) -> Advance:
        """Counts the stamp of the next tracked image."""
        step, self._step_s = judge(stamp_ns, self._last_ns), abs(stamp_ns - (self._last_ns or 0)) / 1e9
        self._counts[step] += 1
        self._last_ns = stamp_ns or self._last_ns
        return step

    def words(self, step: Advance) -> str:
        """The message about the last stamp; "" for a regular one."""
        return _WORDS.get(step, "").format(step_s=self._step_s)

    @property
    def counts(self) -> dict[str, str]:
        """For /diagnostics: stamps_zero, stamps_duplicate, stamps_back, stamps_ahead."""
        return {f"stamps_{step.value}": str(self._counts[step]) for step in _WORDS}
