"""Counts lost messages: with RELIABLE the middleware does not report those that a newer message replaced."""

from __future__ import annotations


class GapCounter:
    """How many messages of a publisher never arrived, from the gaps in its numbering.

    before: how many messages the publisher had sent before the first that arrived.
    """

    def __init__(self) -> None:
        self.before = 0
        self._last: int | None = None
        self._begun = False

    def suspend(self) -> None:
        """What is published until the next message arrives is not missed."""
        self._last = None

    def missed(self, number: int, publishers: int = 1) -> int:
        """Messages missing before this one; 0 for the first, when a publisher starts anew, and for mixed numberings."""
        last, self._last = self._last, number
        if not self._begun:
            self.before, self._begun = max(number - 1, 0), True
        if last is None or publishers > 1 or number <= last:
            return 0
        return number - last - 1
