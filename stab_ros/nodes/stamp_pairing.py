"""Pairs the messages of two topics by stamp, where neither may be waited for without limit; without ROS."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

_REMEMBERED = 1000  # answers without a question, and questions that were not answered

Q = TypeVar("Q")
A = TypeVar("A")


@dataclass(frozen=True, eq=False)
class Pair(Generic[Q, A]):
    """A message and its answer. answer: None if it did not come."""

    stamp_ns: int
    question: Q
    answer: A | None


class StampPairing(Generic[Q, A]):
    """Returns questions in the order in which they came, each once its answer is there or will not come.

    Each topic is in order by itself, and one may lag behind the other by any time: so a pair shows that nothing will
    come any more for the questions before it. No stamp is compared with a clock or with a later stamp: a recording may
    begin again, and a clock may jump.
    """

    def __init__(self, limit: float, size: Callable[[Q], float] = lambda _: 1.0) -> None:
        """limit: of the sizes of all questions that wait; above it, the oldest do not. size: of a question."""
        self._limit, self._size = limit, size
        self._questions: OrderedDict[int, Q] = OrderedDict()
        self._answers: OrderedDict[int, A] = OrderedDict()
        self._given_up: deque[int] = deque(maxlen=_REMEMBERED)

    def __len__(self) -> int:
        """Number of questions that wait."""
        return len(self._questions)

    def ask(self, stamp_ns: int, question: Q) -> list[Pair[Q, A]]:
        """Takes the next question. One with a stamp that waits already takes its place."""
        self._questions.pop(stamp_ns, None)
        self._questions[stamp_ns] = question
        return self._until(stamp_ns) if stamp_ns in self._answers else self._beyond_limit()

    def answer(self, stamp_ns: int, answer: A) -> list[Pair[Q, A]]:
        """Takes the next answer; one that comes after its question was returned is left out."""
        if stamp_ns in self._given_up:
            self._given_up.remove(stamp_ns)
            return []
        self._answers[stamp_ns] = answer
        if stamp_ns in self._questions:
            return self._until(stamp_ns)
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
        return []

    def flush(self) -> list[Pair[Q, A]]:
        """All questions that wait: no answer will come."""
        return [self._unanswered() for _ in range(len(self._questions))]

    def _until(self, stamp_ns: int) -> list[Pair[Q, A]]:
        """The pair at `stamp_ns`, whose halves are both here, and all questions before it."""
        found = []
        while next(iter(self._questions)) != stamp_ns:
            found.append(self._unanswered())
        while next(iter(self._answers)) != stamp_ns:
            self._answers.popitem(last=False)
        return [*found, Pair(stamp_ns, self._questions.pop(stamp_ns), self._answers.pop(stamp_ns))]

    def _beyond_limit(self) -> list[Pair[Q, A]]:
        found = []
        while len(self._questions) > 1 and sum(map(self._size, self._questions.values())) > self._limit:
            found.append(self._unanswered())
        return found

    def _unanswered(self) -> Pair[Q, A]:
        stamp_ns, question = self._questions.popitem(last=False)
        self._given_up.append(stamp_ns)
        return Pair(stamp_ns, question, None)
