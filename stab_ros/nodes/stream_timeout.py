"""How long an image stream has been silent, in the free time of its node; without ROS."""

from __future__ import annotations

_LONG, _SLOW = 5, 3  # times stale_s, times the interval between the last two images


class StreamTimeout:
    """stale_ns: silence after which the stream counts as stopped. All times are of the node's `FreeTime`, ns."""

    def __init__(self, stale_ns: int) -> None:
        self._stale_ns = stale_ns
        self._interval_ns = 0
        self._last_ns: int | None = None

    @property
    def has_begun(self) -> bool:
        """Whether any image has arrived."""
        return self._last_ns is not None

    def on_image(self, free_ns: int) -> int:
        """An image has arrived; returns the silence before it."""
        silence_ns, self._last_ns = self.silence_ns(free_ns), free_ns
        self._interval_ns = silence_ns
        return silence_ns

    def suspend(self) -> None:
        """No images are expected until the next one: what is silent now is no stream that stopped."""
        self._last_ns = None

    def silence_ns(self, free_ns: int) -> int:
        """Time since the last image; 0 before the first."""
        return 0 if self._last_ns is None else free_ns - self._last_ns

    def is_stale(self, free_ns: int) -> bool:
        """Whether images have arrived, but none for too long."""
        return self.silence_ns(free_ns) > self._stale_ns

    def is_pause(self, free_ns: int) -> bool:
        """Whether the silence is longer than a short stall, and than the interval of a slow stream."""
        return self.silence_ns(free_ns) > max(_LONG * self._stale_ns, _SLOW * self._interval_ns)
