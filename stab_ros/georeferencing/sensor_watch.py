"""Sensors watched against the homographies over a flight: axes, heights and clocks that are wrong, in words.

What is looked at ends with the first samples after the last frame, so that it is the same live and from a recording.
Only a recording has an end, at which what was gathered is looked at once more.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from stab_ros.georeferencing.interpolation import Sample
from stab_ros.georeferencing.placement import NO_PICTURE, Sighting
from stab_ros.georeferencing.pose_track import PoseTrack
from stab_ros.georeferencing.sensor_checks import check_motion, check_samples
from stab_ros.georeferencing.time_offset import TimeOffset, estimate_time_offset
from stab_ros.imaging.camera import Camera

_LOOKS_S = (10.0, 30.0, 90.0)  # after the first frame, when all that was gathered is looked at
_EVERY_S = 0.1  # frames that are gathered; more tell no more
_SIGMAS, _LEAST_S = 3.0, 0.01  # of a time offset that is told


@dataclass(eq=False)
class SensorWatch:
    """Gathers frames, and looks at them some seconds after the first; what it says holds until the next look.

    Attributes:
        camera: of known K.
        track: of the sensors, `time_offset_s` applied.
        plane_m: elevation of the ground that homographies follow.
        applies: whether a time offset that is found is to be applied.
        time_offset_s: that is applied: as given, and what was found since.
        warnings: what is wrong, one line each.
        values: figures for the status.
    """

    camera: Camera
    track: PoseTrack
    plane_m: float
    applies: bool = False
    time_offset_s: float = 0.0
    warnings: tuple[str, ...] = ()
    values: dict[str, float] = field(default_factory=dict)
    _seen: list[Sighting] = field(default_factory=list)
    _looks: int = 0
    _correction_s: float = 0.0

    def add(self, sighting: Sighting) -> None:
        """Takes the next frame."""
        if self._looks == len(_LOOKS_S) or sighting.ref_H_cur is None:
            return
        if self._seen and self._seen[0].reset_counter != sighting.reset_counter:
            self._seen.clear()
        if not self._seen or sighting.stamp_ns - self._seen[-1].stamp_ns >= _EVERY_S * 1e9:
            self._seen.append(replace(sighting, gray=NO_PICTURE))
        if sighting.stamp_ns - self._seen[0].stamp_ns >= _LOOKS_S[self._looks] * 1e9:
            self._look(sighting.stamp_ns)
            self._looks += 1

    def taken_correction_s(self) -> float:
        """The time offset to be applied now, which is told once; 0: none."""
        correction_s, self._correction_s = self._correction_s, 0.0
        self.time_offset_s += correction_s
        return correction_s

    def last_look(self) -> tuple[str, ...]:
        """What all frames since the first tell that no look has said: at the end of a recording; one line each."""
        if not self._seen or self._looks == len(_LOOKS_S):
            return ()
        found, before = self._found(self._seen[-1].stamp_ns, False), set(map(_without_figures, self.warnings))
        return tuple(one for one in found if _without_figures(one) not in before)

    def _look(self, stamp_ns: int) -> None:
        self.warnings = self._found(stamp_ns, self.applies)

    def _found(self, stamp_ns: int, applies: bool) -> tuple[str, ...]:
        """What is wrong up to this stamp. applies: whether a time offset is applied from now on."""
        track = replace(self.track, positions=_until(self.track.positions, stamp_ns),
                        attitudes=_until(self.track.attitudes, stamp_ns))
        offset = estimate_time_offset(self.camera, track, self._seen, self.plane_m)
        said = [*check_samples(track.positions, track.attitudes),
                *check_motion(self.camera, track, self._seen, self.plane_m)]
        if isinstance(offset, TimeOffset):
            said += self._judged(offset, stamp_ns, applies)
        return tuple(said)

    def _judged(self, offset: TimeOffset, stamp_ns: int, applies: bool) -> list[str]:
        """What is to be said of an offset, and done."""
        self.values = {"time_offset_left_s": offset.offset_s, "time_offset_sigma_s": offset.sigma_s}
        if abs(offset.offset_s) < max(_LEAST_S, _SIGMAS * offset.sigma_s):
            return []
        off = f"{offset.offset_s:.3f} +- {offset.sigma_s:.3f} s"
        if not self.applies:
            return [f"the clock of the sensors is off: add {off} to time_offset_s, or set apply_time_offset"]
        sum_s = self.time_offset_s + offset.offset_s
        if not applies:
            return [f"the clock of the sensors is still off by {off}: for the whole recording, time_offset_s should be "
                    f"{sum_s:.3f}"]
        self._correction_s = offset.offset_s
        return [f"the clock of the sensors was off: {off} are added to time_offset_s after stamp {stamp_ns} ns, which "
                f"makes it {sum_s:.3f}"]


def _without_figures(text: str) -> str:
    """What two looks say in common, though they have seen more or less of the flight."""
    return re.sub(r"[\d.]+", "", text)


def _until(samples: Sequence[Sample], stamp_ns: int) -> Sequence[Sample]:
    """The samples up to the first one at this stamp or after it."""
    return samples[: bisect.bisect_left(samples, stamp_ns, key=lambda sample: sample.stamp_ns) + 1]
