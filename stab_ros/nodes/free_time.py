"""A clock that runs only while a node has nothing to do: the time base of silence."""

from __future__ import annotations


class FreeTime:
    """ns: how long the node has waited so far.

    It stands still while a callback runs, as messages may be waiting meanwhile. A wait counts for no more than its
    timeout: a process that was stopped, or got no CPU, was not free.
    """

    def __init__(self) -> None:
        self.ns = 0
        self._reported = False

    def waited(self, elapsed_ns: int, most_ns: int) -> None:
        """A wait has ended. most_ns: its timeout."""
        self._reported = True
        self.ns += max(0, min(elapsed_ns, most_ns))

    def ticked(self, period_ns: int) -> None:
        """A timer of the node has fired: it stands for the waits of an executor that does not report them."""
        if not self._reported:
            self.ns += period_ns
