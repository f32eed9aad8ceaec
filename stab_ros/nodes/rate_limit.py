"""Thins out a stream to a rate, by its header stamps; without ROS."""

from __future__ import annotations

from stab_ros.io.cdr import SECOND_NS


class RateLimit:
    """On average `rate_hz` items a second pass, also where the intervals between them vary."""

    def __init__(self) -> None:
        self._due_ns = self._last_ns = 0

    def passes(self, stamp_ns: int, rate_hz: float) -> bool:
        """Whether the item with this stamp passes; all do at a rate of 0, and the first after stamps went back."""
        period_ns = round(SECOND_NS / rate_hz) if rate_hz else 0
        back, self._last_ns = stamp_ns < self._last_ns, stamp_ns
        if stamp_ns < self._due_ns <= stamp_ns + period_ns and not back:
            return False
        in_step = self._due_ns <= stamp_ns < self._due_ns + period_ns and not back
        self._due_ns = (self._due_ns if in_step else stamp_ns) + period_ns
        return True
