"""Where the clock of a stream was set back, as opposed to messages that were overtaken on their way.

An overtaken message leaves a gap in the stamps that it fills later, and those after it have the stamps that they would
have had. Where a clock was set back, stamps fall among those before, and all later ones stay behind.
"""

from __future__ import annotations

import itertools
import statistics
from bisect import bisect_right, insort
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

from stab_ros.io.bag_types import Message
from stab_ros.io.cdr import SECOND_NS

HELD = 8  # messages of a topic: how many places one may be late
HELD_BYTES = 2**26  # of all that are held, unless that is less than one message
_LEAST = 3  # messages of a topic that tell a clock from a message that was overtaken
_MOST_BYTES = 4 * HELD_BYTES  # while there are fewer: those of other topics come between them
_RUN = HELD + 1  # late messages: longer than what one can overtake
_BACK_NS = SECOND_NS  # what goes back by more is another recording or a clock that was set
_KNOWN = 256  # stamps of a topic: what a camera takes within that time
_GAP = 1.5  # usual steps: a message is missing
StampOf = Callable[[bytes], "int | None"]


class Stamped(NamedTuple):
    """A message with its header stamp; None: it has none, or is of a topic that is not to be sorted."""

    message: Message
    stamp_ns: int | None
    begins: bool = False  # the stamps begin anew with it


class Times(NamedTuple):
    """Of a message, ns."""

    stamp_ns: int
    log_ns: int
    publish_ns: int


_CLOCKS = (1, 2)  # the fields of Times that stamps are compared with


class SetBacks:
    """Finds the messages of some topics with which the stamps begin anew.

    stamp_of: the header stamp in a message, ns; 0 or None: it has none.
    """

    def __init__(self, topics: Collection[str], stamp_of: StampOf) -> None:
        self._topics, self._stamp_of = topics, stamp_of
        self._queue: deque[Stamped] = deque()
        self._held = Counter[str]()  # messages with a stamp, by topic
        self._bytes = 0
        self._known: defaultdict[str, deque[Times]] = defaultdict(lambda: deque(maxlen=_KNOWN))
        self._newest_ns: dict[str, int] = {}  # by topic, since the stamps last began

    def marked(self, messages: Iterable[Message]) -> Iterator[Stamped]:
        """The messages in their order; nothing is held back unless a stamp is earlier than one before."""
        for message in messages:
            self._take(message)
            while self._queue and not self._must_wait(self._queue[0]):
                yield self._first()
        while self._queue:
            yield self._first()

    def _take(self, message: Message) -> None:
        one = Stamped(message, (self._stamp_of(message.data) or None) if message.topic in self._topics else None)
        self._queue.append(one)
        self._bytes += len(message.data)
        self._held[message.topic] += one.stamp_ns is not None

    def _must_wait(self, one: Stamped) -> bool:
        """Whether those that follow it tell what it is."""
        held = self._held[one.message.topic]
        few = held < _RUN and self._bytes <= (HELD_BYTES if held >= _LEAST else _MOST_BYTES)
        return few and 0 < self._late_ns(one) <= _BACK_NS

    def _late_ns(self, one: Stamped) -> int:
        """By how much its stamp is earlier than the latest one before."""
        return self._newest_ns.get(one.message.topic, one.stamp_ns) - one.stamp_ns if one.stamp_ns is not None else 0

    def _first(self) -> Stamped:
        one = self._queue[0]
        begins = self._begins(one)
        self._queue.popleft()
        self._bytes -= len(one.message.data)
        if begins:
            self._known.clear()
            self._newest_ns.clear()
        if one.stamp_ns is not None:
            topic = one.message.topic
            self._held[topic] -= 1
            self._known[topic].append(_times_of(one.message, one.stamp_ns))
            self._newest_ns[topic] = max(one.stamp_ns, self._newest_ns.get(topic, one.stamp_ns))
        return one._replace(begins=begins)

    def _begins(self, one: Stamped) -> bool:
        late_ns = self._late_ns(one)
        if not 0 < late_ns <= _BACK_NS:
            return late_ns > 0
        topic = one.message.topic
        ahead = (_times_of(other.message, other.stamp_ns) for other in self._queue
                 if other.stamp_ns is not None and other.message.topic == topic)
        return is_set_back(self._known[topic], list(itertools.islice(ahead, _RUN)))


def is_set_back(before: Collection[Times], ahead: Sequence[Times]) -> bool:
    """Whether a clock was set back.

    Args:
        before: the last messages before.
        ahead: the message with a stamp that is earlier than one before, and some of those that follow.
    """
    stamps_ns = sorted(times.stamp_ns for times in before)
    if len(ahead) == _RUN and all(times.stamp_ns < stamps_ns[-1] for times in ahead):
        return True
    if len(ahead) < 2 or _fill_gaps(stamps_ns, [times.stamp_ns for times in ahead]):
        return False
    late_ns = stamps_ns[-1] - ahead[0].stamp_ns
    recent = list(before)[-_RUN:]
    running = [clock for clock in _CLOCKS if len({one[clock] for one in (*recent, *ahead)}) > 1]
    return bool(running) and all(_stay_behind(late_ns, [one.stamp_ns - one[clock] for one in recent],
                                              [one.stamp_ns - one[clock] for one in ahead]) for clock in running)


def _stay_behind(late_ns: int, before_ns: Sequence[int], ahead_ns: Sequence[int]) -> bool:
    """Whether the first one falls behind by as much as it is late, and all are nearer to it than to those before.

    before_ns, ahead_ns: of each the stamp against another clock.
    """
    before = statistics.median(before_ns)
    return before - ahead_ns[0] >= late_ns and all(2 * one_ns < before + ahead_ns[0] for one_ns in ahead_ns)


def _fill_gaps(known_ns: Sequence[int], ahead_ns: Sequence[int]) -> bool:
    """Whether each late stamp falls, not too many places back, where one was missing, or before all."""
    known = list(known_ns)
    usual_ns = statistics.median([*_steps(known), *_steps(sorted(ahead_ns))])
    for stamp_ns in ahead_ns:
        place = bisect_right(known, stamp_ns)
        if place < len(known):
            full = place and (known[place] - known[place - 1] < _GAP * usual_ns or known[place - 1] == stamp_ns)
            if full or len(known) - place > HELD:
                return False
            insort(known, stamp_ns)
    return True


def _steps(stamps_ns: Sequence[int]) -> list[int]:
    return [after - before for before, after in itertools.pairwise(stamps_ns)]


def _times_of(message: Message, stamp_ns: int) -> Times:
    return Times(stamp_ns, message.log_time_ns, message.publish_time_ns)
