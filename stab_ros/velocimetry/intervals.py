"""Methods that measure an interval as a whole: its frames are kept, and another one begins when it is over."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Generic, TypeVar

from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.shared_errors import PlaneErrors
from stab_ros.velocimetry.vectors import Vectors


class IntervalFrames(ABC):
    """What is kept of the frames of an interval.

    Attributes:
        stamps_ns: of the frames that are kept.
        errors: of their places.
        last_ns: stamp of the last frame, kept or not.
    """

    def __init__(self, most: int) -> None:
        """Without frames. most: number of frames that are kept; of more, every second is let go."""
        self.stamps_ns: list[int] = []
        self.errors: list[PlaneErrors] = []
        self.last_ns = 0
        self._most, self._stride, self._count = most, 1, 0

    @property
    def duration_s(self) -> float:
        """From the first to the last frame, s."""
        return (self.last_ns - self.stamps_ns[0]) * 1e-9 if self.stamps_ns else 0.0

    def add(self, frame: PlacedFrame) -> None:
        """Takes the next frame."""
        self.last_ns = frame.stamp_ns
        if self._count % self._stride == 0:
            self.stamps_ns.append(frame.stamp_ns)
            self.keep(frame)
        self._count += 1
        if len(self.stamps_ns) > self._most:
            kept: tuple[list[Any], ...] = (self.stamps_ns, self.errors, *self.lists())
            for each in kept:
                del each[1::2]
            self._stride *= 2

    @abstractmethod
    def keep(self, frame: PlacedFrame) -> None:
        """Appends what is needed of a frame to `errors` and each of `lists`."""

    @abstractmethod
    def lists(self) -> tuple[list[Any], ...]:
        """What is kept beside stamps and errors, one item for each frame."""


Frames = TypeVar("Frames", bound=IntervalFrames)


class IntervalMethod(ABC, Generic[Frames]):
    """A `Method` whose intervals follow one another, the last frame of one being the first of the next."""

    dropped: Mapping[str, int] = MappingProxyType({})  # what is judged here are windows and lines, before vectors
    doubts: Mapping[str, str] = MappingProxyType({})
    follows = False

    def __init__(self, interval_s: float) -> None:
        """interval_s: length of an interval, s."""
        self._interval_s = interval_s
        self._interval: Frames | None = None
        self._epoch = 0

    def add(self, frame: PlacedFrame) -> Vectors | None:
        """Takes the next frame; see `Method`.

        Raises:
            InputError: the first frame of an epoch does not suit the method.
        """
        ended = None
        if self._interval is not None and frame.epoch != self._epoch:
            ended, self._interval = self.finish(), None
        if self._interval is None:
            self._interval, self._epoch = self.begun(frame), frame.epoch
        self._interval.add(frame)
        if self._interval.duration_s < self._interval_s * (1 - 1e-6):
            return ended
        vectors = self.measured(self._interval)
        self._interval = self.again(self._interval)
        self._interval.add(frame)
        return vectors

    def finish(self) -> Vectors | None:
        """See `Method`; half an interval suffices."""
        if self._interval is None or self._interval.duration_s < self._interval_s / 2:
            return None
        vectors, self._interval = self.measured(self._interval), None
        return vectors

    @abstractmethod
    def begun(self, frame: PlacedFrame) -> Frames:
        """An interval without frames, the first of an epoch, which begins with this frame."""

    @abstractmethod
    def again(self, interval: Frames) -> Frames:
        """An interval without frames after this one, in the same epoch."""

    @abstractmethod
    def measured(self, interval: Frames) -> Vectors | None:
        """The vectors of an interval, which may be none, with `doubts` of it; None: it has too few frames."""
