"""The samples of positioning and attitude sensors, in the order of their stamps on the clock of the frames."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import replace

from stab_ros.georeferencing.interpolation import Sample
from stab_ros.georeferencing.pose_track import repeats
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample

_SECOND_NS = 1_000_000_000  # of a second
_KEPT_NS = 180 * _SECOND_NS  # before the last frame; checks look back 90 s


class Sensors:
    """What the sensors have told so far; a position that repeats the one before is no new one."""

    def __init__(self, time_offset_s: float) -> None:
        """time_offset_s: seconds to add to the stamps of samples to get those of the frames."""
        self._offset_ns = round(time_offset_s * _SECOND_NS)
        self.positions: list[PositionSample] = []
        self.attitudes: list[AttitudeSample] = []

    @property
    def time_offset_s(self) -> float:
        """Seconds that are added to the stamps of samples."""
        return self._offset_ns / _SECOND_NS

    def shift(self, more_s: float) -> None:
        """Adds to the time offset, also of the samples that have come."""
        more_ns = round(more_s * _SECOND_NS)
        self._offset_ns += more_ns
        self.positions[:] = [replace(one, stamp_ns=one.stamp_ns + more_ns) for one in self.positions]
        self.attitudes[:] = [replace(one, stamp_ns=one.stamp_ns + more_ns) for one in self.attitudes]

    def add_position(self, sample: PositionSample) -> None:
        """Takes a position, on the clock of the sensor; a second one of the same stamp is left out."""
        sample = replace(sample, stamp_ns=sample.stamp_ns + self._offset_ns)
        at = bisect.bisect_left(self.positions, sample.stamp_ns, key=_stamp_ns)
        if not (at and repeats(self.positions[at - 1], sample)):
            _insert(self.positions, at, sample)

    def add_attitude(self, sample: AttitudeSample) -> None:
        """Takes an attitude, on the clock of the sensor; a second one of the same stamp is left out."""
        sample = replace(sample, stamp_ns=sample.stamp_ns + self._offset_ns)
        _insert(self.attitudes, bisect.bisect_left(self.attitudes, sample.stamp_ns, key=_stamp_ns), sample)

    def forget_before(self, stamp_ns: int) -> None:
        """Lets go what is of no use to a frame of this stamp or later ones, so that memory is bounded."""
        for samples in (self.positions, self.attitudes):
            del samples[: bisect.bisect_left(samples, stamp_ns - _KEPT_NS, key=_stamp_ns)]

    def cover(self, stamp_ns: int) -> bool:
        """Whether both sensors have told of a time at this stamp or after it."""
        return all(samples and samples[-1].stamp_ns >= stamp_ns for samples in (self.positions, self.attitudes))

    def staleness_s(self, stamp_ns: int) -> dict[str, float]:
        """Seconds from a stamp to the nearest sample of each sensor, by names for the status."""
        named: tuple[tuple[str, Sequence[PositionSample | AttitudeSample]], ...] = (
            ("position_age_s", self.positions), ("attitude_age_s", self.attitudes))
        return {name: _away_ns(samples, stamp_ns) / _SECOND_NS for name, samples in named if samples}


def _insert(samples: list[Sample], at: int, sample: Sample) -> None:
    if at == len(samples) or samples[at].stamp_ns != sample.stamp_ns:
        samples.insert(at, sample)


def _away_ns(samples: Sequence[PositionSample | AttitudeSample], stamp_ns: int) -> int:
    after = bisect.bisect_left(samples, stamp_ns, key=_stamp_ns)
    return min(abs(sample.stamp_ns - stamp_ns) for sample in samples[max(after - 1, 0):after + 1])


def _stamp_ns(sample: PositionSample | AttitudeSample) -> int:
    return sample.stamp_ns
