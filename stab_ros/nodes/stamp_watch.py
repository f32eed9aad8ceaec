"""What is odd about the header stamps of a stream: counted, and put into words."""

from __future__ import annotations

from collections import Counter

from stab_ros.core.timeline import Advance, Timeline

_SAYS = {
    Advance.ZERO: "a header stamp is zero, the camera driver must stamp its images; the motion is not predicted",
    Advance.SAME: "an image has the header stamp of the one before, it is dropped as a duplicate",
    Advance.BACK: "header stamps went back by {step_s:.3f} s, the motion is predicted anew",
    Advance.AHEAD: "header stamps jumped ahead by {step_s:.3f} s, the motion is predicted anew",
}


class StampWatch:
    """Follows the images of one stream that are answered."""

    def __init__(self) -> None:
        self._timeline = Timeline()
        self._last_ns, self._step_s = 0, 0.0
        self._counts: Counter[Advance] = Counter()

    def is_duplicate(self, stamp_ns: int) -> bool:
        """Whether the last image that was answered had this stamp; zero is none."""
        duplicate = stamp_ns == self._last_ns != 0
        self._counts[Advance.SAME] += duplicate
        return duplicate

    def take(self, stamp_ns: int) -> Advance:
        """What the stamp of the next image is."""
        step, self._step_s = self._timeline.take(stamp_ns), abs(stamp_ns - self._last_ns) / 1e9
        self._counts[step] += 1
        self._last_ns = stamp_ns or self._last_ns
        return step

    def words(self, step: Advance) -> str:
        """What is to be said of the last stamp ("": nothing)."""
        return _SAYS.get(step, "").format(step_s=self._step_s)

    @property
    def counts(self) -> dict[str, str]:
        """For /diagnostics: stamps_zero, stamps_duplicate, stamps_back, stamps_ahead."""
        return {f"stamps_{step.value}": str(self._counts[step]) for step in _SAYS}
