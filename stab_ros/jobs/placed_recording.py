"""What a recording is placed with: its camera, its homographies or the stabiliser, its sensors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.types import Homography
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.level_doubts import missing_level, stale_level
from stab_ros.georeferencing.settings import GeoreferenceConfig, needs_level, needs_motion, needs_sensors
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import CAMERA_INFO
from stab_ros.io.sensors import Sensors, read_sensors
from stab_ros.io.source import Clock, Kind, Source, is_stabilized, kind_of, namespace_of, read_again
from stab_ros.io.topics import CAMERA_INFO_TOPIC, topic_in
from stab_ros.jobs.motions import (
    MotionOf,
    RecordedMotions,
    check_homographies,
    no_motion,
    read_motions,
    stabilised_motion,
)
from stab_ros.jobs.pipeline import PictureTracker
from stab_ros.jobs.sensor_feed import feed
from stab_ros.parameters.engines import make_stabilizer, tells_level
from stab_ros.parameters.table import georeference_config

# the engine for a camera, width and height of images as taken, and image_H_ref, as `make_georeferencer` takes them
MakeEngine = Callable[[Camera | None, tuple[int, int], Homography | None], Georeferencer]


@dataclass(frozen=True)
class Placed:
    """What to read, and how its frames are placed.

    values: checked parameters of georeferencing, among others. tracker_values: those of the stabiliser, where it runs
    on the fly. telemetry: recording of the sensors; None: they are in the input, if anywhere.
    """

    source: Path
    output: Path
    values: Mapping[str, Value]
    tracker_values: Mapping[str, Value] = field(default_factory=dict)
    image_topic: str | None = None
    telemetry: Path | None = None
    limit: int | None = None
    fps: float | None = None
    clock: Clock = Clock.HEADER


@dataclass(frozen=True, eq=False)
class Placing:
    """What works on the pictures of one size.

    camera: of the images; None: of unknown K, or none that distorts. tracker: where it runs on the fly.
    """

    engine: Georeferencer
    camera: Camera | None
    motion_of: MotionOf
    reference_size: tuple[int, int]
    image_H_ref: Homography | None
    tracker: PictureTracker | None


@dataclass(frozen=True, eq=False)
class Recording:
    """What is in a recording beside its images.

    camera: of the images; None: of unknown K. image_H_ref: as for `Georeferencer`. recorded: homographies in the input.
    sensors: of the input or of --telemetry.
    """

    job: Placed
    name: str
    needs_motion: bool
    needs_level: bool
    needs_sensors: bool
    camera: Camera | None
    image_H_ref: Homography | None
    recorded: RecordedMotions | None
    sensors: Sensors | None
    warnings: tuple[str, ...]

    def begun(self, size: tuple[int, int], make_engine: MakeEngine) -> Placing:
        """The engine for images of this width and height, with all samples of the sensors.

        Raises:
            InputError: settings, camera and recording contradict each other.
        """
        recorded = None if self.recorded is None or self.image_H_ref is None else self.recorded.reference_size
        reference_size = recorded or size
        engine = make_engine(self.camera, reference_size, self.image_H_ref)
        if self.sensors is not None:
            feed(engine, self.sensors)
        camera = engine.camera if self.job.values.get("camera_file") else self.camera
        tracker = self._tracker(camera)
        if self.recorded is not None:
            return Placing(engine, camera, self.recorded.of, self.recorded.reference_size or size, self.image_H_ref,
                           None)
        motion_of = no_motion if tracker is None else stabilised_motion(tracker)
        return Placing(engine, camera, motion_of, reference_size, self.image_H_ref, tracker)

    def _tracker(self, camera: Camera | None) -> PictureTracker | None:
        """The stabiliser, where homographies are needed and the recording has none."""
        job = self.job
        if self.recorded is not None or not self.needs_motion:
            return None
        return PictureTracker(make_stabilizer(job.tracker_values, camera), False, partial(
            read_again, job.source, job.image_topic, job.fps, job.clock, job.limit))

    def level_doubts(self, first_ns: int, last_ns: int) -> list[str]:
        """That there is no water level under the first frame, or a stale one under the last; in one line, if any."""
        stamps_ns = [] if self.sensors is None else [level.stamp_ns for level in self.sensors.water_levels]
        before = [stamp_ns for stamp_ns in stamps_ns if stamp_ns <= first_ns]
        if not before and self.needs_level and not tells_level(self.job.values):
            none = "no water_level is recorded" if not stamps_ns else (
                f"the first water_level comes {(stamps_ns[0] - first_ns) / 1e9:.1f} s after the first frame")
            return [f"{self.name}: {missing_level(GeoreferenceConfig.wse_m, none)}"]
        age_s = (last_ns - max((stamp_ns for stamp_ns in stamps_ns if stamp_ns <= last_ns), default=last_ns)) / 1e9
        return [f"{self.name}: {doubt}" for doubt in stale_level(age_s)]

    def nothing_placed(self, reasons: Counter[str], first_ns: int | None, last_ns: int | None) -> InputError:
        """The error where not one frame is placed. first_ns, last_ns: stamps of the frames; None: there is none."""
        reason = reasons.most_common(1)[0][0] if reasons else "there is no frame"
        times = "" if first_ns is None or last_ns is None else self._clocks_apart(first_ns, last_ns)
        return InputError(f"{self.name}: not one frame can be placed: {reason}{times}")

    def _clocks_apart(self, first_ns: int, last_ns: int) -> str:
        """That fixes or attitudes are of another time than the frames, where they are needed; "": they are not."""
        if self.sensors is None or not self.needs_sensors:
            return ""
        offset_ns = round(float(self.job.values.get("time_offset_s", 0.0)) * 1e9)
        for what, samples in (("fixes", self.sensors.fixes), ("attitudes", self.sensors.attitudes)):
            from_ns, to_ns = (samples[k].stamp_ns + offset_ns for k in (0, -1))
            if from_ns > last_ns or to_ns < first_ns:
                return (f"; the {what} are of {from_ns / 1e9:.1f} to {to_ns / 1e9:.1f} s, the first frame is of "
                        f"{first_ns / 1e9:.1f} s: time_offset_s brings clocks together")
        return ""


def prepared(job: Placed, source: Source, config: GeoreferenceConfig | None = None) -> Recording:
    """Reads what a recording holds beside its images.

    config: of georeferencing; by default that of the job. Lengths in pixels of the reference take homographies alone.

    Raises:
        InputError: something is missing.
    """
    config = georeference_config(job.values) if config is None else config
    images = source.topics[source.image_topic]
    namespace = namespace_of(images)
    recorded = read_motions(job.source, namespace, source.topics) if kind_of(job.source) is Kind.BAG else None
    sensors = _sensors_of(job, config)
    damaged = 0 if recorded is None else recorded.damaged
    lost = f"{source.name}: {counted(damaged, 'message')} of homographies cannot be read, their frames are lost"
    warnings = (*((lost,) if damaged else ()), *(() if sensors is None else sensors.warnings))
    needs = (needs_motion(config), needs_level(config), needs_sensors(config))
    if is_stabilized(images):
        recorded = check_homographies(job.source, recorded)
        return Recording(job, source.name, *needs, recorded.camera, recorded.image_H_ref, recorded, sensors, warnings)
    camera = None if job.values.get("camera_file") else _camera_of(source, namespace)
    return Recording(job, source.name, *needs, camera, None, recorded, sensors, warnings)


def _sensors_of(job: Placed, config: GeoreferenceConfig) -> Sensors | None:
    """The sensors of --telemetry, or those of the input if it is a recording.

    Raises:
        InputError: the orientation needs sensors that are not there.
    """
    where = job.telemetry or job.source
    sensors = read_sensors(where) if job.telemetry is not None or kind_of(where) is Kind.BAG else None
    if needs_sensors(config) and (sensors is None or not (sensors.fixes and sensors.attitudes)):
        raise InputError(f"{where}: dynamic_gps_imu needs fixes (NavSatFix) and attitudes (Imu, QuaternionStamped), as "
                         "telemetry writes them; name their recording with --telemetry")
    return sensors


def _camera_of(source: Source, namespace: str) -> Camera | None:
    """The calibration in the recording; None: there is none."""
    info = source.topics.get(topic_in(namespace, CAMERA_INFO_TOPIC))
    return source.camera() if info is not None and info.msgtype == CAMERA_INFO and info.count else None
