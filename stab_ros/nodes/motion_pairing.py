"""Pairs images with what the tracker tells of them, by stamp; without ROS."""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass

from stab_ros.core.types import Frame
from stab_ros.georeferencing.placement import Motion

_REMEMBERED = 1000  # homographies without an image, and images without a homography


@dataclass(frozen=True, eq=False)
class Moved:
    """A frame and its motion. motion: None, lost or unknown. answered: whether the tracker told of the frame."""

    frame: Frame
    motion: Motion | None
    answered: bool


class MotionPairing:
    """Returns frames in the order in which they came, each once its homography is there or will not come.

    Each of the two topics is in order by itself, and one may lag behind the other by any time: so a pair shows that
    nothing will come any more for the frames before it. When images exceed `limit_bytes`, the oldest do not wait.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._frames: OrderedDict[int, Frame] = OrderedDict()
        self._motions: OrderedDict[int, Motion | None] = OrderedDict()
        self._given_up: deque[int] = deque(maxlen=_REMEMBERED)

    def __len__(self) -> int:
        """Number of frames that wait."""
        return len(self._frames)

    def frame(self, frame: Frame) -> list[Moved]:
        """Takes the next frame; its stamp is none of those that wait."""
        self._frames[frame.stamp_ns] = frame
        if frame.stamp_ns in self._motions:
            return self._until(frame.stamp_ns)
        return self._beyond_limit()

    def motion(self, stamp_ns: int, motion: Motion | None) -> list[Moved]:
        """Takes what the tracker tells of a frame; None: it is lost."""
        if stamp_ns in self._given_up:
            self._given_up.remove(stamp_ns)
            return []
        self._motions[stamp_ns] = motion
        if stamp_ns in self._frames:
            return self._until(stamp_ns)
        if len(self._motions) > _REMEMBERED:
            self._motions.popitem(last=False)
        return []

    def flush(self) -> list[Moved]:
        """All frames that wait: nothing will come for them."""
        return [self._without_motion() for _ in range(len(self._frames))]

    def _until(self, stamp_ns: int) -> list[Moved]:
        """The frame at `stamp_ns`, whose motion is here, and all before it."""
        found = []
        while next(iter(self._frames)) != stamp_ns:
            found.append(self._without_motion())
        while next(iter(self._motions)) != stamp_ns:
            self._motions.popitem(last=False)
        return [*found, Moved(self._frames.pop(stamp_ns), self._motions.pop(stamp_ns), answered=True)]

    def _beyond_limit(self) -> list[Moved]:
        found = []
        while len(self._frames) > 1 and sum(frame.image.nbytes for frame in self._frames.values()) > self._limit:
            found.append(self._without_motion())
        return found

    def _without_motion(self) -> Moved:
        stamp_ns, frame = self._frames.popitem(last=False)
        self._given_up.append(stamp_ns)
        return Moved(frame, None, answered=False)
