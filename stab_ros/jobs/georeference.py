"""`stab-ros georeference`: a recording into orthophotos on the water plane, without ROS; every frame, in order."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.text import counted
from stab_ros.core.types import LostReason, State, Track
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.local_frame import LOCAL
from stab_ros.io.bag import BagWriter, Message
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.outputs import check_output, completed
from stab_ros.io.source import Picture, Source, open_source
from stab_ros.jobs.georeferenced_bag import GeoreferencedBag
from stab_ros.jobs.geotiffs import GeoTiffs
from stab_ros.jobs.pipeline import OnFrame
from stab_ros.jobs.placed_recording import Placed, Recording, prepared
from stab_ros.jobs.placing import PicturePlacer, PlacedPicture, Work
from stab_ros.jobs.stabilize import expected
from stab_ros.jobs.stage import Stage
from stab_ros.parameters.engines import crs_of, make_georeferencer
from stab_ros.parameters.table import georeference_config


@dataclass(frozen=True)
class Job(Placed):
    """What to georeference and what to write.

    values: checked parameters of georeferencing. interval_s: of GeoTIFFs.
    """

    homographies: Path | None = None
    geotiff: Path | None = None
    interval_s: float | None = None
    with_image: bool = True
    force: bool = False


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
    last_ns: int | None = None
    geotiffs: int = 0
    duration_s: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def placed(self) -> int:
        return self.frames - self.unplaced.total()

    def add(self, answer: Georeferenced) -> None:
        self.frames += 1
        self.last_ns = answer.frame.stamp_ns
        self.first_ns = self.last_ns if self.first_ns is None else self.first_ns
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
        recording = prepared(job, source)
        compiling()
        started_s, total = time.monotonic(), expected(source.count, job.limit)
        with _outputs(job, source, orientation) as outputs:
            result = _run(job, source, recording, outputs, lambda done: progress(done, total))
            if not result.placed:
                raise recording.nothing_placed(result.unplaced, result.first_ns, result.last_ns)
        result.duration_s = time.monotonic() - started_s
        of_level = () if result.first_ns is None or result.last_ns is None else recording.level_doubts(
            result.first_ns, result.last_ns)
        result.warnings = (*outputs.warnings, *outputs.bag.warnings, *source.warnings, *recording.warnings, *of_level,
                           *_said(source, result))
    return result


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


def _run(job: Job, source: Source, recording: Recording, outputs: _Outputs, progress: OnFrame) -> Georeferencing:
    """Reads on this thread, places and writes on two others, each up to two frames behind, all in order."""
    result = Georeferencing()
    placer = PicturePlacer(partial(_begun, job, recording), job.with_image)

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
    if placer.work is not None:
        engine = placer.work.engine
        result.stream_doubts = (*engine.doubts, *(f"{source.name}: {doubt}" for doubt in engine.last_look()),
                                *_crs_doubts(job, placer.work))
    return result


def _begun(job: Job, recording: Recording, size: tuple[int, int]) -> Work:
    placing = recording.begun(size, partial(make_georeferencer, job.values))
    engine = placing.engine
    geotiffs = None if job.geotiff is None else GeoTiffs(job.geotiff, job.interval_s, engine, crs_of(job.values))
    return Work(engine, placing.camera, placing.motion_of, geotiffs)


def _crs_doubts(job: Job, work: Work) -> tuple[str, ...]:
    """That GeoTIFFs have no reference system, though it is known where they lie; in one line, if so."""
    frame, geotiffs = work.engine.local_frame, work.geotiffs
    if geotiffs is None or frame is None or "crs" in job.values or geotiffs.crs != LOCAL:
        return ()
    return (f"{job.geotiff}: the GeoTIFFs are in metres of the map, without a reference system; crs names one, here "
            f"that of UTM is {frame.utm} (crs:=local: none)",)


def _said(source: Source, result: Georeferencing) -> list[str]:
    """What is doubtful, and of how many frames."""
    said = list(result.stream_doubts)
    said += [f"{source.name}: {doubt} ({count} of {counted(result.frames, 'frame')})"
             for doubt, count in result.doubts.values()]
    if result.undecoded:
        images = counted(result.undecoded.total(), "image")
        said.append(f"{source.name}: {images} of {source.image_topic} cannot be decoded, and no answer is given; the "
                    f"first: {next(iter(result.undecoded))}")
    return said
