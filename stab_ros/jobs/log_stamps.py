"""New stamps for what belongs to images that are stamped with their log times."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable


class LogStamps:
    """The log times of images by their header stamps, of which wrong ones may repeat.

    logged: header stamp and log time of each image, ns.
    """

    def __init__(self, logged: Iterable[tuple[int, int]]) -> None:
        self._times: defaultdict[int, deque[int]] = defaultdict(deque)
        for stamp_ns, log_time_ns in logged:
            self._times[stamp_ns].append(log_time_ns)

    def next_of(self, stamp_ns: int, otherwise_ns: int) -> int:
        """The log time of the next image with this stamp; `otherwise_ns` where there is none."""
        times = self._times.get(stamp_ns)
        if not times:
            return otherwise_ns
        return times.popleft() if len(times) > 1 else times[0]

    def first_of(self, stamp_ns: int, otherwise_ns: int) -> int:
        """The same, for a message that is not one of each image."""
        times = self._times.get(stamp_ns)
        return times[0] if times else otherwise_ns
