"""When a recorded message is due: bag time against the monotonic clock; without ROS."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Schedule:
    """Bag time `bag_start_ns` is played at monotonic time `start_ns`, `rate` times as fast as recorded."""

    bag_start_ns: int
    start_ns: int
    rate: float

    def resumed(self, late_ns: int) -> Schedule:
        """The schedule after a stall: messages that became due meanwhile are not played in a burst."""
        return replace(self, start_ns=self.start_ns + late_ns)

    def due_ns(self, bag_ns: int) -> int:
        """When (monotonic clock) a message of this bag time is to be published."""
        return self.start_ns + round((bag_ns - self.bag_start_ns) / self.rate)

    def bag_time_ns(self, now_ns: int) -> int:
        """The bag time that is being played at `now_ns`."""
        return self.bag_start_ns + round((now_ns - self.start_ns) * self.rate)
