"""Pairs stabilised pictures with their homographies by stamp, and gives both out in the order of the stream."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass

from stab_ros.core.evaluation import Arrival
from stab_ros.core.types import Frame, Homography

_LOOK_AHEAD = 8  # a picture that is missing after so many later homographies will not come any more
_REMEMBERED = 100  # frames given out whose other half may still come, as the held picture of a lost one


@dataclass(eq=False)
class _Entry:
    index: int
    ref_H_cur: Homography | None
    frame: Frame | None = None
    passed: bool = False  # a later picture has come, so this one's will not


class Pairing:
    """One stream. A LOST frame needs no picture; a picture whose homography never comes is given out without one."""

    def __init__(self, expect_homography: bool) -> None:
        self.expect_homography = expect_homography
        self._entries: OrderedDict[int, _Entry] = OrderedDict()
        self._pictures: OrderedDict[int, Frame] = OrderedDict()
        self._answered: deque[int] = deque(maxlen=_REMEMBERED)
        self._unpaired: deque[int] = deque(maxlen=_REMEMBERED)
        self._count = 0

    def homography(self, stamp_ns: int, ref_H_cur: Homography | None) -> list[Arrival]:
        """ref_H_cur: None if the frame was lost."""
        if stamp_ns in self._unpaired:  # too late, its picture has been given out
            self._unpaired.remove(stamp_ns)
            return []
        if stamp_ns in self._answered:  # the recording starts again
            self._answered.clear()
        self._entries[stamp_ns] = _Entry(self._next(), ref_H_cur)
        frame = self._pictures.pop(stamp_ns, None)
        if frame is not None:
            self._attach(frame)
        return list(self._ready(_LOOK_AHEAD))

    def image(self, frame: Frame) -> list[Arrival]:
        """frame: a stabilised picture."""
        if frame.stamp_ns in self._entries:
            self._attach(frame)
            return list(self._ready(_LOOK_AHEAD))
        if not self.expect_homography:
            return [self._alone(frame)]
        if frame.stamp_ns in self._answered:
            return []
        self._pictures[frame.stamp_ns] = frame
        if len(self._pictures) <= _LOOK_AHEAD:
            return []
        return [self._alone(self._pictures.popitem(last=False)[1])]

    def flush(self) -> list[Arrival]:
        """What is left when nothing more will come."""
        left = [*self._ready(0), *map(self._alone, self._pictures.values())]
        self._pictures.clear()
        return left

    def _next(self) -> int:
        self._count += 1
        return self._count - 1

    def _alone(self, frame: Frame) -> Arrival:
        self._unpaired.append(frame.stamp_ns)
        return Arrival(self._next(), frame.stamp_ns, None, False, frame)

    def _attach(self, frame: Frame) -> None:
        for stamp_ns, entry in self._entries.items():
            if stamp_ns == frame.stamp_ns:
                entry.frame = frame
                return
            entry.passed = True

    def _ready(self, look_ahead: int) -> Iterator[Arrival]:
        while self._entries:
            stamp_ns, entry = next(iter(self._entries.items()))
            lost = entry.ref_H_cur is None
            if not (lost or entry.frame is not None or entry.passed or len(self._entries) > look_ahead):
                return
            del self._entries[stamp_ns]
            self._answered.append(stamp_ns)
            yield Arrival(entry.index, stamp_ns, entry.ref_H_cur, lost, entry.frame)
