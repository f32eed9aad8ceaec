"""`stab-ros georeference`: a recording into orthophotos on the water plane, without ROS; every frame, in order."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value
from stab_ros.core.types import Homography, LostReason, State, Track
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.local_frame import LOCAL
from stab_ros.georeferencing.settings import needs_motion, needs_sensors
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import BagWriter, Message
from stab_ros.io.cdr import CAMERA_INFO
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.outputs import check_output, completed
from stab_ros.io.sensors import Sensors, read_sensors
from stab_ros.io.source import Clock, Kind, Picture, Source, kind_of, namespace_of, open_source, read_again
from stab_ros.io.topics import CAMERA_INFO_TOPIC, STABILIZED_TOPIC, topic_in
from stab_ros.jobs.georeferenced_bag import GeoreferencedBag
from stab_ros.jobs.geotiffs import GeoTiffs, to_crs_of
from stab_ros.jobs.motions import (
    MotionOf,
    RecordedMotions,
    check_homographies,
    no_motion,
    read_motions,
    stabilised_motion,
)
from stab_ros.jobs.pipeline import OnFrame, PictureTracker
from stab_ros.jobs.placing import PicturePlacer, PlacedPicture, Work
from stab_ros.jobs.sensor_feed import feed
from stab_ros.jobs.stabilize import expected
from stab_ros.jobs.stage import Stage
from stab_ros.parameters.engines import camera_of, make_georeferencer, make_stabilizer
from stab_ros.parameters.table import georeference_config


@dataclass(frozen=True)
class Job:
    """What to georeference and what to write.

    values: checked parameters of georeferencing. tracker_values: those of the stabiliser, where it runs on the fly.
    telemetry: recording of the sensors; None: they are in the input, if anywhere. interval_s: of GeoTIFFs.
    """

    source: Path
    output: Path
    values: Mapping[str, Value]
    tracker_values: Mapping[str, Value] = field(default_factory=dict)
    image_topic: str | None = None
    telemetry: Path | None = None
    homographies: Path | None = None
    geotiff: Path | None = None
    interval_s: float | None = None
    with_image: bool = True
    limit: int | None = None
    fps: float | None = None
    force: bool = False
    clock: Clock = Clock.HEADER


@dataclass
class Georeferencing:
    """The result of a job. unplaced: frames by reason. warnings: what was lost or is doubtful: one line each."""

    frames: int = 0
    unplaced: Counter[str] = field(default_factory=Counter)
    doubts: dict[str, tuple[str, int]] = field(default_factory=dict)  # the last of a kind, and of how many frames
    stream_doubts: tuple[str, ...] = ()
    undecoded: Counter[str] = field(default_factory=Counter)
    values: dict[str, float] = field(default_factory=dict)  # of the last placed frame
    grid_size: tuple[int, int] | None = None
    resolution_m: float = 0.0
    first_ns: int | None = None  # stamp of the first frame
    geotiffs: int = 0
    duration_s: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def placed(self) -> int:
        return self.frames - self.unplaced.total()

    def add(self, answer: Georeferenced) -> None:
        self.frames += 1
        self.first_ns = answer.frame.stamp_ns if self.first_ns is None else self.first_ns
        placement, grid = answer.placement, answer.grid
        if placement is None or grid is None:
            self.unplaced[answer.reason] += 1
            return
        for doubt in placement.warnings:
            what = doubt.partition(":")[0]  # its figures may change from frame to frame
            self.doubts[what] = (doubt, self.doubts.get(what, (doubt, 0))[1] + 1)
        self.values, self.grid_size, self.resolution_m = dict(placement.values), grid.size, grid.resolution_m


def georeference(job: Job, progress: Progress, compiling: Compiler = compile_kernels) -> Georeferencing:
    """Georeferences the recording.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable; no output remains.
        WorkError: the work could not be finished; the readable part remains under its `.partial` name.
    """
    for path, suffix in ((job.output, ".mcap"), (job.homographies, ".csv")):
        if path is not None:
            check_output(path, suffix, job.source, job.force)
    orientation = georeference_config(job.values).orientation
    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        work = _prepared(job, source)
        compiling()
        started_s, total = time.monotonic(), expected(source.count, job.limit)
        with _outputs(job, source, orientation) as outputs:
            result = _run(job, source, work, outputs, lambda done: progress(done, total))
            _check_placed(source, work, result)
        result.duration_s = time.monotonic() - started_s
        result.warnings = (*outputs.warnings, *source.warnings, *work.warnings, *_said(source, result))
    return result


@dataclass(frozen=True, eq=False)
class _Work:
    """What a recording is worked on with.

    camera: of the images; None: of unknown K. image_H_ref: as for `Georeferencer`. recorded: homographies in the input.
    sensors: of the input or of --telemetry.
    """

    camera: Camera | None
    image_H_ref: Homography | None
    recorded: RecordedMotions | None
    sensors: Sensors | None
    warnings: tuple[str, ...]


def _prepared(job: Job, source: Source) -> _Work:
    namespace = namespace_of(source.topics[source.image_topic])
    recorded = read_motions(job.source, namespace, source.topics) if kind_of(job.source) is Kind.BAG else None
    sensors = _sensors_of(job)
    stabilised = source.image_topic == topic_in(namespace, STABILIZED_TOPIC)
    damaged = 0 if recorded is None else recorded.damaged
    lost = f"{source.name}: {damaged} messages of homographies cannot be read, their frames are lost"
    warnings = (*((lost,) if damaged else ()), *(() if sensors is None else sensors.warnings))
    if stabilised:
        recorded = check_homographies(job.source, recorded)
        return _Work(recorded.camera, recorded.image_H_ref, recorded, sensors, warnings)
    camera = None if job.values.get("camera_file") else _camera_of(source, namespace)
    return _Work(camera, None, recorded, sensors, warnings)


def _sensors_of(job: Job) -> Sensors | None:
    """The sensors of --telemetry, or those of the input if it is a recording.

    Raises:
        InputError: the orientation needs sensors that are not there.
    """
    where = job.telemetry or job.source
    sensors = read_sensors(where) if job.telemetry is not None or kind_of(where) is Kind.BAG else None
    if needs_sensors(georeference_config(job.values)) and (
            sensors is None or not (sensors.fixes and sensors.attitudes)):
        raise InputError(f"{where}: dynamic_gps_imu needs fixes (NavSatFix) and attitudes (Imu, QuaternionStamped), as "
                         "telemetry writes them; name their recording with --telemetry")
    return sensors


def _camera_of(source: Source, namespace: str) -> Camera | None:
    """The calibration in the recording; None: there is none."""
    info = source.topics.get(topic_in(namespace, CAMERA_INFO_TOPIC))
    return source.camera() if info is not None and info.msgtype == CAMERA_INFO and info.count else None


@dataclass(frozen=True)
class _Outputs:
    """The writers of the outputs."""

    bag: GeoreferencedBag
    table: HomographyWriter | None
    warnings: list[str]

    def write(self, placed: PlacedPicture) -> None:
        engine = placed.work.engine
        self.bag.write_once(placed.picture, placed.answer, engine.local_frame, engine.gcps)
        self.bag.write(placed.picture, placed.answer, placed.image, placed.work.camera)
        if self.table is not None:
            self.table.write(placed.number, _row(placed.number, placed.answer))


@contextmanager
def _outputs(job: Job, source: Source, orientation: str) -> Iterator[_Outputs]:
    """Opens all writers. On an error they close first, so that the partial output is readable."""
    with ExitStack() as stack:
        writer = stack.enter_context(BagWriter(job.output, overwrite=job.force))
        table_path = stack.enter_context(completed(job.homographies)) if job.homographies else None
        bag = GeoreferencedBag(writer, source, orientation, job.with_image)
        table = stack.enter_context(HomographyWriter(table_path)) if table_path else None
        replaced = [f"{source.name}: its own {', '.join(bag.replaced)} gave way to the new ones of the same name"]
        yield _Outputs(bag, table, replaced if bag.replaced else [])


def _row(number: int, answer: Georeferenced) -> Track:
    """The row of a table of homographies: from undistorted pixels to metres in the map."""
    stamp_ns = answer.frame.stamp_ns
    if answer.placement is None:
        return Track(State.LOST, number, stamp_ns, 0, 0, lost_reason=LostReason.UNANSWERED)
    return Track(State.TRACKED, number, stamp_ns, 0, 0, ref_H_cur=answer.placement.map_H_image)


def _run(job: Job, source: Source, work: _Work, outputs: _Outputs, progress: OnFrame) -> Georeferencing:
    """Reads on this thread, places and writes on two others, each up to two frames behind, all in order."""
    result = Georeferencing()
    placer = PicturePlacer(partial(_begun, job, work), job.with_image)

    def write(item: PlacedPicture | Message) -> None:
        if isinstance(item, Message):
            outputs.bag.take_over(item)
            return
        outputs.write(item)
        result.add(item.answer)
        progress(result.frames)

    def place(item: Picture | Message) -> None:
        done = item if isinstance(item, Message) else placer.step(item)
        if done is not None:
            writing.put(done)

    with Stage(write) as writing, Stage(place) as placing:
        for item in source.items(job.limit):
            placing.put(item)
    result.geotiffs, result.undecoded = placer.finish(), placer.undecoded
    result.stream_doubts = () if placer.work is None else placer.work.engine.doubts
    return result


def _motion_of(job: Job, work: _Work, camera: Camera | None) -> MotionOf:
    """Where homographies of frames are from: the recording, or the stabiliser where any are needed."""
    if work.recorded is not None:
        return work.recorded.of
    if not needs_motion(georeference_config(job.values)):
        return no_motion
    stabilizer = make_stabilizer(job.tracker_values, camera)
    return stabilised_motion(PictureTracker(stabilizer, False, partial(
        read_again, job.source, job.image_topic, job.fps, job.clock, job.limit)))


def _begun(job: Job, work: _Work, size: tuple[int, int]) -> Work:
    reference_size = size if work.recorded is None or work.image_H_ref is None else work.recorded.reference_size
    named = camera_of(job.values, reference_size or size)
    engine = make_georeferencer(job.values, work.camera, reference_size or size, work.image_H_ref, named)
    if work.sensors is not None:
        feed(engine, work.sensors)
    camera = work.camera if named[0] is None else named[0].camera
    geotiffs = None if job.geotiff is None else GeoTiffs(
        job.geotiff, job.interval_s, to_crs_of(engine, str(job.values.get("crs", LOCAL))), engine.orthophoto)
    return Work(engine, camera, _motion_of(job, work, camera), geotiffs)


def _said(source: Source, result: Georeferencing) -> list[str]:
    """What is doubtful, and of how many frames."""
    said = list(result.stream_doubts)
    said += [f"{source.name}: {doubt} ({count} of {result.frames} frames)" for doubt, count in result.doubts.values()]
    if result.undecoded:
        total = result.undecoded.total()
        said.append(f"{source.name}: {total} images of {source.image_topic} cannot be decoded and have no answer; "
                    f"the first: {next(iter(result.undecoded))}")
    return said


def _check_placed(source: Source, work: _Work, result: Georeferencing) -> None:
    """Raises InputError where not one frame is placed."""
    if result.placed:
        return
    reason = result.unplaced.most_common(1)[0][0] if result.unplaced else "there is no frame"
    sensors = work.sensors
    times = "" if sensors is None or not sensors.fixes or result.first_ns is None else (
        f"; the fixes are of {sensors.fixes[0].stamp_ns / 1e9:.1f} to {sensors.fixes[-1].stamp_ns / 1e9:.1f} s, the "
        f"first frame is of {result.first_ns / 1e9:.1f} s: time_offset_s brings clocks together")
    raise InputError(f"{source.name}: not one frame can be placed: {reason}{times}")
