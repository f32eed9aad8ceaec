"""Messages that were logged a little out of order, back in the order of their header stamps.

Several writers of one bag, a converter, or a network may swap neighbours. The motion from frame to frame would
alternate then, which no camera does.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator

from stab_ros.core.errors import MessageError
from stab_ros.io.bag_types import Message
from stab_ros.io.cdr import SECOND_NS, read_stamp

_HELD = 8  # messages of a topic: how many places one may be late
_HELD_BYTES = 2**26  # of all that are held, unless that is less than one message
_BACK_NS = SECOND_NS  # what goes back by more is another recording or a clock that was set


class StampOrder:
    """Sorts the messages of some topics, each by itself; whatever is in order already passes in the same order.

    late: number of messages that came after one with a later stamp, by topic.
    """

    def __init__(self, topics: Collection[str]) -> None:
        self.late = dict.fromkeys(topics, 0)
        self._queue: deque[tuple[int | None, Message]] = deque()  # None: not to be sorted
        self._held = Counter[str]()  # messages to be sorted, by topic
        self._newest_ns: dict[str, int] = {}  # by topic, since the queue was last emptied
        self._bytes = 0

    def sorted(self, messages: Iterable[Message]) -> Iterator[Message]:
        """The messages; at most a few of each topic are held back, and what came between them."""
        for message in messages:
            stamp_ns = _stamp_of(message) if message.topic in self.late else None
            if stamp_ns is not None and stamp_ns < self._newest_ns.get(message.topic, stamp_ns) - _BACK_NS:
                yield from self._emptied()
            self._insert(stamp_ns, message)
            yield from self._released()
        yield from self._emptied()

    def _insert(self, stamp_ns: int | None, message: Message) -> None:
        self._bytes += len(message.data)
        if stamp_ns is None:
            self._queue.append((None, message))
            return
        place = self._place(stamp_ns, message.topic)
        self.late[message.topic] += place < len(self._queue)
        self._queue.insert(place, (stamp_ns, message))
        self._held[message.topic] += 1
        self._newest_ns[message.topic] = max(stamp_ns, self._newest_ns.get(message.topic, stamp_ns))

    def _place(self, stamp_ns: int, topic: str) -> int:
        """Before the first message of the topic with a later stamp; else at the end."""
        place = len(self._queue)
        if self._newest_ns.get(topic, stamp_ns) <= stamp_ns:
            return place
        for back, (held_ns, one) in enumerate(reversed(self._queue), 1):
            if held_ns is not None and one.topic == topic:
                if held_ns <= stamp_ns:
                    break
                place = len(self._queue) - back
        return place

    def _released(self) -> Iterator[Message]:
        """What need not be held: nothing waits behind it, or too much is held."""
        while self._queue and (self._queue[0][0] is None or max(self._held.values()) > _HELD
                               or (self._bytes > _HELD_BYTES and len(self._queue) > 1)):
            yield self._first()

    def _emptied(self) -> Iterator[Message]:
        while self._queue:
            yield self._first()
        self._newest_ns.clear()

    def _first(self) -> Message:
        stamp_ns, message = self._queue.popleft()
        self._bytes -= len(message.data)
        if stamp_ns is not None:
            self._held[message.topic] -= 1
        return message


def _stamp_of(message: Message) -> int | None:
    """None: it has no stamp."""
    try:
        return read_stamp(message.data) or None
    except MessageError:
        return None
