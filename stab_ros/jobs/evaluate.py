"""`stab-ros evaluate`: runs the evaluator on every frame of each image stream of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from stab_ros.core.errors import MessageError
from stab_ros.core.kernels import Compiler, compile_kernels
from stab_ros.core.progress import Progress
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.types import Frame
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.pairing import Pairing
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.io.bag import Message
from stab_ros.io.camera_message import read_size
from stab_ros.io.cdr import IMAGE
from stab_ros.io.homography_message import read_homography
from stab_ros.io.image_message import read_image
from stab_ros.io.source import Clock, Picture
from stab_ros.jobs.evaluate_streams import ImageStream, expected_pictures, open_streams
from stab_ros.jobs.stage import Stage
from stab_ros.parameters.engines import make_evaluator

_WAITING_BYTES = 1 << 30  # of images whose homographies come later in the recording


@dataclass(frozen=True)
class EvaluationJob:
    """What to evaluate. values: checked parameters of the evaluator.

    image_topics: empty for the only one, or for the stabilised and the raw one of a camera.
    """

    source: Path
    values: Mapping[str, Value]
    image_topics: tuple[str, ...] = ()
    limit: int | None = None
    fps: float | None = None
    clock: Clock = Clock.HEADER


def evaluate(job: EvaluationJob, progress: Progress, compiling: Compiler = compile_kernels) -> Evaluation:
    """Evaluates the recording.

    compiling: compiles all kernels, before the first frame.

    Raises:
        InputError: an argument or the input is unusable.
    """
    make_evaluator(job.values)  # refuses wrong settings before anything is read
    topics: list[TopicEvaluation] = []
    warnings: list[str] = []
    with open_streams(job.source, job.image_topics, job.fps, job.clock) as streams:
        counter = _StreamsProgress(progress, expected_pictures(streams, job.limit))
        compiling()
        for stream in streams:
            work = _Work(stream, make_evaluator(job.values), counter)
            topics.append(work.run(job))
            warnings += [*stream.source.warnings, *work.warnings]
    return Evaluation(job.source, len(topics[0].rows), tuple(topics), tuple(dict.fromkeys(warnings)))


class _StreamsProgress:
    """Progress over all streams."""

    def __init__(self, progress: Progress, total: int | None) -> None:
        self._progress = progress
        self._total = total
        self._done = 0

    def one_more(self) -> None:
        self._done += 1
        self._progress(self._done, self._total)


class _Work:
    """Runs one stream through its evaluator, and counts unusable images."""

    def __init__(self, stream: ImageStream, evaluator: Evaluator, counter: _StreamsProgress) -> None:
        self._stream = stream
        self._evaluator = evaluator
        self._counter = counter
        self._pairing = Pairing(stream.homography is not None, _WAITING_BYTES)
        self._rows: list[FrameMetrics] = []
        self._index = -1
        self._pictures = self._unused = self._unread = 0
        self._problem = ""

    @property
    def warnings(self) -> list[str]:
        source, found = self._stream.source, []
        if self._unused:
            found.append(f"{source.name}: {self._unused} of {counted(self._pictures, 'image')} of {source.image_topic} "
                         f"cannot be used; the first: {self._problem}")
        if self._unread:
            found.append(f"{source.name}: {counted(self._unread, 'message')} of {self._stream.homography} cannot be "
                         "read as homographies")
        if not self._evaluator.points:
            found.append(f"{source.name}: the first image of {source.image_topic} has no place for a verification "
                         "point, so there is no RMSD; it must show texture, away from its border")
        return found

    def run(self, job: EvaluationJob) -> TopicEvaluation:
        """Reads on this thread and measures on another one, in order."""
        with Stage(self._step) as measuring:
            for item in self._stream.source.items(job.limit, self._stream.others):
                measuring.put(item)
        for arrival in self._pairing.flush():
            self._measure(arrival)
        reference, config = self._evaluator.reference, self._evaluator.config
        assert reference is not None  # a source without a readable image raises
        return TopicEvaluation(
            self._stream.source.image_topic, reference, self._evaluator.points, self._evaluator.static,
            tuple(map(self._evaluator.revised, self._rows)), config,
            config.fps or job.fps or self._stream.source.rate_hz(),
            self._evaluator.camera_fixed, self._evaluator.has_hot_pixels, self._evaluator.points_are_named)

    def _step(self, item: Picture | Message) -> None:
        for arrival in self._of_picture(item) if isinstance(item, Picture) else self._of_message(item):
            self._measure(arrival)

    def _of_picture(self, picture: Picture) -> list[Arrival]:
        self._pictures += 1
        self._counter.one_more()
        frame = picture.decoded if isinstance(picture.decoded, Frame) else None
        if frame is None:
            self._unused += 1
            self._problem = self._problem or str(picture.decoded)
        if self._stream.homography is not None:
            return [] if frame is None else self._pairing.image(frame)
        self._index += 1
        return [Arrival(self._index, picture.stamp_ns, None, False, frame)]

    def _of_message(self, message: Message) -> list[Arrival]:
        stamps = self._stream.stamps
        try:
            if message.topic == self._stream.homography:
                stamp_ns, ref_H_cur = read_homography(message.data)
                stamp_ns = stamps.next_of(stamp_ns, message.log_time_ns) if stamps else stamp_ns
                return self._pairing.homography(stamp_ns, ref_H_cur, read_size(message.data))
            frame = read_image(message.data, IMAGE)
            stamp_ns = stamps.first_of(frame.stamp_ns, message.log_time_ns) if stamps else frame.stamp_ns
            self._evaluator.use_reference(replace(frame, stamp_ns=stamp_ns))
        except MessageError:
            self._unread += 1
        return []

    def _measure(self, arrival: Arrival) -> None:
        self._rows.append(self._evaluator.step(arrival))
