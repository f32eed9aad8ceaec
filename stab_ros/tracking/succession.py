"""Succession: a reference that no later frame matches, as one that was received damaged, gives way to a later frame.

As long as a reference has found next to nothing, a frame that it does not find becomes its rival: a reference to be,
which looks for the same frames. A rival that does not find the next frame gives way to that. So it shows whether the
reference is to blame or the frames after it, and what takes over leaves more frames tracked.
"""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.tracking.frame_stamp import FrameStamp
from stab_ros.tracking.session import Session

ESTABLISHED = 3.0  # frames found: with as many, a reference gets no rival any more
_MISSED = 0.25  # of the features shown: with fewer, a frame may match by chance
_TIMES = 1.5  # as much as the reference has found
_AT_ONCE = 8  # frames that the rival has found, where no frame after it can be waited for


@dataclass(frozen=True, eq=False)
class Rival:
    """A reference to be. stamp: of its frame."""

    session: Session
    stamp: FrameStamp

    @property
    def is_confirmed(self) -> bool:
        """Whether another frame has matched it."""
        return self.session.found > 0

    def may_succeed(self, reference: Session) -> bool:
        """Whether it is still to be decided which of the two is the better reference."""
        return reference.found < ESTABLISHED or self._is_better(reference)

    def succeeds(self, reference: Session) -> bool:
        """Whether it takes over, once all frames of a start-up have been seen."""
        return self.session.found >= ESTABLISHED and self._is_better(reference)

    def succeeds_at_once(self, reference: Session) -> bool:
        """Whether it takes over from a reference that answers each frame at once."""
        return self.session.found >= _AT_ONCE and not reference.found

    def _is_better(self, reference: Session) -> bool:
        return self.session.found > _TIMES * reference.found


def is_challenged(reference: Session, shown: float) -> bool:
    """Whether a frame of the start-up that shows this share of the reference's features becomes its rival.

    It shows next to nothing of it, or all of it elsewhere, as a picture put together from the wrong pieces does.
    """
    return reference.found < ESTABLISHED and (shown < _MISSED or reference.has_jumped)
