"""Pairs stabilised images with their homographies by stamp, and returns the pairs in the order of the stream."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass

from stab_ros.core.types import Frame, Homography
from stab_ros.evaluation.evaluator import Arrival

_REMEMBERED = 100  # frames returned unpaired whose other half may still arrive, such as the held image of a lost frame


@dataclass(eq=False)
class _Entry:
    ref_H_cur: Homography | None
    reference_size: tuple[int, int] | None
    frame: Frame | None = None
    passed: bool = False  # a later image has arrived, so the one of this frame will not


class Pairing:
    """Pairs the two topics of one stream. Each is in order by itself; one may lag behind the other by any time.

    A LOST frame needs no image. A frame is returned unpaired once a later pair shows that its other half will not
    arrive, or when the waiting images exceed `limit_bytes`.
    """

    def __init__(self, expect_homography: bool, limit_bytes: int) -> None:
        self.expect_homography = expect_homography
        self._limit = limit_bytes
        self._entries: OrderedDict[int, _Entry] = OrderedDict()
        self._pictures: OrderedDict[int, Frame] = OrderedDict()
        self._answered: deque[int] = deque(maxlen=_REMEMBERED)
        self._unpaired: deque[int] = deque(maxlen=_REMEMBERED)
        self._count = 0

    @property
    def homographies_waiting(self) -> int:
        """Number of homographies whose image has not arrived yet, and of those queued behind them."""
        return len(self._entries)

    @property
    def pictures_waiting(self) -> int:
        """Number of images whose homography has not arrived yet."""
        return len(self._pictures)

    def homography(self, stamp_ns: int, ref_H_cur: Homography | None,
                   reference_size: tuple[int, int] | None = None) -> list[Arrival]:
        """Takes a homography. ref_H_cur: None if the frame was lost. reference_size: width and height, px, if known."""
        if stamp_ns in self._unpaired:  # too late, its image has been returned unpaired
            self._unpaired.remove(stamp_ns)
            return []
        if stamp_ns in self._answered:  # the recording starts again
            self._answered.clear()
        self._entries[stamp_ns] = _Entry(ref_H_cur, reference_size)
        if stamp_ns in self._pictures:
            return list(self._paired(stamp_ns))
        return list(self._ready())

    def image(self, frame: Frame) -> list[Arrival]:
        """Takes a stabilised image."""
        stamp_ns, is_known = frame.stamp_ns, frame.stamp_ns in self._entries
        if not (self.expect_homography or is_known):
            return [self._alone(frame)]
        if stamp_ns in self._answered and not is_known:
            return []
        self._pictures[stamp_ns] = frame
        return list(self._paired(stamp_ns) if is_known else self._beyond_limit())

    def flush(self) -> list[Arrival]:
        """The remaining frames, at the end of the stream."""
        for entry in self._entries.values():
            entry.passed = True
        return [*self._ready(), *map(self._alone, self._take_pictures(len(self._pictures)))]

    def _paired(self, stamp_ns: int) -> Iterator[Arrival]:
        """The frame at `stamp_ns`, whose halves are both here, and all earlier ones of either topic."""
        for earlier in self._take_pictures(list(self._pictures).index(stamp_ns)):
            yield self._alone(earlier)
        (frame,) = self._take_pictures(1)
        for earlier_ns, entry in self._entries.items():
            if earlier_ns == stamp_ns:
                entry.frame = frame
                break
            entry.passed = True
        yield from self._ready()

    def _ready(self) -> Iterator[Arrival]:
        """The frames that need not wait, from the first homography on."""
        while self._entries:
            stamp_ns, entry = next(iter(self._entries.items()))
            lost = entry.ref_H_cur is None
            if not (lost or entry.frame is not None or entry.passed):
                return
            del self._entries[stamp_ns]
            if entry.frame is None:
                self._answered.append(stamp_ns)
            yield Arrival(self._next(), stamp_ns, entry.ref_H_cur, lost, entry.frame, entry.reference_size)

    def _beyond_limit(self) -> Iterator[Arrival]:
        while sum(frame.image.nbytes for frame in self._pictures.values()) > self._limit:
            yield from map(self._alone, self._take_pictures(1))

    def _take_pictures(self, count: int) -> list[Frame]:
        """Removes and returns the first waiting images."""
        return [self._pictures.popitem(last=False)[1] for _ in range(count)]

    def _alone(self, frame: Frame) -> Arrival:
        self._unpaired.append(frame.stamp_ns)
        return Arrival(self._next(), frame.stamp_ns, None, False, frame)

    def _next(self) -> int:
        self._count += 1
        return self._count - 1
