"""`stab-ros compare`: methods and presets over the same frames, each in its process, measured by one evaluator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value, did_you_mean
from stab_ros.core.text import counted
from stab_ros.core.types import Frame, LostReason, State, Track
from stab_ros.evaluation.comparison_results import Comparison, MethodResult, Passage
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.io.source import Clock, Picture, Source, open_source
from stab_ros.jobs.compare_child import Failed, Finished, Run, Step, steps_of
from stab_ros.jobs.compare_truth import Truth
from stab_ros.jobs.stabilize import expected
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_evaluator
from stab_ros.parameters.presets import PRESETS
from stab_ros.parameters.table import EVALUATOR_PARAMETERS, PARAMETERS, checked_values

RAW = "raw"


@dataclass(frozen=True)
class ComparisonJob:
    """What to compare. values, judging: checked parameters of the tracker and of the evaluator."""

    source: Path
    methods: tuple[str, ...]
    values: Mapping[str, Value]
    judging: Mapping[str, Value]
    truth: Path | None = None
    image_topic: str | None = None
    limit: int | None = None
    fps: float | None = None
    clock: Clock = Clock.HEADER

    def run_of(self, method: str) -> Run:
        """The task of the process of one method."""
        return Run(self.source, {**self.values, "method": method}, self.image_topic, self.limit, self.fps, self.clock)


def known_methods() -> tuple[str, ...]:
    """All values of the parameter `method`."""
    return (*METHODS, *PRESETS)


def checked_methods(names: Sequence[str] | None) -> tuple[str, ...]:
    """The names without duplicates; all known methods for None.

    Raises:
        InputError: one of them is unknown.
    """
    known = known_methods()
    for name in names or ():
        if name not in known:
            meant = did_you_mean(name, known) or f"it must be one of {', '.join(known)}"
            raise InputError(f"--methods: {name!r} is unknown, {meant}")
    return known if names is None else tuple(dict.fromkeys(names))


def shared_values(given: Mapping[str, object]) -> tuple[dict[str, Value], dict[str, Value]]:
    """Parameters of the trackers and of the evaluator. Both get the regions; `points_file` is for the trackers.

    Raises:
        ConfigError: an unknown name, a wrong type, or out of range.
    """
    checked = checked_values(given, {**EVALUATOR_PARAMETERS, **PARAMETERS})
    values = {name: value for name, value in checked.items() if name in PARAMETERS}
    judging = {name: value for name, value in checked.items() if name in EVALUATOR_PARAMETERS and name != "points_file"}
    return values, judging


def compare(job: ComparisonJob, progress: Progress, compiling: Compiler = compile_kernels) -> Comparison:
    """Compares the methods; reads the input once for the raw frames, then once for each method.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable.
    """
    truth = Truth(job.truth) if job.truth else None
    make_evaluator(job.judging)  # refuses wrong settings before anything is read
    with open_source(job.source, job.image_topic, job.fps, job.clock) as source:
        counter = _MethodsProgress(progress, expected(source.count, job.limit), len(job.methods))
        compiling()
        fps = job.fps or source.rate_hz()
        raw = _judge_raw(source, job, _Judge(make_evaluator(job.judging), truth, fps), counter)
        frames, warnings = len(raw.passages), [*source.warnings, *_unused(source, raw), *_without_points(source, raw)]
    if truth is not None:
        truth.check(frames, job.source.name)
        warnings += _beyond(job, truth, frames)
    counter.settle(frames)
    results = [_judge_method(name, job, _Judge(make_evaluator(job.judging), truth, fps), counter)
               for name in job.methods]
    shared = tuple(_sharing_reference(result, raw) for result in results)
    return Comparison(job.source, frames, raw, shared, truth is not None, (*warnings, *_other_references(shared)))


class _MethodsProgress:
    """Progress over the passes through the input: the raw frames, then each method."""

    def __init__(self, progress: Progress, frames: int | None, methods: int) -> None:
        self._progress = progress
        self._passes = methods + 1
        self._frames = frames
        self._done = 0

    def settle(self, frames: int) -> None:
        """Sets the true number of frames."""
        self._frames, self._done = frames, frames

    def one_more(self) -> None:
        self._done += 1
        self._progress(self._done, self._frames and self._frames * self._passes)

    def skip_to(self, passes: int) -> None:
        """Counts the remaining frames of a failed method as done."""
        self._done = (self._frames or 0) * passes


class _Judge:
    """Measures the frames that one method has stabilised, one after the other."""

    def __init__(self, evaluator: Evaluator, truth: Truth | None, fps: float) -> None:
        self._evaluator, self._truth, self._fps = evaluator, truth, fps
        self._rows: list[FrameMetrics] = []
        self._passages: list[Passage] = []
        self._reference: tuple[int, int] | None = None  # frame and reset counter

    def __len__(self) -> int:
        return len(self._passages)

    def add(self, step: Step) -> None:
        """Measures the next frame."""
        track, steady = step.track, step.steady
        begins = track.tracked and (self._reference is None or track.reset_counter != self._reference[1])
        if begins:
            self._reference = step.number, track.reset_counter
        self._rows.append(self._evaluator.step(
            Arrival(step.number, track.stamp_ns, track.ref_H_cur, not track.tracked, steady)))
        error_px = None if begins or steady is None else self._error_px(step.number, track, steady.size)
        self._passages.append(Passage(step.number, track, begins, error_px, step.seconds))

    def _error_px(self, number: int, track: Track, size: tuple[int, int]) -> float | None:
        if self._truth is None or self._reference is None or track.ref_H_cur is None:
            return None
        return self._truth.error_px(number, self._reference[0], track.ref_H_cur, size)

    def result(self, name: str, peak_mb: int | None = None) -> MethodResult:
        """The result, after the last frame."""
        evaluator, reference, evaluation = self._evaluator, self._evaluator.reference, None
        if reference is not None:
            evaluation = TopicEvaluation(name, reference, evaluator.points, evaluator.static,
                                         tuple(map(evaluator.revised, self._rows)),
                                         evaluator.config, evaluator.config.fps or self._fps,
                                         evaluator.camera_fixed, evaluator.has_hot_pixels, evaluator.points_are_named)
        return MethodResult(name, tuple(self._passages), evaluation, peak_mb)


def _judge_raw(source: Source, job: ComparisonJob, judge: _Judge, counter: _MethodsProgress) -> MethodResult:
    """Measures the raw frames, with the identity as their homography."""
    size: tuple[int, int] | None = None
    for number, picture in enumerate(source.frames(job.limit)):
        frame = picture.decoded if isinstance(picture.decoded, Frame) else None
        size = size or (frame.size if frame else None)
        judge.add(_unmoved(number, picture, frame if frame and frame.size == size else None))
        counter.one_more()
    return judge.result(RAW)


def _unmoved(number: int, picture: Picture, frame: Frame | None) -> Step:
    if frame is None:
        return Step(number, Track(State.LOST, number, picture.stamp_ns, 0, 0, lost_reason=LostReason.UNUSABLE), None)
    return Step(number, Track(State.TRACKED, number, picture.stamp_ns, 0, 0, ref_H_cur=np.eye(3)), None, steady=frame)


def _judge_method(name: str, job: ComparisonJob, judge: _Judge, counter: _MethodsProgress) -> MethodResult:
    ending: Finished | Failed = Failed("its process sent nothing")
    with closing(steps_of(job.run_of(name))) as steps:
        for item in steps:
            if isinstance(item, Step):
                judge.add(item)
                counter.one_more()
            else:
                ending = item
    counter.skip_to(job.methods.index(name) + 2)
    if isinstance(ending, Failed):
        after = f" (after {counted(len(judge), 'frame')})" if len(judge) else ""
        return MethodResult(name, failure=ending.why + after)
    return judge.result(name, ending.peak_mb)


def _sharing_reference(result: MethodResult, raw: MethodResult) -> MethodResult:
    """The result with the reference of the raw frames where it is the same image, which saves memory."""
    mine, theirs = result.evaluation, raw.evaluation
    if mine is None or theirs is None or not np.array_equal(mine.reference.image, theirs.reference.image):
        return result
    return replace(result, evaluation=replace(mine, reference=theirs.reference))


def _unused(source: Source, raw: MethodResult) -> list[str]:
    if not raw.lost:
        return []
    return [f"{source.name}: {raw.lost} of {counted(len(raw.passages), 'image')} of {source.image_topic} cannot be "
            "used, which counts as lost; images must be readable and of one size"]


def _without_points(source: Source, raw: MethodResult) -> list[str]:
    if raw.evaluation is None or raw.evaluation.points:
        return []
    return [f"{source.name}: the first image has no place for a verification point, so there is no displacement; it "
            "must show texture, away from its border"]


def _beyond(job: ComparisonJob, truth: Truth, frames: int) -> list[str]:
    rows = truth.beyond(frames) if job.limit is None else 0
    belong = counted(rows, "of its rows belongs", "of its rows belong")
    return [f"{job.truth}: {belong} to no frame of {job.source.name}"] if rows else []


def _other_references(results: Sequence[MethodResult]) -> list[str]:
    """Warnings for the methods whose reference is not frame 0."""
    return [f"{result.name}: could not use frame 0, its reference is frame {result.reference}"
            for result in results if result.reference]
