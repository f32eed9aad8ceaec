"""The samples of positioning and attitude sensors, in the order of their stamps on the clock of the frames."""

from __future__ import annotations

import bisect
from dataclasses import replace

from stab_ros.georeferencing.samples import AttitudeSample, PositionSample


class Sensors:
    """What the sensors have told so far."""

    def __init__(self, time_offset_s: float) -> None:
        """time_offset_s: seconds to add to the stamps of samples to get those of the frames."""
        self._offset_ns = round(time_offset_s * 1e9)
        self.positions: list[PositionSample] = []
        self.attitudes: list[AttitudeSample] = []

    def add_position(self, sample: PositionSample) -> None:
        """Takes a position, on the clock of the sensor."""
        bisect.insort(self.positions, replace(sample, stamp_ns=sample.stamp_ns + self._offset_ns), key=_stamp_ns)

    def add_attitude(self, sample: AttitudeSample) -> None:
        """Takes an attitude, on the clock of the sensor."""
        bisect.insort(self.attitudes, replace(sample, stamp_ns=sample.stamp_ns + self._offset_ns), key=_stamp_ns)

    def cover(self, stamp_ns: int) -> bool:
        """Whether both sensors have told of a time at this stamp or after it."""
        return all(samples and samples[-1].stamp_ns >= stamp_ns for samples in (self.positions, self.attitudes))


def _stamp_ns(sample: PositionSample | AttitudeSample) -> int:
    return sample.stamp_ns
