"""How long a stream of images has been silent, by the free time of its node; without ROS."""

from __future__ import annotations

_LASTING, _SLOW = 5, 3  # times stale_s, times the interval between the last two images


class Silence:
    """stale_ns: silence from which the stream counts as stopped. All times are of the node's `FreeTime`, ns."""

    def __init__(self, stale_ns: int) -> None:
        self._stale_ns = stale_ns
        self._interval_ns = 0
        self._last_ns: int | None = None

    @property
    def begun(self) -> bool:
        """Whether there was any image."""
        return self._last_ns is not None

    def broken(self, free_ns: int) -> int:
        """An image has come; how long there was none before."""
        silent_ns, self._last_ns = self.ns(free_ns), free_ns
        self._interval_ns = silent_ns
        return silent_ns

    def ns(self, free_ns: int) -> int:
        """Since the last image; 0 before the first."""
        return 0 if self._last_ns is None else free_ns - self._last_ns

    def is_stale(self, free_ns: int) -> bool:
        """Whether images came, but none for too long."""
        return self.ns(free_ns) > self._stale_ns

    def is_lasting(self, free_ns: int) -> bool:
        """Whether it is longer than the pause of a player, or than a slow stream is silent between its images."""
        return self.ns(free_ns) > max(_LASTING * self._stale_ns, _SLOW * self._interval_ns)
