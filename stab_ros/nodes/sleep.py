"""When a node sleeps because nobody listens to it; without ROS."""

from __future__ import annotations

_PATIENCE = 10  # looks without a listener: one that subscribes anew, as with another QoS, is away for a moment


class Sleep:
    """Whether a node sleeps.

    allowed: whether it may sleep at all. is_asleep: it does from its start until somebody listens. is_settled: and
    nobody who has just started is about to wake it.
    """

    def __init__(self, allowed: bool) -> None:
        self._allowed = allowed
        self._unheard = _PATIENCE
        self.is_asleep = allowed

    @property
    def is_settled(self) -> bool:
        return self.is_asleep and self._unheard >= 2 * _PATIENCE

    def look(self, subscribers: int, busy: bool) -> None:
        """To be called periodically. subscribers: of all outputs. busy: with something that must be ended first."""
        self._unheard = 0 if subscribers else self._unheard + 1
        self.is_asleep = self._allowed and self._unheard >= _PATIENCE and (self.is_asleep or not busy)
