"""Classification of header stamps, and a continuous time across clock changes."""

from __future__ import annotations

from enum import Enum

_FAR_NS = 60 * 10**9  # a larger step is a clock change or another recording, not a pause of the camera


class Advance(Enum):
    """Step from the previous stamp to the current one. SAME: duplicate stamp. AHEAD: a step of more than a minute."""

    STEADY = "steady"
    ZERO = "zero"
    SAME = "duplicate"
    BACK = "back"
    AHEAD = "ahead"


class Timeline:
    """Time of the stream, from header stamps.

    The time equals the stamp until the stamp jumps by more than a minute in either direction. From then on a constant
    offset keeps the time continuous. Smaller steps backwards (late frames, short loops) move the time backwards, too.
    Frames with a stamp of 0 do not change the time.

    Attributes:
        now_ns: time of the last frame.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        self._offset_ns = 0  # time minus stamp
        self._last_ns: int | None = None
        self._begun = False

    def take(self, stamp_ns: int) -> Advance:
        """Advances to the next frame's stamp, ns, and classifies the step."""
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
