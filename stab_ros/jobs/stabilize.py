"""`stab-ros stabilize`: a recording into a stabilised bag, without ROS; processes every frame, deterministically."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.types import Frame, LostReason
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.window import Window
from stab_ros.io import advice
from stab_ros.io.bag import BagWriter
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.outputs import check_output, completed
from stab_ros.io.source import Clock, Source, open_source, read_again
from stab_ros.io.video_writer import VideoWriter
from stab_ros.jobs.pipeline import Counts, Outputs, run
from stab_ros.jobs.stabilized_bag import StabilizedBag
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.parameters.table import PARAMETERS
from stab_ros.tracking.stabilizer import Stabilizer


@dataclass(frozen=True)
class Job:
    """What to stabilise and what to write. values: checked parameters of the tracker."""

    source: Path
    output: Path
    values: Mapping[str, Value]
    image_topic: str | None = None
    homographies: Path | None = None
    video: Path | None = None
    with_image: bool = True
    keep_raw: bool = False
    limit: int | None = None
    fps: float | None = None
    force: bool = False
    clock: Clock = Clock.HEADER


@dataclass(frozen=True)
class Stabilization:
    """The result of a job. lost: frames by reason. warnings: what was lost; notes: what was found: one line each."""

    frames: int
    lost: Counter[LostReason]
    duration_s: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def tracked(self) -> int:
        return self.frames - self.lost.total()


def stabilize(job: Job, progress: Progress, compiling: Compiler = compile_kernels) -> Stabilization:
    """Stabilises the recording.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable; no output remains.
        WorkError: the work could not be finished; the readable part remains under its `.partial` name.
    """
    _check_outputs(job)
    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        camera = source.camera() if _uses_camera(job.values) else None
        stabilizer = make_stabilizer(job.values, camera)
        total = expected(source.count, job.limit)
        compiling()
        started_s = time.monotonic()
        with _open_outputs(job, source, camera, stabilizer.window) as outputs:
            counts = run(source.items(job.limit), stabilizer, outputs, lambda done: progress(done, total),
                         partial(read_again, job.source, job.image_topic, job.fps, job.clock, job.limit))
        warnings = (*_replaced(source, outputs.bag.replaced), *_camera_changes(source, outputs.bag),
                    *source.warnings, *_unused(source, counts), *_remarks(source, stabilizer, counts),
                    *_lost(source, counts, stabilizer.reference))
    notes = tuple(f"{source.name}: {note}" for note in (*counts.notes, advice.simpler_model(counts.simpler)) if note)
    return Stabilization(counts.frames, counts.lost, time.monotonic() - started_s, warnings, notes)


def expected(count: int | None, limit: int | None) -> int | None:
    """Number of images to process, of `count` in the input; None if unknown."""
    known = [number for number in (count, limit) if number is not None]
    return min(known, default=None)


def _uses_camera(values: Mapping[str, Value]) -> bool:
    return bool(values.get("use_camera_info", PARAMETERS["use_camera_info"].default))


def _check_outputs(job: Job) -> None:
    for path, suffix in ((job.output, ".mcap"), (job.homographies, ".csv"), (job.video, ".mp4")):
        if path is not None:
            check_output(path, suffix, job.source, job.force)


@contextmanager
def _open_outputs(job: Job, source: Source, camera: Camera | None, window: Window) -> Iterator[Outputs]:
    """Opens all writers. On an error they close first, so that the partial output is readable."""
    with ExitStack() as stack:
        writer = stack.enter_context(BagWriter(job.output, overwrite=job.force))
        table_path = stack.enter_context(completed(job.homographies)) if job.homographies else None
        video_path = stack.enter_context(completed(job.video)) if job.video else None
        bag = StabilizedBag(writer, source, camera, job.with_image, job.keep_raw, window)
        table = stack.enter_context(HomographyWriter(table_path)) if table_path else None
        video = stack.enter_context(VideoWriter(video_path, job.fps or source.rate_hz())) if video_path else None
        yield Outputs(bag, table, video)


def _replaced(source: Source, topics: list[str]) -> list[str]:
    return [f"{source.name}: its own {', '.join(topics)} gave way to the new ones of the same name"] if topics else []


def _camera_changes(source: Source, bag: StabilizedBag) -> list[str]:
    if bag.camera_change_ns is None:
        return []
    return [f"{source.name}: {bag.camera_topic} tells of another camera from {bag.camera_change_ns} ns on, "
            "the camera of its first message was used for all images"]


def _unused(source: Source, counts: Counts) -> list[str]:
    unused = counts.lost[LostReason.UNUSABLE]
    if not unused:
        return []
    return [f"{source.name}: {unused} of {counted(counts.frames, 'image')} of {source.image_topic} cannot be used, "
            f"which counts as lost ({LostReason.UNUSABLE.value}); the first: {counts.problem}"]


def _remarks(source: Source, stabilizer: Stabilizer, counts: Counts) -> list[str]:
    """Reasons why the answers may be wrong."""
    found = advice.remarks(stabilizer.competing_hypothesis, stabilizer.relief, stabilizer.swing,
                          stabilizer.copied_share)
    return [f"{source.name}: {remark}" for remark in (advice.begun_anew(counts.resets), *found) if remark]


def _lost(source: Source, counts: Counts, reference: Frame | None) -> list[str]:
    """Why many frames are lost, and what to try; no second line of those that cannot be used."""
    if reference is None:
        return [f"{source.name}: not one image of {source.image_topic} could become the reference, so all are lost "
                f"({LostReason.NO_TEXTURE.value}); it must show some texture (all are flat, black or below 64x64 px)"]
    often = advice.often_lost(counts.lost, counts.frames)
    said = set(counts.lost) == {LostReason.UNUSABLE}
    return [f"{source.name}: {often}"] if often and not said else []
