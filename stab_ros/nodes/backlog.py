"""The queue of frames that wait to be measured, bounded by the memory of their images; without ROS."""

from __future__ import annotations

from collections import deque

from stab_ros.core.types import Frame
from stab_ros.evaluation.evaluator import Arrival


class Backlog:
    """Frames in the order of the stream; each reference stands before the frames that are measured against it.

    limit_bytes: of images. Times are of one monotonic clock, ns.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._waiting: deque[tuple[int, Arrival | Frame]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def first(self) -> Arrival | Frame:
        return self._waiting[0][1]

    @property
    def crowded(self) -> bool:
        """Whether more than half full."""
        return 2 * self._bytes > self._limit

    def delay_ns(self, now_ns: int) -> int:
        """How long the oldest item has been waiting."""
        return now_ns - self._waiting[0][0] if self._waiting else 0

    def add(self, arrival: Arrival, now_ns: int) -> list[Arrival]:
        """Returns the frames that are dropped to make room: those with the oldest images. One image always has room."""
        self._waiting.append((now_ns, arrival))
        self._bytes += _size(arrival)
        skipped: list[Arrival] = []
        while self._bytes > self._limit and (oldest := self._oldest_image()) is not arrival:
            skipped.append(oldest)
            self._remove(oldest)
        return skipped

    def add_reference(self, reference: Frame, now_ns: int, at_once: bool) -> None:
        """Inserts it before the frame of its stamp if that waits, else before all frames (`at_once`) or at the end."""
        same = [place for place, (_, item) in enumerate(self._waiting) if item.stamp_ns == reference.stamp_ns]
        frames = [place for place, (_, item) in enumerate(self._waiting) if isinstance(item, Arrival)]
        places = same or (frames if at_once else [])
        self._waiting.insert(places[0] if places else len(self._waiting), (now_ns, reference))

    def pop(self) -> Arrival | Frame:
        """Removes and returns the next item: a frame, or the reference of those that follow."""
        _, item = self._waiting.popleft()
        self._bytes -= _size(item)
        return item

    def _oldest_image(self) -> Arrival:
        return next(item for _, item in self._waiting if isinstance(item, Arrival) and item.frame is not None)

    def _remove(self, arrival: Arrival) -> None:
        self._waiting = deque(one for one in self._waiting if one[1] is not arrival)
        self._bytes -= _size(arrival)


def _size(item: Arrival | Frame) -> int:
    """Bytes; a reference counts as 0, as it is never dropped."""
    return item.frame.image.nbytes if isinstance(item, Arrival) and item.frame is not None else 0
