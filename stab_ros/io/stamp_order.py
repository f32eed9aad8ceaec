"""Messages that were logged a little out of order, back in the order of their header stamps.

Several writers of one bag, a converter, or a network may swap neighbours. The motion from frame to frame would
alternate then, which no camera does. Where a clock was set back, or a recording begins again, nothing is sorted.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator

from stab_ros.core.errors import MessageError
from stab_ros.io.bag_types import Message
from stab_ros.io.cdr import read_stamp
from stab_ros.io.set_back import HELD, HELD_BYTES, SetBacks, StampOf


class StampOrder:
    """Sorts the messages of some topics, each by itself; whatever is in order already passes in the same order.

    stamp_of: the header stamp in a message, ns; 0 or None: it has none.
    late: number of messages that came after one with a later stamp, by topic.
    """

    def __init__(self, topics: Collection[str], stamp_of: StampOf | None = None) -> None:
        self.late = dict.fromkeys(topics, 0)
        self._set_backs = SetBacks(self.late, stamp_of or _stamp_of)
        self._queue: deque[tuple[int | None, Message]] = deque()  # None: not to be sorted
        self._held = Counter[str]()  # messages to be sorted, by topic
        self._newest_ns: dict[str, int] = {}  # by topic, since the queue was last emptied
        self._bytes = 0

    def sorted(self, messages: Iterable[Message]) -> Iterator[Message]:
        """The messages; at most a few of each topic are held back, and what came between them."""
        for message, stamp_ns, begins in self._set_backs.marked(messages):
            if begins:
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
        while self._queue and (self._queue[0][0] is None or max(self._held.values()) > HELD
                               or (self._bytes > HELD_BYTES and len(self._queue) > 1)):
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


def _stamp_of(data: bytes) -> int | None:
    """Of a message in CDR that begins with a header."""
    try:
        return read_stamp(data)
    except MessageError:
        return None
