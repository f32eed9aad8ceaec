"""`stab-ros velocity`: surface velocities of a recording, without ROS; every frame, in order."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.bag import BagWriter, Message
from stab_ros.io.outputs import check_output, completed
from stab_ros.io.source import Picture, Source, open_source
from stab_ros.io.velocity_csv import VelocityWriter
from stab_ros.io.velocity_geojson import write_tracks
from stab_ros.io.velocity_grid_netcdf import TimedGrid, write_grid_netcdf
from stab_ros.io.velocity_netcdf import write_netcdf
from stab_ros.jobs.pipeline import OnFrame
from stab_ros.jobs.placed_recording import Placed, Recording, prepared
from stab_ros.jobs.placing import PicturePlacer, PlacedPicture
from stab_ros.jobs.stabilize import expected
from stab_ros.jobs.stage import Stage
from stab_ros.jobs.velocity_bag import VelocityBag
from stab_ros.jobs.velocity_messages import VelocityMessages
from stab_ros.jobs.velocity_work import VelocityWork
from stab_ros.parameters.velocimeters import stream_config, unit_of
from stab_ros.report.velocity_page import Measurement, write_velocity_page
from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.bank_over_time import bank_of, over_time, told
from stab_ros.velocimetry.dropped import bed_doubt
from stab_ros.velocimetry.speeds import joined, speed_m_s
from stab_ros.velocimetry.vectors import Unit, Vectors
from stab_ros.velocimetry.velocimeter import Measured


@dataclass(frozen=True)
class Job(Placed):
    """What to measure and what to write.

    velocity_values: checked parameters of velocimetry, those of georeferencing among them.
    """

    velocity_values: Mapping[str, Value] = field(default_factory=dict)
    csv: Path | None = None
    tracks: Path | None = None
    netcdf: Path | None = None
    netcdf_grid: Path | None = None
    html: Path | None = None
    force: bool = False


@dataclass
class Velocities:
    """The result of a job. unplaced: frames by reason. warnings: what was lost or is doubtful: one line each."""

    unit: Unit
    frames: int = 0
    unplaced: Counter[str] = field(default_factory=Counter)
    doubts: dict[str, tuple[str, int]] = field(default_factory=dict)  # the last of a kind, and of how many frames
    undecoded: Counter[str] = field(default_factory=Counter)
    doubtful: dict[str, tuple[str, int]] = field(default_factory=dict)  # as doubts, of intervals
    intervals: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    parts: list[Vectors] = field(default_factory=list)
    water_parts: list[Vectors] = field(default_factory=list)
    bank_parts: list[Measured] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)  # vectors, by reason
    wse_m: float = 0.0  # at the last interval
    duration_s: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def vectors(self) -> Vectors:
        return joined(self.parts, self.unit)

    @property
    def water(self) -> Vectors:
        """Those that do not lie on static ground, as far as that is known."""
        return joined(self.water_parts, self.unit)

    @property
    def bank(self) -> BankVelocity:
        """The velocity of static ground."""
        return over_time([bank_of(measured) for measured in self.bank_parts])

    @property
    def median_speed(self) -> float:
        """Of the water, m/s (px/s in pixels); NaN: there are no vectors."""
        vectors = self.water
        return float(np.median(speed_m_s(vectors))) if len(vectors) else float("nan")

    def add(self, placed: PlacedPicture) -> None:
        """Takes what became of a frame."""
        answer = placed.answer
        self.frames += 1
        self.last_ns = answer.frame.stamp_ns
        self.first_ns = self.last_ns if self.first_ns is None else self.first_ns
        if answer.placement is None:
            self.unplaced[answer.reason] += 1
            return
        for doubt in answer.placement.warnings:
            _count(self.doubts, doubt.partition(":")[0], doubt)

    def measured(self, measured: Measured, water: Vectors) -> None:
        """Takes an interval, and those of its vectors that lie on water."""
        self.intervals += 1
        self.parts.append(measured.vectors)
        self.water_parts.append(water)
        self.dropped.update(measured.dropped)
        for kind, doubt in measured.doubts.items():
            _count(self.doubtful, kind, doubt)
        self.wse_m = measured.wse_m


def _count(doubts: dict[str, tuple[str, int]], kind: str, doubt: str) -> None:
    doubts[kind] = (doubt, doubts.get(kind, (doubt, 0))[1] + 1)


@dataclass(frozen=True, eq=False)
class _Done:
    """What a frame leads to. placed: None at the end of the stream."""

    picture: Picture
    placed: PlacedPicture | None
    water: list[Measured]
    bank: list[Measured]


def velocity(job: Job, progress: Progress, compiling: Compiler = compile_kernels) -> Velocities:
    """Measures the velocities of the recording.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable; no output remains.
        WorkError: the work could not be finished; the readable part remains under its `.partial` name.
    """
    for path, suffix in ((job.output, ".mcap"), (job.csv, ".csv"), (job.tracks, ".geojson"), (job.netcdf, ".nc"),
                         (job.netcdf_grid, ".nc"), (job.html, ".html")):
        if path is not None:
            check_output(path, suffix, job.source, job.force)
    config, unit = stream_config(job.velocity_values), unit_of(job.velocity_values)
    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        recording = prepared(job, source, config)
        work = VelocityWork(job, job.velocity_values, recording, source, unit)
        compiling()
        started_s, total = time.monotonic(), expected(source.count, job.limit)
        with _outputs(job, source, work) as outputs:
            result = _run(job, source, work, outputs, lambda done: progress(done, total))
            if result.frames == result.unplaced.total():
                raise recording.nothing_placed(result.unplaced, result.first_ns, result.last_ns)
            result.duration_s = time.monotonic() - started_s
            result.warnings = (*outputs.warnings, *source.warnings, *recording.warnings, *_of_level(recording, result),
                               *_said(source, work, result))
            outputs.finish(result, work)
    return result


@dataclass(frozen=True)
class _Outputs:
    """The writers of the outputs; the paths of those that are written at the end, by kind."""

    bag: VelocityBag
    messages: VelocityMessages
    table: VelocityWriter | None
    later: Mapping[str, Path]
    warnings: list[str]
    grids: list[TimedGrid] = field(default_factory=list)

    def write(self, done: _Done, origin: LocalFrame | None) -> None:
        for measured in done.water:
            self.bag.write_once(done.picture, measured, origin)
            self.bag.write(done.picture, self.messages.of(measured))
            if self.table is not None:
                self.table.write(measured.vectors)
            if "netcdf_grid" in self.later:
                self.grids.append(TimedGrid(measured.stamp_ns, measured.wse_m, self.messages.grid_of(measured)))

    def finish(self, result: Velocities, work: VelocityWork) -> None:
        vectors, frame = result.vectors, work.local_frame
        if "tracks" in self.later:
            write_tracks(self.later["tracks"], vectors, result.wse_m, frame)
        if "netcdf" in self.later:
            write_netcdf(self.later["netcdf"], vectors, result.wse_m, frame)
        if "netcdf_grid" in self.later:
            write_grid_netcdf(self.later["netcdf_grid"], self.grids, result.unit, frame)
        if "html" in self.later:
            write_velocity_page(self.later["html"], _measurement(result, work))


def _measurement(result: Velocities, work: VelocityWork) -> Measurement:
    bank = joined([one.vectors for one in result.bank_parts], result.unit)
    return Measurement(work.name, result.water, result.bank, bank, work.background, work.bank_known, result.frames,
                       result.frames - result.unplaced.total(), result.warnings, work.grid_m, result.dropped)


@contextmanager
def _outputs(job: Job, source: Source, work: VelocityWork) -> Iterator[_Outputs]:
    """Opens all writers. On an error they close first, so that the partial output is readable."""
    with ExitStack() as stack:
        writer = stack.enter_context(BagWriter(job.output, overwrite=job.force))
        later = {name: stack.enter_context(completed(path)) for name, path in (
            ("tracks", job.tracks), ("netcdf", job.netcdf), ("netcdf_grid", job.netcdf_grid),
            ("html", job.html)) if path is not None}
        table_path = stack.enter_context(completed(job.csv)) if job.csv else None
        bag = VelocityBag(writer, source)
        table = stack.enter_context(VelocityWriter(table_path, work.unit)) if table_path else None
        replaced = [f"{source.name}: its own {', '.join(bag.replaced)} gave way to the new ones of the same name"]
        yield _Outputs(bag, VelocityMessages(work.grid_m), table, later, replaced if bag.replaced else [])


def _run(job: Job, source: Source, work: VelocityWork, outputs: _Outputs, progress: OnFrame) -> Velocities:
    """Reads on this thread, measures and writes on two others, each up to two frames behind, all in order."""
    result = Velocities(work.unit)
    placer = PicturePlacer(work.begin, need_image=False)
    last: list[Picture] = []

    def write(item: _Done | Message) -> None:
        if isinstance(item, Message):
            outputs.bag.take_over(item)
            return
        if item.placed is not None:
            result.add(item.placed)
        for measured in item.water:
            result.measured(measured, work.of_water(measured))
        result.bank_parts += item.bank
        outputs.write(item, work.local_frame if work.unit == "m" else None)
        progress(result.frames)

    def measure(item: Picture | Message) -> None:
        if isinstance(item, Message):
            writing.put(item)
            return
        placed = placer.step(item)
        if placed is not None:
            last[:] = [item]
            writing.put(_Done(item, placed, *work.add(placed)))

    with Stage(write) as writing:
        with Stage(measure) as measuring:
            for item in source.items(job.limit):
                measuring.put(item)
        if last:
            writing.put(_Done(last[0], None, *work.finish()))
    result.undecoded = placer.undecoded
    return result


def _of_level(recording: Recording, result: Velocities) -> list[str]:
    if result.unit == "px" or result.first_ns is None or result.last_ns is None:
        return []
    return recording.level_doubts(result.first_ns, result.last_ns)


def _said(source: Source, work: VelocityWork, result: Velocities) -> list[str]:
    """What is doubtful, and of how many frames."""
    said = list(work.doubts)
    said += [f"{source.name}: {doubt} ({count} of {counted(result.frames, 'frame')})"
             for doubt, count in result.doubts.values()]
    if result.undecoded:
        said.append(f"{source.name}: {counted(result.undecoded.total(), 'image')} of {source.image_topic} cannot be "
                    f"decoded; the first: {next(iter(result.undecoded))}")
    said += [f"{source.name}: {doubt} ({count} of {counted(result.intervals, 'interval')})"
             for doubt, count in result.doubtful.values()]
    if not len(result.vectors):
        said.append(f"{source.name}: {_why_none(work, result)}")
    if not (work.bank_known or work.area_given):
        said.append(f"{source.name}: no static map tells ground from water, so velocities are measured everywhere, on "
                    "the bank, too; roi, exclude or static_map must say where the water is")
    usual = {kind for kind, (_, count) in result.doubtful.items() if 2 * count > result.intervals}
    bed = bed_doubt(result.dropped, len(result.vectors), usual)
    if bed:
        said.append(f"{source.name}: {bed}")
    bank = result.bank
    if bank.at_rest is False:
        said.append(f"{source.name}: the bank moves by {told(bank, result.unit)}; the frames do not lie still, and "
                    "velocities are wrong by as much")
    return said


def _why_none(work: VelocityWork, result: Velocities) -> str:
    """Why there is not one vector, as far as that is known."""
    none = f"not one vector was measured in {counted(result.intervals, 'interval')}"
    if not result.intervals:
        return f"{none}; {work.interval_name} is longer than the recording, or its frames are too few"
    if result.doubtful or result.dropped.total():
        return none
    if work.leaves_out_bank and result.bank.count:
        return (f"{none}; all that was seen stands still and counts as bank ({counted(result.bank.count, 'vector')}); "
                "water beside it, if there is any, shows no texture. If no bank is in view, the stabilisation may "
                "follow moving water, and neither velocity can be checked; leave_out_bank:=false measures what stands")
    return f"{none}; the water may show no texture"
