"""Header stamps of a stream: how each follows the previous one, and a time axis without the jumps of a clock."""

from __future__ import annotations

from enum import Enum

_FAR_NS = 60 * 10**9  # no camera pauses for so long: its clock was set, or another recording begins


class Advance(Enum):
    """How a stamp follows the previous one. AHEAD: by more than a camera pauses."""

    STEADY = "steady"
    ZERO = "zero"
    SAME = "duplicate"
    BACK = "back"
    AHEAD = "ahead"


def judge(stamp_ns: int, last_ns: int | None) -> Advance:
    """How `stamp_ns` follows `last_ns`, the last stamp that was not zero (None: there is none yet)."""
    if stamp_ns == 0:
        return Advance.ZERO
    if last_ns is None:
        return Advance.STEADY
    if stamp_ns <= last_ns:
        return Advance.SAME if stamp_ns == last_ns else Advance.BACK
    return Advance.AHEAD if stamp_ns - last_ns > _FAR_NS else Advance.STEADY


class Timeline:
    """now_ns: the time of the last frame, equal to its stamp until the stamps jump.

    A late frame and the start of a loop move time back. A jump by more than a camera pauses does not move time, nor
    does a stamp of zero.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        self._offset_ns = 0  # from stamps to time
        self._last_ns: int | None = None
        self._begun = False

    def take(self, stamp_ns: int) -> Advance:
        """The next frame."""
        step, last_ns = judge(stamp_ns, self._last_ns), self._last_ns
        if stamp_ns != 0:
            if self._begun and (last_ns is None or abs(stamp_ns - last_ns) > _FAR_NS):
                self._offset_ns = self.now_ns - stamp_ns
            self._last_ns, self.now_ns = stamp_ns, stamp_ns + self._offset_ns
        self._begun = True
        return step
