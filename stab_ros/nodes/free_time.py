"""A clock that goes only while a node is free and nothing is there for it to do: what silence is measured by."""

from __future__ import annotations


class FreeTime:
    """ns: how long the node has waited so far.

    While a callback runs it stands still, however long that takes: messages may be waiting meanwhile. And a wait counts
    for no more than it was meant to last: a process that was stopped, or got no CPU, was not free.
    """

    def __init__(self) -> None:
        self.ns = 0
        self._told = False

    def waited(self, elapsed_ns: int, most_ns: int) -> None:
        """A wait that has ended by itself or by something to do. most_ns: how long it was meant to last."""
        self._told = True
        self.ns += max(0, min(elapsed_ns, most_ns))

    def ticked(self, period_ns: int) -> None:
        """A timer of the node has called: stands for a wait in an executor that is not ours, and tells of none."""
        if not self._told:
            self.ns += period_ns
