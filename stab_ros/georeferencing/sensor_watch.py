"""Sensors watched against the homographies over a flight: axes, heights and clocks that are wrong, in words."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

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
        warnings: what is wrong, one line each.
        values: figures for the status.
    """

    camera: Camera
    track: PoseTrack
    plane_m: float
    warnings: tuple[str, ...] = ()
    values: dict[str, float] = field(default_factory=dict)
    _seen: list[Sighting] = field(default_factory=list)
    _looks: int = 0

    def add(self, sighting: Sighting) -> None:
        """Takes the next frame."""
        if self._looks == len(_LOOKS_S) or sighting.ref_H_cur is None:
            return
        if self._seen and self._seen[0].reset_counter != sighting.reset_counter:
            self._seen.clear()
        if not self._seen or sighting.stamp_ns - self._seen[-1].stamp_ns >= _EVERY_S * 1e9:
            self._seen.append(replace(sighting, gray=NO_PICTURE))
        if sighting.stamp_ns - self._seen[0].stamp_ns >= _LOOKS_S[self._looks] * 1e9:
            self._look()
            self._looks += 1

    def _look(self) -> None:
        offset = estimate_time_offset(self.camera, self.track, self._seen, self.plane_m)
        said = [*check_samples(self.track.positions, self.track.attitudes),
                *check_motion(self.camera, self.track, self._seen, self.plane_m)]
        if isinstance(offset, TimeOffset):
            self.values = {"time_offset_left_s": offset.offset_s, "time_offset_sigma_s": offset.sigma_s}
            if abs(offset.offset_s) > max(_LEAST_S, _SIGMAS * offset.sigma_s):
                said.append(f"the clock of the sensors is off: add {offset.offset_s:.3f} +- {offset.sigma_s:.3f} s to "
                            "time_offset_s")
        self.warnings = tuple(said)
