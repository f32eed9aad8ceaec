"""Messages that were logged a little out of order, back in the order of their header stamps.

Several writers of one bag, a converter, or a network may swap neighbours. The motion from frame to frame would
alternate then, which no camera does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator

from stab_ros.core.errors import MessageError
from stab_ros.io.bag_types import Message
from stab_ros.io.cdr import SECOND_NS, read_stamp

_HELD = 8  # messages of a topic: how many places one may be late
_HELD_BYTES = 2**26  # of all that are sorted, unless that is less than one
_BACK_NS = SECOND_NS  # what goes back by more is another recording or a clock that was set


class StampOrder:
    """Sorts the messages of some topics, each by itself; whatever is in order already passes in the same order.

    late: number of messages that came after one with a later stamp, by topic.
    """

    def __init__(self, topics: Collection[str]) -> None:
        self.late = dict.fromkeys(topics, 0)
        self._queue: deque[tuple[int | None, Message]] = deque()  # None: not to be sorted
        self._held = self._bytes = 0  # number and size of those to be sorted

    def sorted(self, messages: Iterable[Message]) -> Iterator[Message]:
        """The messages; at most a few are held back."""
        for message in messages:
            stamp_ns = _stamp_of(message) if message.topic in self.late else None
            if stamp_ns is not None and self._goes_back(message.topic, stamp_ns):
                yield from self._released(0, 0)
            self._insert(stamp_ns, message)
            yield from self._released(_HELD, _HELD_BYTES)
        yield from self._released(0, 0)

    def _goes_back(self, topic: str, stamp_ns: int) -> bool:
        newest_ns = max((held_ns for held_ns, one in self._queue if held_ns and one.topic == topic), default=stamp_ns)
        return stamp_ns < newest_ns - _BACK_NS

    def _insert(self, stamp_ns: int | None, message: Message) -> None:
        later = [place for place, (held_ns, one) in enumerate(self._queue)
                 if stamp_ns is not None and held_ns is not None and one.topic == message.topic and held_ns > stamp_ns]
        self._queue.insert(later[0] if later else len(self._queue), (stamp_ns, message))
        if later:
            self.late[message.topic] += 1
        self._count(stamp_ns, message, 1)

    def _count(self, stamp_ns: int | None, message: Message, sign: int) -> None:
        if stamp_ns is not None:
            self._held += sign
            self._bytes += sign * len(message.data)

    def _released(self, most: int, most_bytes: int) -> Iterator[Message]:
        """What need not be held: nothing waits behind it, or too much is held."""
        while self._queue and (self._queue[0][0] is None or self._held > most
                               or (self._bytes > most_bytes and self._held > 1)):
            stamp_ns, message = self._queue.popleft()
            self._count(stamp_ns, message, -1)
            yield message


def _stamp_of(message: Message) -> int | None:
    """None: it has no stamp."""
    try:
        return read_stamp(message.data) or None
    except MessageError:
        return None
