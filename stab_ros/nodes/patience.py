"""How long frames wait for a topic, in the free time of the node; without ROS."""

from __future__ import annotations


class Patience:
    """is_over: frames have waited for the topic in vain for `limit_ns`; it is worth waiting again once it speaks.

    While nothing waits, silence says nothing: a tracker whose camera pauses is silent too. All times are of the node's
    `FreeTime`, ns.
    """

    def __init__(self, limit_ns: int) -> None:
        self.is_over = False
        self._limit_ns = limit_ns
        self._since_ns: int | None = None  # when frames began to wait, or it spoke last

    def heard(self, free_ns: int) -> None:
        """A message of the topic has come."""
        self.is_over, self._since_ns = False, free_ns

    def check(self, free_ns: int, something_waits: bool) -> bool:
        """`is_over`, now. something_waits: whether a frame waits for the topic."""
        if not something_waits:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = free_ns
        elif free_ns - self._since_ns > self._limit_ns:
            self.is_over = True
        return self.is_over
