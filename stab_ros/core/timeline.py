"""Header stamps as they come, judged, and a time that goes on evenly where a clock was set."""

from __future__ import annotations

from enum import Enum

_FAR_NS = 60 * 10**9  # no camera pauses for so long: its clock was set, or another recording begins


class Advance(Enum):
    """From the stamp before to this one. SAME: a duplicate. AHEAD: further than a camera pauses."""

    STEADY = "steady"
    ZERO = "zero"
    SAME = "duplicate"
    BACK = "back"
    AHEAD = "ahead"


class Timeline:
    """now_ns: the time of the last frame, its stamp until a clock is set; what was measured before stays valid.

    A late frame, and the start of a loop, take time back with them. A far jump does not, and a stamp of zero is none.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        self._offset_ns = 0  # from stamps to time
        self._last_ns: int | None = None
        self._begun = False

    def take(self, stamp_ns: int) -> Advance:
        """The next frame."""
        step, last_ns = self._judge(stamp_ns), self._last_ns
        if stamp_ns != 0:
            if self._begun and (last_ns is None or abs(stamp_ns - last_ns) > _FAR_NS):
                self._offset_ns = self.now_ns - stamp_ns
            self._last_ns, self.now_ns = stamp_ns, stamp_ns + self._offset_ns
        self._begun = True
        return step

    def _judge(self, stamp_ns: int) -> Advance:
        last_ns = self._last_ns
        if stamp_ns == 0:
            return Advance.ZERO
        if last_ns is None:
            return Advance.STEADY
        if stamp_ns <= last_ns:
            return Advance.SAME if stamp_ns == last_ns else Advance.BACK
        return Advance.AHEAD if stamp_ns - last_ns > _FAR_NS else Advance.STEADY
